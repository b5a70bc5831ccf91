//! Do two robots see the same piers? Matches their object maps and draws the answer.
//!
//! usage: two_piers [PICTURE.svg]

mod support;

use draco_graphmatch::{Method, Object, match_objects};
use nalgebra::{Isometry2, Point2, Vector2};

fn main() -> anyhow::Result<()> {
    // Two piers of pilings, unevenly spaced, and what lies about them; robot 2 misses some and sees others.
    let seen = [
        (0.0, 0.0),
        (5.1, 0.2),
        (11.8, -0.1),
        (16.0, 0.1),
        (24.5, 0.0),
        (2.0, 17.8),
        (9.2, 18.1),
        (13.1, 18.0),
    ];
    let place = |&(x, y): &(f64, f64)| Object::new(Point2::new(x, y), 3.0 + 0.05 * x, 2.0);
    let mut map1: Vec<Object> = seen.iter().map(place).collect();
    map1.extend([(30.2, 9.0), (-7.5, 6.3)].iter().map(place));

    let map1_from_map2 = Isometry2::new(Vector2::new(8.0, 3.0), 0.6);
    let mut map2: Vec<Object> = seen[2..].iter().chain(&[(20.9, 26.4), (18.0, 9.5)]).map(place).collect();
    for (k, object) in map2.iter_mut().enumerate() {
        let noise = Vector2::new((7.0 * k as f64).sin(), (3.0 * k as f64).cos()) * 0.15;
        object.centroid = map1_from_map2.inverse_transform_point(&object.centroid) + noise;
    }

    let found = match_objects(&map1, &map2, &Method::default())?;
    println!("{:?}: {} pairs of {} and {} objects", found.verdict, found.pairs.len(), map1.len(), map2.len());
    if let Some(pose) = found.map1_from_map2 {
        let error = map1_from_map2.inverse() * pose.mean();
        println!(
            "transform off by {:.3} m, {:.3} rad",
            error.translation.vector.norm(),
            error.rotation.angle()
        );
    }
    let path =
        std::env::args_os().nth(1).map_or_else(|| std::env::temp_dir().join("two_piers.svg"), Into::into);
    std::fs::write(&path, support::picture(&map1, &map2, &found.pairs))?;
    println!("picture: {}", path.display());
    Ok(())
}
