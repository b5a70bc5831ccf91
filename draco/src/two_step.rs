//! Two-step distributed pose-graph optimisation.
