//! Files: g2o pose graphs.

pub mod g2o;
