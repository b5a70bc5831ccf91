//! What robots say to each other, to the byte.
