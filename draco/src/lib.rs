#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! Data flows one way through the modules, in the order they are listed here.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod error;
pub mod keyframe;

pub mod dataset;
pub mod simulate;
pub mod sonar;

pub mod local_slam;
mod matching;
pub mod objects;
mod placement;
pub mod robot_graph;

pub mod link;
pub mod message;
pub mod transport;

pub mod alignment;
pub mod closure;
pub mod consistency;
pub mod draco1;
pub mod two_step;

pub mod mission;
pub mod network;
mod pilot;
pub mod robot;
pub mod unit;

pub mod evaluate;
pub mod report;

pub mod experiment;
pub mod state;

pub use error::{ChaosFailure, Error};
