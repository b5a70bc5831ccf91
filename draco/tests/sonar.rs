//! The CFAR detector against its definition, on noise and on simulated images.

use draco::simulate::{ImageParams, ScanMode, Scenario, SimulationParams, polar_image, simulate};
use draco::sonar::{Cfar, CfarKind, CfarParams, PolarImage, threshold_factor};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The definition, cell by cell.
fn by_definition(image: &PolarImage, params: &CfarParams) -> Vec<(usize, usize)> {
    let (train, guard) = (params.training / 2, params.guard / 2);
    let factor = threshold_factor(params.kind, params.training, params.false_alarm).expect("valid");
    let cell = |row: usize, column: usize| image.as_cells()[row * image.columns() + column];
    let mut hits = Vec::new();
    for row in train + guard..image.rows().saturating_sub(train + guard) {
        for column in 0..image.columns() {
            let before: Vec<u8> = (row - guard - train..row - guard).map(|r| cell(r, column)).collect();
            let behind: Vec<u8> = (row + guard + 1..=row + guard + train).map(|r| cell(r, column)).collect();
            let mean = |cells: &[u8]| cells.iter().map(|&c| f64::from(c)).sum::<f64>() / cells.len() as f64;
            let noise = match params.kind {
                CfarKind::Ca => 0.5 * (mean(&before) + mean(&behind)),
                CfarKind::Soca => mean(&before).min(mean(&behind)),
                CfarKind::Goca => mean(&before).max(mean(&behind)),
                CfarKind::Os { rank } => {
                    let mut all = [before, behind].concat();
                    all.sort_unstable();
                    f64::from(all[rank - 1])
                }
            };
            let intensity = cell(row, column);
            // Equality up to rounding may fall either way; the generator of images cannot avoid it.
            if intensity > params.min_intensity && f64::from(intensity) > factor * noise {
                hits.push((row, column));
            }
        }
    }
    hits
}

fn kinds(training: usize) -> impl Strategy<Value = CfarKind> {
    let rank = (1..=training).prop_map(|rank| CfarKind::Os { rank });
    prop_oneof![Just(CfarKind::Ca), Just(CfarKind::Soca), Just(CfarKind::Goca), rank]
}

proptest! {
    #[test]
    fn hits_are_those_of_the_definition(
        kind in kinds(6), guard in 0..3_usize, columns in 1..5_usize, rows in 0..40_usize, seed: u64, min_intensity: u8,
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let cells = (0..rows * columns).map(|_| rng.random::<u8>()).collect();
        let image = PolarImage::new(columns, cells).expect("whole rows");
        let params = CfarParams { kind, training: 6, guard: 2 * guard, false_alarm: 0.37, min_intensity };
        let hits = Cfar::new(params).expect("valid").detect(&image);
        prop_assert_eq!(hits, by_definition(&image, &params));
    }
}

/// Exponential noise, to which the theory applies, scaled so that rounding to 255 levels matters little.
#[test]
fn noise_passes_at_the_rate_asked_for() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (rows, columns) = (600, 400);
    let cells =
        (0..rows * columns).map(|_| (-30.0 * (1.0 - rng.random::<f64>()).ln()).min(255.0) as u8).collect();
    let image = PolarImage::new(columns, cells).expect("whole rows");
    for kind in [CfarKind::Ca, CfarKind::Soca, CfarKind::Goca, CfarKind::Os { rank: 30 }] {
        let params = CfarParams { kind, training: 40, guard: 10, false_alarm: 0.1, min_intensity: 0 };
        let hits = Cfar::new(params).expect("valid").detect(&image).len();
        let rate = hits as f64 / ((rows - 50) * columns) as f64;
        assert!((rate - 0.1).abs() < 0.01, "{kind:?}: {rate}");
    }
}

#[test]
fn the_front_end_sees_the_world_in_a_simulated_image() {
    for scenario in Scenario::ALL {
        let scan = ScanMode::Image(ImageParams::default(), CfarParams::default());
        let params = SimulationParams { scenario, keyframes: Some(6), scan, ..SimulationParams::default() };
        let world = scenario.world(0);
        let (mut near, mut all) = (0_usize, 0_usize);
        for recording in simulate(&params).expect("valid").recordings {
            for (keyframe, truth) in recording.keyframes.iter().zip(recording.truth.iter().flatten()) {
                all += keyframe.points.len();
                near +=
                    keyframe.points.iter().filter(|point| world.clearance(&(truth * **point)) < 0.7).count();
            }
        }
        println!("{scenario:?}: {near} of {all}");
        assert!(all > 18 * 20, "{scenario:?}: {all} points in 18 scans");
        assert!(near as f64 > 0.9 * all as f64, "{scenario:?}: {near} of {all} within 0.7 m of a surface");
    }
}

#[test]
fn images_repeat_with_their_seed() {
    let world = Scenario::Harbor.world(0);
    let image = |seed| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let pose = nalgebra::Isometry2::translation(0.0, -14.0);
        polar_image(&world, &pose, &ImageParams::default(), &mut rng).expect("valid")
    };
    assert_eq!(image(1), image(1));
    assert_ne!(image(1), image(2));
}
