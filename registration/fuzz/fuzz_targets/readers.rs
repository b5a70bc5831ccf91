#![no_main]

use draco_registration::io::{parse_columns, parse_pcd, parse_ply, parse_vtk};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let results = [parse_columns::<2>(bytes), parse_ply(bytes), parse_pcd(bytes), parse_vtk(bytes)];
    for points in results.into_iter().flatten() {
        assert!(points.iter().all(|p| p.iter().all(|v| v.is_finite())));
    }
    let _ = parse_columns::<3>(bytes);
    let _ = parse_ply::<3>(bytes);
    let _ = parse_pcd::<3>(bytes);
    let _ = parse_vtk::<3>(bytes);
});
