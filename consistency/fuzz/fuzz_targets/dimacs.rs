#![no_main]
//! Any text gives a sound graph or an error with a line of the text.

use draco_consistency::Error;
use draco_consistency::graph::{Adjacency, dimacs};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| match dimacs(text) {
    Ok(graph) => (0..graph.len()).for_each(|v| {
        assert!(graph.neighbors(v).all(|u| u != v && graph.has_edge(u, v)));
    }),
    Err(Error::Parse { line, .. }) => assert!(line <= text.lines().count().max(1)),
    Err(other) => panic!("{other}"),
});
