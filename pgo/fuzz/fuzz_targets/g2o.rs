#![no_main]
//! Any text gives a graph or an error, and a graph survives writing and reading again.

use draco_pgo::io::g2o::{self, AnyGraph};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let again = match g2o::parse_any(text) {
        Ok(AnyGraph::Two(graph)) => g2o::to_text(&graph),
        Ok(AnyGraph::Three(graph)) => g2o::to_text(&graph),
        Err(_) => return,
    };
    g2o::parse_any(&again.expect("keys read from ids fit ids")).expect("written graphs can be read");
});
