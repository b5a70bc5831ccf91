#![no_main]
//! Any text gives a problem that can be costed, or an error.

use draco_graphmatch::Qap;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(problem) = Qap::from_qaplib(text) {
        let image: Vec<usize> = (0..problem.size()).collect();
        assert!(problem.cost(&image).is_some());
    }
});
