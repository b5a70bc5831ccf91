use super::association::Pair;

/// Which of the matcher's pairs take part. Each rejector judges all pairs the matcher found; a pair must pass
/// every rejector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rejector {
    /// Keeps pairs not farther apart than `max` metres.
    Distance {
        /// Largest distance, metres.
        max: f64,
    },
    /// Keeps the pairs up to the `keep` quantile of the distance.
    Trimmed {
        /// Share kept, in (0, 1].
        keep: f64,
    },
    /// Trims where `d²(f) / f^lambda` is smallest over the shares `f` in `min_keep..=max_keep` (Phillips, Liu,
    /// Tomasi, "Outlier robust ICP for minimizing fractional RMSD", 2007).
    VariableTrimmed {
        /// Smallest share kept, in (0, 1].
        min_keep: f64,
        /// Largest share kept, in (0, 1].
        max_keep: f64,
        /// Reward for keeping more; 0.95 to 3 is usual.
        lambda: f64,
    },
    /// Keeps pairs whose normals differ by at most `max_angle` radians. Needs normals on both clouds that point
    /// the same way (to the sensor).
    NormalAngle {
        /// Largest angle, radians.
        max_angle: f64,
    },
}

/// The squared distance up to which the trimming rejectors keep pairs.
pub(crate) fn trim_limit_sq(rejectors: &[Rejector], pairs: &[Pair], buffer: &mut Vec<f64>) -> f64 {
    let mut limit = f64::INFINITY;
    for rejector in rejectors {
        limit = limit.min(match *rejector {
            Rejector::Distance { max } => max * max,
            Rejector::NormalAngle { .. } => f64::INFINITY,
            Rejector::Trimmed { keep } => {
                fill(buffer, pairs);
                if buffer.is_empty() {
                    continue;
                }
                let rank = ((buffer.len() as f64 * keep) as usize).min(buffer.len() - 1);
                *buffer.select_nth_unstable_by(rank, f64::total_cmp).1
            }
            Rejector::VariableTrimmed { min_keep, max_keep, lambda } => {
                fill(buffer, pairs);
                buffer.sort_unstable_by(f64::total_cmp);
                variable_limit(buffer, min_keep, max_keep, lambda)
            }
        });
    }
    limit
}

fn fill(buffer: &mut Vec<f64>, pairs: &[Pair]) {
    buffer.clear();
    buffer.extend(pairs.iter().map(|p| p.distance_sq));
}

fn variable_limit(sorted: &[f64], min_keep: f64, max_keep: f64, lambda: f64) -> f64 {
    let n = sorted.len();
    let (low, high) = ((min_keep * n as f64) as usize, ((max_keep * n as f64) as usize).min(n));
    let (mut sum, mut best, mut limit) = (0.0, f64::INFINITY, f64::INFINITY);
    for (rank, distance_sq) in sorted.iter().enumerate().take(high) {
        sum += distance_sq;
        if rank + 1 >= low.max(1) {
            let share = (rank + 1) as f64 / n as f64;
            let fractional = sum / (rank + 1) as f64 / share.powf(2.0 * lambda);
            if fractional < best {
                (best, limit) = (fractional, *distance_sq);
            }
        }
    }
    limit
}
