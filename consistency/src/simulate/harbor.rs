use std::f64::consts::{PI, TAU};

use nalgebra::SVector;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

use crate::pose::transported;
use crate::{Closure, Error, MapTransform, Pose, PoseKey, Trajectories, Trajectory, isotropic_covariance};

/// What is true of a generated closure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Label {
    /// Only its own noise and the group's harmless bias.
    Good,
    /// Its whole group is off.
    Biased,
    /// Its group is off by less than 0.75 m or 2.5°: neither good nor bad.
    Slight,
    /// A lone gross outlier.
    Gross,
    /// Of a place that looks like the true one, see [`planted`](crate::simulate::planted()).
    Aliased,
}

/// A generated team.
#[derive(Debug, Clone)]
pub struct SimulatedTeam<G, const N: usize> {
    /// What the robots believe of their own paths.
    pub trajectories: Trajectories<G, N>,
    /// The measured closures.
    pub closures: Vec<Closure<G, N>>,
    /// The truth about each closure.
    pub labels: Vec<Label>,
    /// The generated group of each closure.
    pub groups: Vec<usize>,
    /// The motion that each group's registrations are off by, about the scene's centre, axes of the world.
    pub biases: Vec<G>,
    /// Prior place of each neighbour's map in robot 0's.
    pub priors: Vec<MapTransform<G, N>>,
    /// True place of each robot's map in robot 0's.
    pub reference_from_robot: Vec<G>,
}

/// How a biased group is biased.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bias {
    /// The mixture told in the [module](crate::simulate) docs.
    Mixed,
    /// Always a translation of this length, metres, in a direction drawn for each group.
    Translation(f64),
    /// The same lattice step, drawn once, for every biased group of the team.
    SharedSlip,
    /// The error of the prior: the registration started from it and stayed there.
    FollowsPrior,
}

/// The groups of closures between two robots.
#[derive(Debug, Clone, PartialEq)]
pub struct Meetings {
    /// First robot.
    pub first: u32,
    /// Second robot.
    pub second: u32,
    /// Each group's number of closures and whether it is biased; `None` draws both.
    pub groups: Vec<Option<(usize, bool)>>,
}

/// Parameters of [`harbor`].
#[derive(Debug, Clone, PartialEq)]
pub struct Harbor {
    /// Number of robots; robot 0 is the reference.
    pub robots: u32,
    /// Which robots meet, and how often.
    pub meetings: Vec<Meetings>,
    /// Odometry noise as a share of (0.12 m, 0.12 m, 0.0136 rad) a step; 0.3 is a loop-closed local map.
    pub odometry: f64,
    /// Constant yaw-rate bias of each robot, σ in rad a keyframe before the share `odometry`; not in the covariance.
    pub yaw_rate_bias: f64,
    /// True odometry noise over what the trajectories tell, on top of `understated`; 1 is honest.
    pub drift_understated: f64,
    /// σ of one turn at one random step of each robot, rad; not in the covariance: a bent map.
    pub bend: f64,
    /// σ of the priors' translation error, metres; rotation has σ/20 rad about the loop's centre.
    pub prior_sigma: f64,
    /// Share of groups that are biased.
    pub biased_share: f64,
    /// How they are biased.
    pub bias: Bias,
    /// Share of closures that are gross outliers.
    pub gross_share: f64,
    /// Fewest and most closures of a drawn group.
    pub group_size: (usize, usize),
    /// Keyframes left out in the middle of each group's window, of both robots: a place that is seen in two parts.
    pub pause: usize,
    /// Registration noise σ, metres and radians.
    pub noise: (f64, f64),
    /// True noise of registration and odometry over what the covariances tell; 1 is honest.
    pub understated: f64,
}

impl Default for Harbor {
    /// Three robots; robot 0 meets both others in four groups each and they meet each other in three.
    fn default() -> Self {
        Self {
            robots: 3,
            meetings: vec![
                Meetings { first: 0, second: 1, groups: vec![None; 4] },
                Meetings { first: 0, second: 2, groups: vec![None; 4] },
                Meetings { first: 1, second: 2, groups: vec![None; 3] },
            ],
            odometry: 0.3,
            yaw_rate_bias: 0.0,
            drift_understated: 1.0,
            bend: 0.0,
            prior_sigma: 0.3,
            biased_share: 0.3,
            bias: Bias::Mixed,
            gross_share: 0.05,
            group_size: (3, 12),
            pause: 0,
            noise: (0.15, 0.01),
            understated: 1.0,
        }
    }
}

impl Harbor {
    /// A star: robot 0 meets each of `neighbors` others in `groups` groups; with `cycles`, every two neighbours
    /// also meet in one fewer.
    pub fn star(neighbors: u32, groups: usize) -> Self {
        let meetings =
            (1..=neighbors).map(|second| Meetings { first: 0, second, groups: vec![None; groups] }).collect();
        Self { robots: neighbors + 1, meetings, ..Self::default() }
    }

