//! Which row of equal pilings is which? Nobody can tell, and the matcher says so and shows the candidates.

use draco_graphmatch::{AsCodedParams, Method, Object, match_objects};
use nalgebra::{Isometry2, Point2, Vector2};

fn main() -> anyhow::Result<()> {
    let field = |from: usize| -> Vec<Object> {
        (from..from + 6)
            .flat_map(|x| (0..3).map(move |y| (x as f64, f64::from(y))))
            .map(|(x, y)| {
                Point2::new(6.0 * x + 0.05 * (5.0 * y + x).sin(), 6.0 * y + 0.05 * (3.0 * x - y).cos())
            })
            .map(|p| Object::new(p, 3.0, 3.0))
            .collect()
    };
    let map1 = field(0);
    // Robot 2 sees the field two columns on.
    let map1_from_map2 = Isometry2::new(Vector2::new(20.0, -4.0), 1.1);
    let map2: Vec<Object> = field(2)
        .into_iter()
        .map(|o| Object { centroid: map1_from_map2.inverse_transform_point(&o.centroid), ..o })
        .collect();

    let shift = |pose: &Isometry2<f64>| (pose * map1_from_map2.inverse()).translation.vector;
    let ours = match_objects(&map1, &map2, &Method::default())?;
    println!("ours: {:?}", ours.verdict);
    for mode in &ours.modes {
        let turn = mode.map1_from_map2.mean().rotation.angle() - map1_from_map2.rotation.angle();
        println!(
            "  mode: {:2} pairs, probability {:.2}, turned {:4.0}°, first piling off by {:5.1} m",
            mode.pairs.len(),
            mode.probability,
            turn.to_degrees(),
            shift(mode.map1_from_map2.mean()).norm()
        );
    }
    let published = match_objects(&map1, &map2, &Method::AsCoded(AsCodedParams::default()))?;
    if let Some(pose) = published.map1_from_map2 {
        println!(
            "published pipeline: {:?}, first piling off by {:.1} m",
            published.verdict,
            shift(pose.mean()).norm()
        );
    }
    Ok(())
}
