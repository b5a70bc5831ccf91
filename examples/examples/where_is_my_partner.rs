//! Where does the partner's map lie in mine? Two maps of the same place, seen by robots that never met, and a lattice of
//! equal piles, where the honest answer is that nobody can tell.

use std::collections::BTreeSet;

use draco::alignment::{AlignmentParams, OwnMap, Verdict, align};
use draco::message::CellMap;
use nalgebra::{Isometry2, Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const CELL_M: f64 = 2.0;

fn cells(points: impl Iterator<Item = Point2<f64>>) -> CellMap {
    let cell = |p: Point2<f64>| [(p.x / CELL_M).floor() as i32, (p.y / CELL_M).floor() as i32];
    CellMap {
        size: CELL_M,
        keyframes: 60,
        cells: points.map(cell).collect::<BTreeSet<_>>().into_iter().collect(),
    }
}

fn tell(
    name: &str,
    mine: &[Point2<f64>],
    theirs: &[Point2<f64>],
    mine_from_theirs: &Isometry2<f64>,
) -> anyhow::Result<()> {
    let own = OwnMap { cells: cells(mine.iter().copied()), free: BTreeSet::new() };
    let partner = cells(theirs.iter().map(|p| mine_from_theirs.inverse_transform_point(p)));
    match align(&own, &partner, &AlignmentParams::default())? {
        Verdict::Clear(mode) => {
            let error = mode.target_from_source.inv_mul(mine_from_theirs);
            println!(
                "{name}: one clear fit, score {:.2}; {:.2} m and {:.1} deg from the truth",
                mode.score,
                error.translation.vector.norm(),
                error.rotation.angle().abs().to_degrees()
            );
        }
        Verdict::Ambiguous { ratio } => {
            println!("{name}: ambiguous, the second fit scores {ratio:.2} of the first")
        }
        Verdict::None => println!("{name}: too little to compare"),
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mine_from_theirs = Isometry2::new(Vector2::new(40.0, -15.0), 2.5);

    // walls of random place, length and direction
    let mut walls = Vec::new();
    for _ in 0..25 {
        let start = Point2::new(rng.random_range(0.0..120.0), rng.random_range(0.0..80.0));
        let (length, angle): (f64, f64) = (rng.random_range(5.0..25.0), rng.random_range(0.0..3.1));
        let along = Vector2::new(angle.cos(), angle.sin());
        walls.extend((0..(2.0 * length) as usize).map(|i| start + along * (0.5 * i as f64)));
    }
    let (mine, theirs): (Vec<_>, Vec<_>) = (
        walls.iter().copied().filter(|p| p.x < 85.0).collect(),
        walls.iter().copied().filter(|p| p.x > 35.0).collect(),
    );
    tell("a harbour of different walls", &mine, &theirs, &mine_from_theirs)?;

    // piles every 8 m, both robots see a part of the lattice
    let piles = |columns: std::ops::Range<i32>| {
        columns.flat_map(|i| {
            (0..10).map(move |j| Point2::new(8.0 * f64::from(i) + 1.0, 8.0 * f64::from(j) + 1.0))
        })
    };
    tell(
        "a lattice of equal piles",
        &piles(0..9).collect::<Vec<_>>(),
        &piles(4..13).collect::<Vec<_>>(),
        &mine_from_theirs,
    )
}
