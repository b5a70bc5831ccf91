//! Where a scan lies.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

pub mod correlative;
mod error;

pub use error::Error;
