#![no_main]
//! Any text gives a trajectory or an error, and a trajectory survives writing and reading again.

use draco_pgo::io::{kitti, tum};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(trajectory) = tum::parse(text) {
        let again = tum::parse(&tum::to_text(&trajectory)).expect("written trajectories can be read");
        assert_eq!(again, trajectory);
    }
    if let Ok(trajectory) = kitti::parse(text) {
        let again = kitti::parse(&kitti::to_text(&trajectory)).expect("written trajectories can be read");
        assert_eq!(again.len(), trajectory.len());
    }
});
