use std::fmt;

/// The closures to believe and, for each of the others, why not.
///
/// Indices count the closures as they were given. A closure is in exactly one of the three lists; all are
/// ascending.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Selection {
    /// Closures to insert into the pose graph.
    pub accepted: Vec<usize>,
    /// Closures to leave out, each with its reason.
    pub rejected: Vec<Rejection>,
    /// Closures that the evidence cannot decide; only [`gcm`](crate::gcm()) has any. Leave them out for now.
    pub undecided: Vec<Rejection>,
}

impl Selection {
    /// Whether the closure was accepted.
    pub fn accepts(&self, closure: usize) -> bool {
        self.accepted.binary_search(&closure).is_ok()
    }

    pub(crate) fn sort(&mut self) {
        self.accepted.sort_unstable();
        self.rejected.sort_by_key(|r| r.closure);
        self.undecided.sort_by_key(|r| r.closure);
    }
}

/// One closure that was not accepted, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Rejection {
    /// Its index in the input.
    pub closure: usize,
    /// Why it was left out.
    pub reason: Reason,
}

/// A pair of closures that failed its test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FailedPair {
    /// The accepted closure that disagrees.
    pub with: usize,
    /// Squared Mahalanobis distance of the loop the two close, no unit.
    pub chi2: f64,
    /// Largest value that still passes.
    pub limit: f64,
}

/// Why a closure was not accepted.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// It contradicts accepted closures.
    Inconsistent {
        /// The accepted closures it contradicts.
        failed: Vec<FailedPair>,
    },
    /// The largest consistent set it could belong to is too small to be believed.
    TooFewVotes {
        /// Size of that set, closures (groups for the group posterior).
        size: usize,
        /// Least size accepted.
        minimum: usize,
    },
    /// Not all sets with it and members of the largest set pass.
    OutsideLargestSet {
        /// Size of the largest set.
        size: usize,
    },
    /// The method looks at the closures of one robot only, and this is not one of them.
    NotOfReference {
        /// That robot.
        reference: u32,
    },
    /// The method needs a prior between the two maps and none was given.
    NoMapTransform {
        /// The robot whose map has no place.
        robot: u32,
    },
    /// The loop through its group costs too much.
    GroupCost {
        /// Aggregate of the Mahalanobis distances to the group's members, no unit.
        cost: f64,
        /// Largest cost accepted.
        limit: f64,
    },
    /// It contradicts the measurements of its own place and time.
    OutsideItsGroup {
        /// The group.
        group: usize,
    },
    /// Its group is shifted by a step of a repeating structure.
    Slip {
        /// The group.
        group: usize,
        /// Estimated shift in the reference map, metres.
        offset: [f64; 3],
        /// Other groups with the same shift.
        shared_with: Vec<usize>,
    },
    /// Its group is turned about its own place.
    YawSlip {
        /// The group.
        group: usize,
    },
    /// It does not close the cycle through a third robot.
    ContradictedByCycle {
        /// The group.
        group: usize,
        /// The robots of the cycle.
        cycle: [u32; 3],
        /// Estimated shift in the reference map, metres.
        offset: [f64; 3],
    },
    /// It is far from anything the rest says.
    Gross {
        /// The group.
        group: usize,
    },
    /// The evidence for and against it is about even.
    Ambiguous {
        /// The group.
        group: usize,
        /// Posterior probability that the group is sound.
        probability: f64,
    },
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Inconsistent { failed } => {
                write!(f, "contradicts {} accepted closures", failed.len())?;
                match failed.iter().max_by(|a, b| a.chi2.total_cmp(&b.chi2)) {
                    Some(worst) => {
                        write!(f, ", worst #{} with chi2 {:.1} > {:.1}", worst.with, worst.chi2, worst.limit)
                    }
                    None => Ok(()),
                }
            }
            Self::TooFewVotes { size, minimum } => {
                write!(f, "too few votes: {size} agree, {minimum} are needed")
            }
            Self::OutsideLargestSet { size } => write!(f, "outside the largest consistent set of {size}"),
            Self::NotOfReference { reference } => write!(f, "not a closure of robot {reference}"),
            Self::NoMapTransform { robot } => write!(f, "the map of robot {robot} has no prior place"),
            Self::GroupCost { cost, limit } => write!(f, "group cost {cost:.2} > {limit:.2}"),
            Self::OutsideItsGroup { group } => write!(f, "outside its group {group}"),
            Self::Slip { group, offset: [x, y, z], shared_with } => {
                write!(f, "group {group} slipped by ({x:.2}, {y:.2}, {z:.2}) m")?;
                if shared_with.is_empty() { Ok(()) } else { write!(f, " shared with groups {shared_with:?}") }
            }
            Self::YawSlip { group } => write!(f, "group {group} is turned about its place"),
            Self::ContradictedByCycle { group, cycle: [a, b, c], offset: [x, y, z] } => write!(
                f,
                "group {group} contradicted by cycle {a}-{b}-{c}, off by ({x:.2}, {y:.2}, {z:.2}) m"
            ),
            Self::Gross { group } => write!(f, "group {group} is a gross outlier"),
            Self::Ambiguous { group, probability } => {
                write!(f, "group {group} is undecided, probability {probability:.2}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_tell_numbers() {
        let failed = vec![
            FailedPair { with: 3, chi2: 20.0, limit: 11.3 },
            FailedPair { with: 5, chi2: 40.0, limit: 11.3 },
        ];
        let text = Reason::Inconsistent { failed }.to_string();
        assert_eq!(text, "contradicts 2 accepted closures, worst #5 with chi2 40.0 > 11.3");
    }
}
