//! The global search in three dimensions on the demonstration of Go-ICP.

use std::path::PathBuf;

use draco_registration::global::{SearchParams3, branch_and_bound_3d};
use draco_registration::{Cloud, Target, io::read_points};
use nalgebra::{Isometry3, Vector3};

fn data(file: &str) -> Option<Vec<Vector3<f64>>> {
    let root = std::env::var("DRACO_DATA")
        .map_or_else(|_| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let path = root.join("registration/goicp").join(file);
    if !path.exists() {
        assert!(std::env::var("DRACO_REQUIRE_DATA").is_err(), "{} is missing", path.display());
        println!("skipped: {} is missing", path.display());
        return None;
    }
    Some(read_points(&path).unwrap())
}

#[test]
fn the_bunny_is_found_without_a_start() {
    let (Some(model), Some(all)) = (data("model_bunny.txt"), data("data_bunny.txt")) else { return };
    for count in [100, 1000] {
        let drawn: Vec<_> = (0..count).map(|i| all[i * all.len() / count]).collect();
        let begin = std::time::Instant::now();
        let target = Target::new(&Cloud::new(model.clone()).unwrap()).unwrap();
        let built = begin.elapsed().as_secs_f64();
        let source = Cloud::new(drawn).unwrap();
        // box and gap of the demonstration's configuration
        let params = SearchParams3::all_rotations(0.5, 1e-3);
        let found = branch_and_bound_3d(&target, &source, &Isometry3::identity(), &params).unwrap();
        let found = found.best();
        println!(
            "bunny, {count} points: cost {:.2e}, {} boxes, tree {built:.3} s, search {:.3} s",
            found.cost,
            found.nodes,
            begin.elapsed().as_secs_f64() - built
        );
        assert!(found.certified && found.cost - found.lower_bound <= 1e-3, "{found:?}");
        // by brute force, so that the cost is no promise of the library alone
        let cost = source
            .points()
            .iter()
            .map(|p| {
                let x = found.target_from_source * nalgebra::Point3::from(*p);
                model.iter().map(|q| (q - x.coords).norm_squared()).fold(f64::INFINITY, f64::min)
            })
            .sum::<f64>()
            / source.len() as f64;
        assert!((cost - found.cost).abs() < 1e-12);
    }
}
