use super::beam::State;
use super::params::GcmParams;

/// How many votes so far are sound: `[lone closures, groups]`, each `(sound, all)`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SoundCounts([(u32, u32); 2]);

impl SoundCounts {
    pub(crate) fn add(&mut self, single: bool, sound: bool) {
        let (good, all) = &mut self.0[usize::from(!single)];
        *good += u32::from(sound);
        *all += 1;
    }

    /// Predictive share of sound votes under `Beta(strength · share, strength · (1 - share))`.
    pub(crate) fn predicted(&self, single: bool, params: &GcmParams) -> f64 {
        let (good, all) = self.0[usize::from(!single)];
        let share = params.sound_share(single);
        share + (f64::from(good) - share * f64::from(all)) / (params.sound_strength + f64::from(all))
    }
}

/// Prior of a cluster's state given the hypothesis so far.
pub(crate) struct StatePrior<'a> {
    pub(crate) sound: f64,
    pub(crate) gross: f64,
    /// α of the robot pair.
    pub(crate) alpha: f64,
    pub(crate) params: &'a GcmParams,
    /// Of the same robot pair.
    pub(crate) slip_counts: &'a [u32],
    pub(crate) neighbor: Option<(State, f64)>,
}

impl StatePrior<'_> {
    fn independent(&self, state: State) -> f64 {
        let local = (1.0 - self.sound) * (1.0 - self.gross);
        let slips: u32 = self.slip_counts.iter().sum();
        match state {
            State::Good => self.sound,
            State::Gross => (1.0 - self.sound) * self.gross * (1.0 - self.params.elsewhere_share),
            State::Elsewhere => (1.0 - self.sound) * self.gross * self.params.elsewhere_share,
            State::YawSlip => local * (1.0 - self.params.slip_share),
            State::BadPrior => 0.0,
            State::Slip(j) => {
                // Pitman-Yor with discount 1 - α: whatever the order, slips that repeat make repetition likelier
                let discount = 1.0 - self.alpha;
                let distinct = self.slip_counts.iter().filter(|count| **count > 0).count() as f64;
                let new = if slips == 0 { 1.0 } else { discount * distinct / f64::from(slips) };
                let step = match self.slip_counts.get(usize::from(j)) {
                    Some(0) => self.params.alpha_across * new,
                    Some(&count) => (f64::from(count) - discount) / f64::from(slips),
                    None => new,
                };
                local * self.params.slip_share * step
            }
        }
    }

    pub(crate) fn log(&self, state: State) -> f64 {
        let independent = self.independent(state);
        match self.neighbor {
            Some((same, kappa)) => {
                (kappa * f64::from(u8::from(same == state)) + (1.0 - kappa) * independent).ln()
            }
            None => independent.ln(),
        }
    }
}
