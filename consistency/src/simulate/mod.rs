//! Seeded teams with labelled closures: correlated groups, shared slips, gross outliers, wrong priors.
//!
//! No public data set tells which closure is an outlier, and none has outliers that agree with each other. These
//! generators do both; every measurement is labelled: [`harbor()`] makes teams with correlated groups, [`planted()`]
//! two robots with random and perceptually aliased closures, [`ranges()`] ranges to a beacon with random ones and
//! echoes. Graphs with a planted near-clique are in [`graph::planted`](crate::graph::planted()).
//!
//! ```
//! use draco_consistency::simulate::{Harbor, harbor};
//! use nalgebra::Isometry2;
//! use rand::SeedableRng;
//!
//! let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
//! let team = harbor::<3, Isometry2<f64>>(&Harbor::default(), &mut rng)?;
//! assert_eq!(team.closures.len(), team.labels.len());
//! # Ok::<(), draco_consistency::Error>(())
//! ```
//!
//! The world of the harbour: every robot drives one closed loop of 180 m (a circle) with its own start, direction and
//! lateral offset, a keyframe each 3 m. Closures come in *groups*: a window of six keyframes of one robot and the
//! window of the other nearest to it. A closure is `Z = Z_true` moved by the bias of its group, then by its own noise
//! in the frame of the observed pose. A biased group is one of
//!
//! * half: a slip by one spacing (1.6 or 6 m) along one axis of the world,
//! * 3 in 10: a translation of 1 to 4 m in any direction,
//! * 2 in 10: a turn, σ 4°, about the scene's centre.
mod harbor;
mod planted;
mod ranges;

pub use harbor::{Bias, Harbor, Label, Meetings, SimulatedTeam, harbor};
pub use planted::{Planted, planted};
pub use ranges::{RangeLabel, RangeProblem, Ranging, ranges};
