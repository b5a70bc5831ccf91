use crate::Error;

/// σ of a zero-mean normal over a tangent: metres on each translation axis, radians on each rotation axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sigma {
    /// Metres.
    pub translation: f64,
    /// Radians.
    pub rotation: f64,
}

impl Sigma {
    const fn new(translation: f64, rotation: f64) -> Self {
        Self { translation, rotation }
    }

    fn is_positive(&self) -> bool {
        self.translation > 0.0 && self.rotation > 0.0 && (self.translation + self.rotation).is_finite()
    }
}

/// In what the gaps between poses are counted when closures are put into groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GapUnit {
    /// Pose indices; the defaults think of keyframes 3 m apart.
    Poses,
    /// Metres of path.
    Metres,
}

/// Parameters of [`gcm`](crate::gcm()). The defaults are for keyframes about 3 m apart and sonar-like registration.
#[derive(Debug, Clone, PartialEq)]
pub struct GcmParams {
    /// The robot in whose map all are compared; default the smallest id of each connected team.
    pub reference: Option<u32>,
    /// Posterior probability from which on a group is accepted whatever the others are; default 0.76, about what one
    /// vote ahead of a repeated slip gives.
    pub accept: f64,
    /// Largest expected share of wrong groups among the accepted ones of a team, up to which less sure groups are
    /// accepted among sure ones; default 0.06. 0 accepts from `accept` on alone.
    pub wrong_share: f64,
    /// Least posterior probability of a group that is accepted among sure ones; default 0.69, above what a group has of
    /// which nothing is known (`sound` less `doubt`, 0.63): that one gains nothing from the rest of its team.
    pub accept_among: f64,
    /// Largest posterior probability of a rejected group; default 0.20. Between this and the accepted a group is
    /// undecided.
    pub reject: f64,
    /// An accepted group is withdrawn only below this once it was accepted before; default 0.53.
    pub withdraw: f64,
    /// π, prior share of sound groups of at least two closures; default 0.70.
    pub sound: f64,
    /// The same of lone closures; default 0.60.
    pub sound_single: f64,
    /// Weight of `sound` and `sound_single` against what the run itself shows, as a number of votes: the share is
    /// estimated under `Beta(strength · π, strength · (1 - π))`; default 20, infinity fixes the share.
    pub sound_strength: f64,
    /// Largest factor by which the drift's σ between groups may exceed what the trajectories tell. Default 1: they are
    /// taken at their word, since a drift taken too wide lets slips pass. Set it to 4 or 8 for maps known to be told
    /// too precise.
    pub drift_most: f64,
    /// What each doubling of that σ costs, nats; default 6, so that covariances are believed until much speaks against
    /// them: a drift taken too wide lets slips pass.
    pub drift_doubt: f64,
    /// pT, share of translation slips among the biased groups that are not gross; default 0.90.
    pub slip_share: f64,
    /// pO, share of gross errors among biased groups; default 0.03.
    pub gross_share: f64,
    /// The same of lone closures; default 0.50.
    pub gross_share_single: f64,
    /// α, probability that a second slip between two robots repeats their first, where a prior tells how their maps
    /// lie: all registrations of the two then start from the same error and tend to fall into the same wrong place;
    /// default 0.65. Slips that do repeat raise it for the next. Raise it (0.9) in lattices known to alias.
    pub alpha: f64,
    /// The same of two robots without a prior between them: each of their registrations was found by itself, and a
    /// lattice has two axes, two signs and more than one step to slip by; default 0.05.
    pub alpha_unplaced: f64,
    /// χ, odds that a slip new to a robot pair is a given one of another pair rather than one never seen; default 0.05:
    /// other pairs start from other errors and meet in other places.
    pub alpha_across: f64,
    /// γ, how much the evidence on a group counts, see the model; default 1.15, about the maximum likelihood over
    /// generated harbours of 30 % biased groups. 1 gives the posterior of the model as it is.
    pub evidence_exponent: f64,
    /// How much the log odds of each group are lowered, nats, see the model; default 0.30, so that P errs on the side of
    /// too little where few groups judge each other. The limits of P are meant for it: 0 needs an `accept_among` above
    /// `sound`.
    pub doubt: f64,
    /// Spike `S_b`: harmless bias common to a sound group; default 0.1 m, 0.005 rad.
    pub spike: Sigma,
    /// `S_T`: translation slip, in the common map frame; default 3 m, 0.015 rad: spacings of 2 to 6 m, and what repeats
    /// itself lies parallel to within a degree. A quarter of the slips is half as wide, a quarter twice.
    pub slip: Sigma,
    /// Slips shorter than this do not exist: what is off by less is harmless, metres; default 0.75, half the finest
    /// spacing of the structures thought of. 0 allows all.
    pub least_slip: f64,
    /// `S_Y`: yaw slip about the group's place; default 0.3 m, 0.07 rad.
    pub yaw: Sigma,
    /// Yaw slips smaller than this do not exist: what turns by less is harmless, radians; default 0.0436, 2.5°, which
    /// at 17 m is as far off as the least slip. 0 allows all.
    pub least_yaw: f64,
    /// `S_O`: gross error; default 6 m, 0.5 rad.
    pub gross: Sigma,
    /// Share of gross errors that are of a wrong place altogether, as from place recognition; default 0.50.
    pub elsewhere_share: f64,
    /// `S_E`: a wrong place, of the order of the map itself, so that no such closure pulls at the map transform;
    /// default 100 m, 2 rad.
    pub elsewhere: Sigma,
    /// `π_P`, share of map priors that are as good as they say; default 0.85.
    pub prior_sound: f64,
    /// What a bad map prior adds to its covariance; default 4 m, 0.15 rad.
    pub prior_bad: Sigma,
    /// Width of the map transforms before any evidence, about the linearisation; default 15 m, 0.8 rad.
    pub base: Sigma,
    /// What gaps are counted in; default poses.
    pub unit: GapUnit,
    /// Closures at most this far apart (both robots) are one group; default 6.
    pub gap: f64,
    /// A group stays shorter than this on each robot; default 12, so that a pass of twice a sensor's range is one place
    /// and a longer one is cut.
    pub extent: f64,
    /// ℓ, length over which neighbouring groups share their fate, and closures of a group their bias; default 4: pieces
    /// of one run that the extent cut apart share it (κ = 0.94 at a gap of 1), groups that the gap parted hardly do
    /// (0.1).
    pub correlation: f64,
    /// Share of true pairs that pass the pair test inside a group; default 0.99.
    pub probability: f64,
    /// Largest number of hypotheses kept; default 64.
    pub beam: usize,
    /// Hypotheses this many nats below the best are dropped; default 14.
    pub depth: f64,
    /// Up to this many clusters all neighbours are solved jointly, above it each block by itself; default 40.
    pub joint_limit: usize,
}

