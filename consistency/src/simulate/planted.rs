use rand::{Rng, RngExt};

use super::harbor::{Harbor, KEYFRAMES, Label, Path, SimulatedTeam, far_away, noise, without_closures};
use crate::{Closure, Error, Pose, PoseKey, isotropic_covariance};

/// Parameters of [`planted()`].
#[derive(Debug, Clone, PartialEq)]
pub struct Planted {
    /// True closures; default 60.
    pub good: usize,
    /// Closures that are off by any motion, each for itself; default 20.
    pub random: usize,
    /// Runs of closures to a place that looks like the true one; default 4.
    pub aliased_runs: usize,
    /// Closures of one such run, at consecutive poses; default 5.
    pub run_length: usize,
    /// Odometry noise as a share of (0.12 m, 0.12 m, 0.0136 rad) a step; default 0.3.
    pub odometry: f64,
    /// Registration noise σ, metres and radians; default 0.15 m, 0.01 rad.
    pub noise: (f64, f64),
}

impl Default for Planted {
    fn default() -> Self {
        Self { good: 60, random: 20, aliased_runs: 4, run_length: 5, odometry: 0.3, noise: (0.15, 0.01) }
    }
}

/// Two robots with planted true closures, random outliers, and runs of perceptually aliased ones: what place
/// recognition brings when one corridor looks like another.
///
/// An aliased closure has a right measurement to the wrong pose: the place seen looks as if it was the one `d` poses
/// further on. All closures of a run share `d`, so they agree with each other as far as the two places have the same
/// shape. Groups are the runs; every good and random closure is a group of its own.
///
/// # Errors
/// [`Error::Generator`] for runs longer than a quarter of the path.
///
/// ```
/// use draco_consistency::simulate::{Label, Planted, planted};
/// use nalgebra::Isometry2;
/// use rand::SeedableRng;
///
/// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
/// let team = planted::<3, Isometry2<f64>>(&Planted::default(), &mut rng)?;
/// assert_eq!(team.labels.iter().filter(|l| **l == Label::Aliased).count(), 20);
/// # Ok::<(), draco_consistency::Error>(())
/// ```
pub fn planted<const N: usize, G: Pose<N>>(
    params: &Planted,
    rng: &mut impl Rng,
) -> Result<SimulatedTeam<G, N>, Error> {
    if params.run_length > KEYFRAMES / 4 {
        return Err(Error::Generator { reason: "a run is at most a quarter of the path" });
    }
    let world = Harbor { robots: 2, odometry: params.odometry, ..Harbor::default() };
    let paths: [Path<G, N>; 2] = [Path::draw(&world, rng), Path::draw(&world, rng)];
    let mut team = without_closures(&paths)?;
    let covariance = isotropic_covariance::<N, G>(params.noise.0, params.noise.1);
    let mut add = |k: usize, seen: usize, told: usize, label: Label, group: usize, rng: &mut _| {
        let mut z = paths[1].world[seen].between(&paths[0].world[k]).plus(&noise::<N, G>(params.noise, rng));
        if label == Label::Gross {
            z = z.plus(&far_away::<N>(rng));
        }
        team.closures.push(Closure {
            source: PoseKey::new(0, k),
            target: PoseKey::new(1, told),
            target_from_source: z.renormalize(),
            covariance,
        });
        team.labels.push(label);
        team.groups.push(group);
        if team.biases.len() <= group {
            team.biases.push(paths[1].world[told].between(&paths[1].world[seen]));
        }
    };
    let mut group = 0;
    for (count, label) in [(params.good, Label::Good), (params.random, Label::Gross)] {
        for _ in 0..count {
            let k = rng.random_range(0..KEYFRAMES);
            let i = (nearest(&paths, k) + rng.random_range(0..3)).min(KEYFRAMES - 1);
            add(k, i, i, label, group, rng);
            group += 1;
        }
    }
    for _ in 0..params.aliased_runs {
        let first = rng.random_range(0..=KEYFRAMES - params.run_length);
        let shift = rng.random_range(KEYFRAMES / 6..KEYFRAMES / 2);
        for k in first..first + params.run_length {
            let i = nearest(&paths, k);
            add(k, i, (i + shift) % KEYFRAMES, Label::Aliased, group, rng);
        }
        group += 1;
    }
    Ok(team)
}

/// The pose of the second robot nearest to pose `k` of the first.
fn nearest<const N: usize, G: Pose<N>>(paths: &[Path<G, N>; 2], k: usize) -> usize {
    let place = paths[0].world[k].position();
    let distance = |i: &usize| (paths[1].world[*i].position() - place).norm();
    (0..KEYFRAMES).min_by(|i, j| distance(i).total_cmp(&distance(j))).unwrap_or(0)
}
