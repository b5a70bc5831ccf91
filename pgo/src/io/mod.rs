//! Files: g2o pose graphs of one robot or of a team, TUM and KITTI trajectories.

pub mod g2o;
pub mod kitti;
pub mod team;
mod text;
pub mod tum;
