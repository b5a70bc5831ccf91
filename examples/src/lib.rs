//! Runnable programs over the public API of the crates; see the `examples` folder of this package. The programs of the
//! project's README are tested from here.

/// The project's README, whose programs are compiled and run as tests of documentation.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
