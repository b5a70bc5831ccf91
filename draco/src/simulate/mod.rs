//! Simulated missions: worlds, paths, odometry and sonar scans, from one seed.
