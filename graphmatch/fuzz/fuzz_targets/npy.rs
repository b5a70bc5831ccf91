#![no_main]
//! Any bytes give a cost matrix that can be assigned, or an error.

#[path = "../../examples/support/npy.rs"]
mod npy;

use draco_graphmatch::{Costs, assign};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok((rows, columns, values)) = npy::read_npy(bytes) {
        if let Ok(costs) = Costs::new(rows, columns, &values) {
            let _ = assign(costs);
        }
    }
});