    /// Where closures outvote groups: to robot 1 three good closures in one group and six of a group 2 m off, eight
    /// good ones to robot 2, drift a tenth of the nominal, priors of `prior_sigma`. One vote stands against one, the
    /// prior is the only judge.
    pub fn fixed_regression(prior_sigma: f64) -> Self {
        let group = |n, biased| Some((n, biased));
        Self {
            meetings: vec![
                Meetings { first: 0, second: 1, groups: vec![group(3, false), group(6, true)] },
                Meetings { first: 0, second: 2, groups: vec![group(8, false)] },
            ],
            odometry: 0.1,
            prior_sigma,
            bias: Bias::Translation(2.0),
            gross_share: 0.0,
            ..Self::default()
        }
    }

    /// A majority of votes that is wrong: to robot 1 one good group and two biased ones, two good ones to robot 2, six
    /// closures each.
    pub fn majority(bias: Bias, prior_sigma: f64) -> Self {
        let group = |biased| Some((6, biased));
        Self {
            meetings: vec![
                Meetings { first: 0, second: 1, groups: vec![group(false), group(true), group(true)] },
                Meetings { first: 0, second: 2, groups: vec![group(false); 2] },
            ],
            prior_sigma,
            bias,
            gross_share: 0.0,
            ..Self::default()
        }
    }

    /// Adds `groups` groups between every two neighbours of robot 0, closing three-robot cycles.
    #[must_use]
    pub fn with_cycles(mut self, groups: usize) -> Self {
        for first in 1..self.robots {
            for second in first + 1..self.robots {
                self.meetings.push(Meetings { first, second, groups: vec![None; groups] });
            }
        }
        self
    }
}

pub(super) const KEYFRAMES: usize = 60;
const LOOP_LENGTH: f64 = 180.0;
const WINDOW: usize = 6;
const LATERAL_OFFSET: f64 = 2.0;
const STEP_SIGMA: (f64, f64) = (0.12, 0.0136);

/// A team on a closed loop with groups of correlated closures, see the [module](crate::simulate) docs.
///
/// # Errors
/// [`Error::Generator`] for a meeting of unknown robots or of more groups than there are windows.
pub fn harbor<const N: usize, G: Pose<N>>(
    params: &Harbor,
    rng: &mut impl Rng,
) -> Result<SimulatedTeam<G, N>, Error> {
    let paths: Vec<Path<G, N>> = (0..params.robots).map(|_| Path::draw(params, rng)).collect();
    let mut team = without_closures(&paths)?;
    let prior_errors = draw_priors(params, &paths, &mut team, rng);
    let shared_step = lattice_step(rng);
    for meetings in &params.meetings {
        let (first, second) = (meetings.first as usize, meetings.second as usize);
        if first >= paths.len() || second >= paths.len() || first == second {
            return Err(Error::Generator { reason: "a meeting names a robot that does not exist" });
        }
        if meetings.groups.len() > KEYFRAMES / WINDOW {
            return Err(Error::Generator { reason: "a robot pair meets in at most ten groups" });
        }
        if params.pause > KEYFRAMES / 2 {
            return Err(Error::Generator { reason: "a pause is at most half of the keyframes" });
        }
        let windows = distinct(KEYFRAMES / WINDOW, meetings.groups.len(), rng);
        for (fixed, window) in meetings.groups.iter().zip(windows) {
            let group = Group {
                first: meetings.first,
                second: meetings.second,
                window: window * WINDOW,
                fixed: *fixed,
                shared_step,
            };
            group.draw(params, &paths, &prior_errors, &mut team, rng);
        }
    }
    Ok(team)
}

/// A team that has driven its paths and closed no loops yet.
pub(super) fn without_closures<const N: usize, G: Pose<N>>(
    paths: &[Path<G, N>],
) -> Result<SimulatedTeam<G, N>, Error> {
    let mut trajectories = Trajectories::new();
    for (robot, path) in (0..).zip(paths) {
        trajectories.insert(robot, path.trajectory()?);
    }
    Ok(SimulatedTeam {
        trajectories,
        closures: Vec::new(),
        labels: Vec::new(),
        groups: Vec::new(),
        biases: Vec::new(),
        priors: Vec::new(),
        reference_from_robot: paths.iter().map(|p| paths[0].world[0].between(&p.world[0])).collect(),
    })
}

/// `n` standard normals scaled by the two sigmas.
pub(super) fn noise<const N: usize, G: Pose<N>>(
    (translation, rotation): (f64, f64),
    rng: &mut impl Rng,
) -> SVector<f64, N> {
    SVector::from_fn(|row, _| {
        let z: f64 = StandardNormal.sample(rng);
        z * if row < G::TRANSLATION { translation } else { rotation }
    })
}