impl Default for GcmParams {
    fn default() -> Self {
        Self {
            reference: None,
            accept: 0.76,
            wrong_share: 0.06,
            accept_among: 0.69,
            reject: 0.20,
            withdraw: 0.53,
            sound: 0.70,
            sound_single: 0.60,
            sound_strength: 20.0,
            drift_most: 1.0,
            drift_doubt: 6.0,
            slip_share: 0.90,
            gross_share: 0.03,
            gross_share_single: 0.50,
            alpha: 0.65,
            alpha_unplaced: 0.05,
            alpha_across: 0.05,
            evidence_exponent: 1.15,
            doubt: 0.30,
            spike: Sigma::new(0.1, 0.005),
            slip: Sigma::new(3.0, 0.015),
            least_slip: 0.75,
            yaw: Sigma::new(0.3, 0.07),
            least_yaw: 2.5_f64.to_radians(),
            gross: Sigma::new(6.0, 0.5),
            elsewhere_share: 0.50,
            elsewhere: Sigma::new(100.0, 2.0),
            prior_sound: 0.85,
            prior_bad: Sigma::new(4.0, 0.15),
            base: Sigma::new(15.0, 0.8),
            unit: GapUnit::Poses,
            gap: 6.0,
            extent: 12.0,
            correlation: 4.0,
            probability: 0.99,
            beam: 64,
            depth: 14.0,
            joint_limit: 40,
        }
    }
}

