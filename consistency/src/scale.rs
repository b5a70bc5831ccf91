use crate::pair_test::gate;
use crate::pcm::by_robots;
use crate::{Closure, Error, PairTest, Pose, Trajectories};

/// By which factor the covariances understate the scatter of closures of one place and time: the χ² below which
/// `probability` of their pairs lie, over the χ² that it should be. Between 1 and 9.
///
/// Two closures at most six poses apart on both robots see the same place, so that their scatter is noise alone, also
/// where the place is the wrong one. The tail counts, not the median: public place-recognition sets have honest medians
/// and errors of many σ. Pairs beyond nine times the limit are outliers and left out; with fewer than 30 pairs the
/// answer is 1.
///
/// Use it as `scale` of [`PcmParams`](crate::PcmParams) or [`CycleParams`](crate::CycleParams).
///
/// # Errors
/// Unknown poses, poses that are not finite, covariances that are not positive definite, a bad probability.
pub fn covariance_scale<const N: usize, G: Pose<N>>(
    trajectories: &Trajectories<G, N>,
    closures: &[Closure<G, N>],
    probability: f64,
) -> Result<f64, Error> {
    const NEAR: usize = 6;
    const FEWEST_PAIRS: usize = 30;
    const MOST: f64 = 9.0;
    let limit = gate::<N>(probability)?;
    let mut found = Vec::new();
    for members in by_robots(trajectories, closures)?.values() {
        let first = closures[members[0]].robots().0;
        let own: Vec<_> = members.iter().map(|&m| closures[m].with_source_robot(first)).collect();
        let test = PairTest::new(trajectories, &own, probability)?;
        let is_near = |a: usize, b: usize| {
            own[a].source.index.abs_diff(own[b].source.index) <= NEAR
                && own[a].target.index.abs_diff(own[b].target.index) <= NEAR
        };
        for a in 0..own.len() {
            let others = (a + 1..own.len()).filter(|&b| is_near(a, b)).map(|b| test.chi2(a, b));
            found.extend(others.filter(|chi2| *chi2 < MOST * limit));
        }
    }
    if found.len() < FEWEST_PAIRS {
        return Ok(1.0);
    }
    let rank = ((probability * found.len() as f64).ceil() as usize).clamp(1, found.len());
    let quantile = *found.select_nth_unstable_by(rank - 1, f64::total_cmp).1;
    Ok((quantile / limit).clamp(1.0, MOST))
}
