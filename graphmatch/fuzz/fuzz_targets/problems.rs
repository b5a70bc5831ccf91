#![no_main]
//! Any text gives problems that get an answer, or an error.

#[path = "../../examples/support/mod.rs"]
mod support;

use draco_graphmatch::{Method, match_objects};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(problems) = support::Problem::parse_all(text) else { return };
    for p in problems.iter().filter(|p| p.map1.len().max(p.map2.len()) <= 20) {
        let (map1, map2) = (support::Problem::objects(&p.map1), support::Problem::objects(&p.map2));
        if let Ok(found) = match_objects(&map1, &map2, &Method::default()) {
            p.score(&found.pairs, found.map1_from_map2.as_ref().map(|t| t.mean()));
        }
    }
});