fn translation<const N: usize, G: Pose<N>>(x: f64, y: f64) -> G {
    G::planar(x, y, 0.0)
}

/// `count` different numbers below `n`.
fn distinct(n: usize, count: usize, rng: &mut impl Rng) -> Vec<usize> {
    let mut all: Vec<usize> = (0..n).collect();
    for at in 0..count.min(n) {
        let other = rng.random_range(at..n);
        all.swap(at, other);
    }
    all.truncate(count);
    all
}

/// One robot's true and believed path.
pub(super) struct Path<G, const N: usize> {
    pub(super) world: Vec<G>,
    believed: Vec<G>,
    step_sigma: (f64, f64),
}

impl<G: Pose<N>, const N: usize> Path<G, N> {
    pub(super) fn draw(params: &Harbor, rng: &mut impl Rng) -> Self {
        let start = rng.random_range(0.0..TAU);
        let direction = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let radius = LOOP_LENGTH / TAU + rng.random_range(-LATERAL_OFFSET..LATERAL_OFFSET);
        let world: Vec<G> = (0..KEYFRAMES)
            .map(|k| {
                let angle = start + direction * TAU * k as f64 / KEYFRAMES as f64;
                G::planar(radius * angle.cos(), radius * angle.sin(), angle + direction * PI / 2.0)
            })
            .collect();
        let step_sigma = (STEP_SIGMA.0 * params.odometry, STEP_SIGMA.1 * params.odometry);
        let factor = params.understated * params.drift_understated;
        let honest = (step_sigma.0 * factor, step_sigma.1 * factor);
        let z: f64 = StandardNormal.sample(rng);
        let turn = G::planar(0.0, 0.0, z * params.yaw_rate_bias * params.odometry);
        let bent = (params.bend > 0.0).then(|| {
            let z: f64 = StandardNormal.sample(rng);
            (rng.random_range(0..KEYFRAMES - 1), G::planar(0.0, 0.0, z * params.bend))
        });
        let mut believed = vec![G::identity()];
        for (k, pair) in world.windows(2).enumerate() {
            let mut step = pair[0].between(&pair[1]).compose(&turn).plus(&noise::<N, G>(honest, rng));
            if let Some((_, bend)) = bent.filter(|(at, _)| *at == k) {
                step = step.compose(&bend);
            }
            believed.push(believed[believed.len() - 1].compose(&step).renormalize());
        }
        Self { world, believed, step_sigma }
    }

    pub(super) fn trajectory(&self) -> Result<Trajectory<G, N>, Error> {
        // a noise-free path still needs a covariance that can be factored
        let sigma = (self.step_sigma.0.max(1e-6), self.step_sigma.1.max(1e-7));
        let q = isotropic_covariance::<N, G>(sigma.0, sigma.1);
        Trajectory::from_steps(self.believed.clone(), &vec![q; self.believed.len() - 1])
    }
}

/// Draws each neighbour's prior and returns its error as a motion of the world.
fn draw_priors<const N: usize, G: Pose<N>>(
    params: &Harbor,
    paths: &[Path<G, N>],
    team: &mut SimulatedTeam<G, N>,
    rng: &mut impl Rng,
) -> Vec<G> {
    let sigma = (params.prior_sigma, params.prior_sigma / 20.0);
    let mut errors = vec![G::identity()];
    for robot in 1..params.robots {
        let error = G::exp(&noise::<N, G>(sigma, rng));
        let start = &paths[robot as usize].world[0];
        // the loop's centre is the world's origin: the error acts there, on the left of the world pose
        let world_from_map = error.compose(start);
        let covariance = isotropic_covariance::<N, G>(sigma.0, sigma.1);
        team.priors.push(MapTransform {
            source: robot,
            target: 0,
            target_from_source: paths[0].world[0].between(&world_from_map),
            covariance: transported(&start.inverse().adjoint(), &covariance),
        });
        errors.push(error);
    }
    errors
}

/// One meeting of two robots: a window of keyframes each.
struct Group {
    first: u32,
    second: u32,
    window: usize,
    fixed: Option<(usize, bool)>,
    shared_step: (f64, f64),
}

