use super::evidence::{Explanation, matches, ties, weigh};
use super::problem::Problem;
use crate::rigid::fit_rigid;

/// Leaves out pairs, one at a time, as long as the evidence grows: a wrong pair within the gate bends the fit, and a right one may
/// be lost to it.
pub(super) fn polish(problem: &Problem, mut found: Explanation) -> Explanation {
    while let Some(other) = without_one(problem, &found) {
        if other.log_evidence <= found.log_evidence {
            break;
        }
        found = other;
    }
    found
}

/// The best explanation by all pairs but one, or by what these bring together.
fn without_one(problem: &Problem, found: &Explanation) -> Option<Explanation> {
    let fewest = problem.fewest_pairs();
    let mut best: Option<Explanation> = None;
    for k in worst_pairs(problem, found) {
        let mut left = found.pairs.clone();
        left.remove(k);
        let transform = fit_rigid(&ties(problem, &left));
        let again = matches(problem, &transform, problem.params.gate);
        let rematched = (again.len() >= fewest && again != found.pairs)
            .then(|| weigh(problem, fit_rigid(&ties(problem, &again)), again));
        let left = (left.len() >= fewest).then(|| weigh(problem, transform, left));
        for other in [left, rematched].into_iter().flatten().flatten() {
            if best.as_ref().is_none_or(|best| other.log_evidence > best.log_evidence) {
                best = Some(other);
            }
        }
    }
    best
}

/// Pairs of which one may be wrong: those farthest apart, at most [`SUSPECTS`].
fn worst_pairs(problem: &Problem, found: &Explanation) -> Vec<usize> {
    let chi2 = |k: usize| {
        let (i, a) = found.pairs[k];
        (problem.p1[i] - found.map1_from_map2 * problem.p2[a]).norm_squared() / problem.variance(i, a)
    };
    let mut order: Vec<(f64, usize)> = (0..found.pairs.len()).map(|k| (chi2(k), k)).collect();
    order.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
    order.into_iter().take(SUSPECTS).map(|(_, k)| k).collect()
}

/// All pairs of a small explanation: in a fit to four or five, the wrong one need not be the farthest apart.
const SUSPECTS: usize = 6;
