//! Optimisation by several robots that exchange messages.
//!
//! Everything here is pure: functions and state machines without clock, thread or socket, which take messages and
//! return messages that know their size. Start with [`two_step()`] when one robot wants its own map and its
//! neighbours' trajectories in one frame after one exchange, and with [`CondensingAgent`] when all robots
//! together shall reach the optimum a single machine would find: few rounds, large messages. [`Agent`] reaches it by
//! small messages and very many rounds.

mod block_coordinate;
mod condensed;
mod condensing;
mod two_step;

pub use crate::condense::Model;
pub use block_coordinate::{Agent, PoseMessage};
pub use condensed::{Condensed, CondensedFactor};
pub use condensing::{CondensingAgent, ModelMessage, Relative};
pub use two_step::{Link, Neighbour, TwoStepSolution, TwoStepVariant, two_step};