impl Group {
    fn draw<const N: usize, G: Pose<N>>(
        &self,
        params: &Harbor,
        paths: &[Path<G, N>],
        prior_errors: &[G],
        team: &mut SimulatedTeam<G, N>,
        rng: &mut impl Rng,
    ) {
        let (a, b) = (&paths[self.first as usize], &paths[self.second as usize]);
        let id = team.biases.len();
        let latest = KEYFRAMES - WINDOW - params.pause;
        let window = self.window.min(latest);
        let other = nearest_window(&a.world, window, &b.world).min(latest);
        let scene = a.world[window + WINDOW / 2].position();
        let (size, biased) = self.fixed.unwrap_or_else(|| {
            let size = rng.random_range(params.group_size.0..=params.group_size.1);
            (size, rng.random_bool(params.biased_share))
        });
        let (motion, label) = if biased {
            self.bias(params, &prior_errors[self.second as usize], rng)
        } else {
            (G::exp(&noise::<N, G>((0.1, 0.005), rng)), Label::Good)
        };
        let centre = translation::<N, G>(scene[0], scene[1]);
        let world_motion = match params.bias {
            Bias::FollowsPrior if biased => motion,
            _ => centre.compose(&motion).compose(&centre.inverse()),
        };
        team.biases.push(motion);
        let told = isotropic_covariance::<N, G>(params.noise.0, params.noise.1);
        let placed = |at: usize| at + if at < WINDOW / 2 { 0 } else { params.pause };
        for pair in distinct(WINDOW * WINDOW, size, rng) {
            let (k, i) = (window + placed(pair / WINDOW), other + placed(pair % WINDOW));
            let gross = rng.random_bool(params.gross_share);
            let own = (params.noise.0 * params.understated, params.noise.1 * params.understated);
            // C · T_ab · X_bi is where the registration puts b's keyframe, seen from a's
            let b_shifted = world_motion.compose(&b.world[i]);
            let mut z = b_shifted.between(&a.world[k]).plus(&noise::<N, G>(own, rng));
            if gross {
                z = z.plus(&far_away::<N>(rng));
            }
            team.closures.push(Closure {
                source: PoseKey::new(self.first, k),
                target: PoseKey::new(self.second, i),
                target_from_source: z.renormalize(),
                covariance: told,
            });
            team.labels.push(if gross { Label::Gross } else { label });
            team.groups.push(id);
        }
    }

    /// The motion of a biased group about its scene's centre and how it counts.
    fn bias<const N: usize, G: Pose<N>>(
        &self,
        params: &Harbor,
        prior_error: &G,
        rng: &mut impl Rng,
    ) -> (G, Label) {
        let along =
            |heading: f64, length: f64| translation::<N, G>(length * heading.cos(), length * heading.sin());
        let grade = |size: f64, least: f64| if size.abs() < least { Label::Slight } else { Label::Biased };
        match params.bias {
            Bias::Translation(length) => (along(rng.random_range(-PI..PI), length), grade(length, 0.75)),
            Bias::SharedSlip => (along(self.shared_step.0, self.shared_step.1), Label::Biased),
            Bias::FollowsPrior => {
                let size = prior_error.log().rows(0, G::TRANSLATION).norm();
                (*prior_error, grade(size, 0.75))
            }
            Bias::Mixed => {
                let kind: f64 = rng.random();
                if kind < 0.5 {
                    let (heading, length) = lattice_step(rng);
                    (along(heading, length), Label::Biased)
                } else if kind < 0.8 {
                    (along(rng.random_range(-PI..PI), rng.random_range(1.0..4.0)), Label::Biased)
                } else {
                    let z: f64 = StandardNormal.sample(rng);
                    let yaw = z * 4f64.to_radians();
                    (G::planar(0.0, 0.0, yaw), grade(yaw, 2.5f64.to_radians()))
                }
            }
        }
    }
}

/// One spacing of the piles along one axis of the world: heading and length.
fn lattice_step(rng: &mut impl Rng) -> (f64, f64) {
    let spacing = if rng.random_bool(0.5) { 1.6 } else { 6.0 };
    (f64::from(rng.random_range(0..4u8)) * PI / 2.0, spacing)
}

/// A gross error: up to 10 m on each horizontal axis and up to 0.8 rad, uniform.
pub(super) fn far_away<const N: usize>(rng: &mut impl Rng) -> SVector<f64, N> {
    let mut xi = SVector::zeros();
    xi[0] = rng.random_range(-10.0..10.0);
    xi[1] = rng.random_range(-10.0..10.0);
    xi[N - 1] = rng.random_range(-0.8..0.8);
    xi
}

/// First keyframe of the window of `other` whose middle is nearest to the middle of `path`'s window.
fn nearest_window<const N: usize, G: Pose<N>>(path: &[G], window: usize, other: &[G]) -> usize {
    let middle = path[window + WINDOW / 2].position();
    let distance = |i: &usize| (other[*i].position() - middle).norm();
    let nearest = (0..other.len()).min_by(|i, j| distance(i).total_cmp(&distance(j))).unwrap_or(0);
    nearest.saturating_sub(WINDOW / 2).min(other.len() - WINDOW)
}
