//! Objects of a map: density clusters with their rectangles, and persistent cells.
