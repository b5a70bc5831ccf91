use nalgebra::Isometry3;

use crate::Error;

/// How far apart the poses of a relative error lie.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Delta {
    /// A number of poses.
    Frames(usize),
    /// A length of path, in metres.
    Metres(f64),
    /// An angle, in radians, at most π: turned in total along the path with [`Pairs::Consecutive`], between the two
    /// poses with [`Pairs::All`].
    Radians(f64),
}

/// Which poses a relative error pairs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Pairs {
    /// Pairs one after the other: each begins where the last one ended, as soon as the distance is reached.
    #[default]
    Consecutive,
    /// From every pose, to the pose whose distance is nearest to the one asked for (a path), or to all (an angle),
    /// when it is off by at most this fraction.
    All {
        /// Largest deviation from the distance, as a fraction of it.
        tolerance: f64,
    },
}

/// The pairs of positions, checked to be at least one.
pub(super) fn pairs(
    poses: &[Isometry3<f64>],
    delta: Delta,
    which: Pairs,
) -> Result<Vec<(usize, usize)>, Error> {
    check(delta, which)?;
    let found = match (delta, which) {
        (Delta::Frames(delta), Pairs::Consecutive) => {
            (delta..poses.len()).step_by(delta).map(|j| (j - delta, j)).collect()
        }
        (Delta::Frames(delta), Pairs::All { .. }) => (delta..poses.len()).map(|j| (j - delta, j)).collect(),
        (Delta::Metres(delta), Pairs::Consecutive) => consecutive(poses, delta, distance),
        (Delta::Radians(delta), Pairs::Consecutive) => consecutive(poses, delta, angle),
        (Delta::Metres(delta), Pairs::All { tolerance }) => all_by_path(poses, delta, delta * tolerance),
        (Delta::Radians(delta), Pairs::All { tolerance }) => all_by_angle(poses, delta, delta * tolerance),
    };
    if found.is_empty() { Err(Error::NoPairs { delta: value(delta) }) } else { Ok(found) }
}

fn value(delta: Delta) -> f64 {
    match delta {
        Delta::Frames(frames) => frames as f64,
        Delta::Metres(x) | Delta::Radians(x) => x,
    }
}

fn check(delta: Delta, which: Pairs) -> Result<(), Error> {
    let limit = if matches!(delta, Delta::Radians(_)) { std::f64::consts::PI } else { f64::MAX };
    let least = if matches!(delta, Delta::Frames(_)) { 1.0 } else { 0.0 };
    let x = value(delta);
    if !(least..=limit).contains(&x) {
        return Err(Error::Parameter { name: "delta", value: x });
    }
    match which {
        Pairs::All { tolerance } if !(0.0..f64::INFINITY).contains(&tolerance) => {
            Err(Error::Parameter { name: "tolerance", value: tolerance })
        }
        _ => Ok(()),
    }
}

fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (a.translation.vector - b.translation.vector).norm()
}

pub(super) fn angle(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    a.rotation.angle_to(&b.rotation)
}

fn consecutive(
    poses: &[Isometry3<f64>],
    delta: f64,
    step: impl Fn(&Isometry3<f64>, &Isometry3<f64>) -> f64,
) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let (mut begin, mut path) = (0, 0.0);
    for (i, pair) in poses.windows(2).enumerate() {
        path += step(&pair[0], &pair[1]);
        if path >= delta {
            found.push((begin, i + 1));
            (begin, path) = (i + 1, 0.0);
        }
    }
    found
}

fn all_by_path(poses: &[Isometry3<f64>], delta: f64, tolerance: f64) -> Vec<(usize, usize)> {
    let mut along = Vec::with_capacity(poses.len());
    let mut path = 0.0;
    along.push(path);
    for pair in poses.windows(2) {
        path += distance(&pair[0], &pair[1]);
        along.push(path);
    }
    let mut found = Vec::new();
    for i in 0..poses.len().saturating_sub(1) {
        let off = |j: usize| (along[j] - along[i] - delta).abs();
        // paths only grow: the nearest is next to where the distance is passed, the first of equals
        let passed =
            (i + 1 + along[i + 1..].partition_point(|at| at - along[i] < delta)).min(poses.len() - 1);
        let mut best = if passed > i + 1 && off(passed - 1) <= off(passed) { passed - 1 } else { passed };
        while best > i + 1 && off(best - 1) <= off(best) {
            best -= 1;
        }
        if off(best) <= tolerance {
            found.push((i, best));
        }
    }
    found
}

fn all_by_angle(poses: &[Isometry3<f64>], delta: f64, tolerance: f64) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    for (i, a) in poses.iter().enumerate() {
        for (j, b) in poses.iter().enumerate().skip(i + 1) {
            if (delta - tolerance..=delta + tolerance).contains(&angle(a, b)) {
                found.push((i, j));
            }
        }
    }
    found
}
