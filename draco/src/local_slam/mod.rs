//! One robot's own map: odometry, sequential matching, loop closures with PCM.
