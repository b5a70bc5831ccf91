//! Many robots over a link, step by step.
