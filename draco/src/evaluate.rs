//! Estimates against truth: ATE, precision, recall.