impl GcmParams {
    /// Accepts from 0.95 on alone and thinks slips repeated as often where no prior is (`alpha_unplaced` 0.6), and
    /// between whichever robots (`alpha_across` 1): for systems where one wrong merge is worse than many late ones.
    pub fn strict() -> Self {
        Self { accept: 0.95, wrong_share: 0.0, alpha_unplaced: 0.6, alpha_across: 1.0, ..Self::default() }
    }

    /// Accepts what is about as likely as not before `doubt` and leaves nothing undecided: for systems that must merge.
    /// Its error is the limit of what the data tell, so with nothing to go on it is wrong at the base rate.
    pub fn leading() -> Self {
        Self { accept: 0.4, reject: 0.4, withdraw: 0.4, ..Self::default() }
    }

    /// Whether a group of which nothing is known, or a rejected one, is never accepted among sure ones.
    fn accept_among_is_sure(&self) -> bool {
        let unknown = from_log_odds(log_odds(self.sound) - self.doubt);
        self.wrong_share == 0.0 || (self.reject <= self.accept_among && unknown < self.accept_among)
    }

    /// Prior share of sound ones among lone closures or among groups.
    pub(crate) fn sound_share(&self, single: bool) -> f64 {
        if single { self.sound_single } else { self.sound }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        let open = |p: f64| p > 0.0 && p < 1.0;
        let probabilities = [
            ("accept", open(self.accept)),
            ("wrong_share", self.wrong_share >= 0.0 && self.wrong_share < 1.0),
            ("accept_among", open(self.accept_among) && self.accept_among_is_sure()),
            ("reject", open(self.reject) && self.reject <= self.accept),
            ("withdraw", self.withdraw > 0.0 && self.withdraw <= self.accept),
            ("sound", open(self.sound)),
            ("sound_single", open(self.sound_single)),
            ("sound_strength", self.sound_strength > 0.0),
            ("drift_most", self.drift_most >= 1.0),
            ("drift_doubt", self.drift_doubt >= 0.0),
            ("slip_share", open(self.slip_share)),
            ("gross_share", open(self.gross_share)),
            ("gross_share_single", open(self.gross_share_single)),
            ("alpha", open(self.alpha)),
            ("alpha_unplaced", open(self.alpha_unplaced)),
            ("alpha_across", self.alpha_across > 0.0 && self.alpha_across.is_finite()),
            ("elsewhere_share", open(self.elsewhere_share)),
            ("prior_sound", open(self.prior_sound)),
            ("evidence_exponent", self.evidence_exponent > 0.0 && self.evidence_exponent.is_finite()),
            ("doubt", self.doubt.is_finite()),
            ("probability", open(self.probability)),
            ("spike", self.spike.is_positive()),
            ("slip", self.slip.is_positive()),
            ("least_slip", self.least_slip >= 0.0 && self.least_slip.is_finite()),
            ("yaw", self.yaw.is_positive()),
            ("least_yaw", self.least_yaw >= 0.0 && self.least_yaw.is_finite()),
            ("gross", self.gross.is_positive()),
            ("elsewhere", self.elsewhere.is_positive()),
            ("prior_bad", self.prior_bad.is_positive()),
            ("base", self.base.is_positive()),
            ("gap", self.gap >= 0.0),
            ("extent", self.extent > 0.0),
            ("correlation", self.correlation > 0.0),
            ("beam", self.beam > 0),
            ("depth", self.depth > 0.0),
        ];
        match probabilities.iter().find(|(_, sound)| !sound) {
            Some((name, _)) => Err(Error::Parameter { name }),
            None => Ok(()),
        }
    }
}

/// Shares of hypotheses may add up to a little more than one.
pub(crate) fn log_odds(p: f64) -> f64 {
    let p = p.clamp(0.0, 1.0);
    p.ln() - (1.0 - p).ln()
}

pub(crate) fn from_log_odds(odds: f64) -> f64 {
    (1.0 + (-odds).exp()).recip()
}
