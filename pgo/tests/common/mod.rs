//! What the data-driven tests share.
#![allow(dead_code)]

use std::path::PathBuf;

/// The path of a shared data file. Without the data the test is skipped and says so, unless
/// `DRACO_REQUIRE_DATA=1` makes that a failure.
pub(crate) fn data(relative: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DRACO_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let path = root.join(relative);
    if path.exists() {
        return Some(path);
    }
    let required = std::env::var_os("DRACO_REQUIRE_DATA").is_some_and(|v| v == "1");
    assert!(!required, "{} is missing and DRACO_REQUIRE_DATA=1", path.display());
    println!("skipped: {} is missing (set DRACO_DATA to the folder of the shared data)", path.display());
    None
}
