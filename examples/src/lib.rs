//! Runnable programs over the public API of the crates; see the `examples` folder of this package.
