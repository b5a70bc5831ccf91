//! Candidate loop closures between robots and their registration.
