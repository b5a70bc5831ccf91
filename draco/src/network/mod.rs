//! Robots in processes of their own, step by step together.
//!
//! A [`Robot`](crate::robot::Robot) knows neither time nor network, and its bits depend on what it hears in which step.
//! So the packets of a robot travel in [`Envelope`]s that say in which step they were sent, and after each step a robot
//! says that it is over and how many packets there were. [`LockStep`] waits for that from every robot of the team and
//! hands over the packets of the step in order of sender and of sending, whatever order they came in: the same as
//! [`link::Direct`](crate::link::Direct) does in one process, so the mission ends with the same bits.
//!
//! A robot that does not end a step in time is no longer waited for, which is told; it may come back. Then the mission
//! goes on as over any poor link, and what was missed is repaired by the [`transport`](crate::transport). A robot that is
//! killed and started again in time with its state file asks for what it missed and changes nothing.
//!
//! Start with [`fly`]. [`Network`] is what carries envelopes: [`Udp`] everywhere, `Zenoh` with the feature `zenoh`.

mod envelope;
mod fly;
mod lock_step;
mod udp;
#[cfg(feature = "zenoh")]
mod zenoh;

use std::time::Duration;

#[cfg(feature = "zenoh")]
pub use self::zenoh::Zenoh;
pub use envelope::{Envelope, Stage};
pub use fly::{FlightParams, fly};
pub use lock_step::{Heard, LockStep, Patience};
pub use udp::Udp;

use crate::error::Error;

/// Carries bytes from one process to all others of the team. May lose them, repeat them and mix up their order.
pub trait Network {
    /// Sends `bytes` to everyone else.
    ///
    /// # Errors
    /// [`Error::Network`] when the network cannot be used any more; not when somebody is not there.
    fn send(&mut self, bytes: &[u8]) -> Result<(), Error>;

    /// The next bytes heard; waits for them for `patience` at most.
    fn receive(&mut self, patience: Duration) -> Option<Vec<u8>>;
}
