//! The program `draco`.

fn main() {}
