//! Real imaging sonar: pairs of keyframes of different robots within 5 m and 30°, started 1 m and 5° off.
//!
//! Run with `--nocapture` for the table that the README quotes, and with `DRACO_ROC_SVG=FILE` for its picture. Truth is a DGPS float, good to 0.5 to 1 m, so a
//! match counts as right within 1.5 m and 5°.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use draco_registration::correlative::{CorrelativeParams, Start, Target as Field};
use draco_registration::{Cloud, IcpParams, SlidingWindow, Target};
use nalgebra::{Isometry2, Matrix3, Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

struct Keyframe {
    robot: u32,
    truth: Isometry2<f64>,
    dead_reckoning: Isometry2<f64>,
    points: Vec<Vector2<f64>>,
}

/// The shared data, or `None` with a word on standard output; missing data is a failure if it is required.
fn keyframes() -> Option<Vec<Keyframe>> {
    let root = std::env::var("DRACO_DATA")
        .map_or_else(|_| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let folder = root.join("sonar/aracati2017");
    let (Ok(poses), Ok(points)) = (
        std::fs::read_to_string(folder.join("keyframes.csv")),
        std::fs::read_to_string(folder.join("points.csv")),
    ) else {
        assert!(std::env::var("DRACO_REQUIRE_DATA").is_err(), "{} is missing", folder.display());
        println!("skipped: {} is missing", folder.display());
        return None;
    };
    let row = |line: &str| -> Vec<f64> { line.split(',').map(|w| w.parse().unwrap()).collect() };
    let pose = |v: &[f64]| Isometry2::new(Vector2::new(v[0], v[1]), v[2]);
    let mut keyframes: Vec<Keyframe> = poses
        .lines()
        .skip(1)
        .map(row)
        .map(|v| Keyframe {
            robot: v[0] as u32,
            truth: pose(&v[6..9]),
            dead_reckoning: pose(&v[3..6]),
            points: Vec::new(),
        })
        .collect();
    for v in points.lines().skip(1).map(row) {
        keyframes[v[0] as usize].points.push(Vector2::new(v[1], v[2]));
    }
    Some(keyframes)
}

/// The scan of keyframe `k` with those of up to `width` neighbours of the same robot, placed by `poses`.
fn merged(all: &[Keyframe], poses: &[Isometry2<f64>], k: usize, width: usize) -> Vec<Vector2<f64>> {
    let near = k.saturating_sub(width)..(k + width + 1).min(all.len());
    near.filter(|&i| all[i].robot == all[k].robot)
        .flat_map(|i| {
            let here = poses[k].inv_mul(&poses[i]);
            all[i].points.iter().map(move |p| here.transform_point(&(*p).into()).coords)
        })
        .collect()
}

fn angle(a: f64) -> f64 {
    (a + PI).rem_euclid(TAU) - PI
}

/// Poses of one robot's keyframes from its own dead reckoning and points alone: each scan is matched with a sliding
/// window of those before it, and the scale of the odometry is estimated from the matches, twice.
fn local_map(all: &[Keyframe], robot: u32) -> Vec<Isometry2<f64>> {
    let own: Vec<&Keyframe> = all.iter().filter(|k| k.robot == robot).collect();
    let mut scale = 1.0;
    let mut poses = Vec::new();
    for _round in 0..2 {
        let mut window = SlidingWindow::<Isometry2<f64>, 2>::new(15).unwrap();
        let (mut products, mut squares) = (25.0, 25.0);
        poses = vec![Isometry2::identity()];
        window.push(poses[0], own[0].points.clone()).unwrap();
        for k in 1..own.len() {
            let step = own[k - 1].dead_reckoning.inv_mul(&own[k].dead_reckoning);
            let scaled = Isometry2::from_parts((scale * step.translation.vector).into(), step.rotation);
            let mut found = poses[k - 1] * scaled;
            let target: Vec<_> =
                window.merged(&poses[k - 1], 0.35).unwrap().into_iter().map(Point2::from).collect();
            if own[k].points.len() >= 40 && target.len() >= 40 {
                let sigma = nalgebra::Vector3::new(0.6, 0.6, 0.015);
                let prior = Matrix3::from_diagonal(&sigma.component_mul(&sigma));
                let start = Start { target_from_source: scaled, covariance: Some(prior) };
                let source: Vec<_> = own[k].points.iter().map(|p| Point2::from(*p)).collect();
                let field = Field::new(&target, &CorrelativeParams::default()).unwrap();
                let matched = field.locate(&source, &start).unwrap();
                if matched.score > 0.35 {
                    found = poses[k - 1] * matched.target_from_source;
                    products += step.translation.vector.dot(&matched.target_from_source.translation.vector);
                    squares += step.translation.vector.norm_squared();
                }
            }
            poses.push(found);
            window.push(found, own[k].points.clone()).unwrap();
        }
        scale = products / squares;
        println!("robot {robot}: scale of the odometry {scale:.3}");
    }
    poses
}

struct Trial {
    right: bool,
    /// Suspicion: the standard deviation of the position, metres, or another measure where larger is worse.
    sigma: f64,
    /// Another suspicion: what the scans fail to share.
    miss: f64,
    degenerate: bool,
}

fn grade(found: &Isometry2<f64>, truth: &Isometry2<f64>) -> bool {
    let error = truth.inv_mul(found);
    error.translation.vector.norm() < 1.5 && error.rotation.angle().abs() < 5f64.to_radians()
}

/// Area under the ROC curve of "larger means wrong": the chance that a wrong one is more suspicious than a
/// right one.
fn area(trials: &[Trial], measure: impl Fn(&Trial) -> f64) -> f64 {
    let (mut wins, mut pairs) = (0.0, 0.0);
    for wrong in trials.iter().filter(|t| !t.right) {
        for right in trials.iter().filter(|t| t.right) {
            let (w, r) = (measure(wrong), measure(right));
            wins += if w > r {
                1.0
            } else if w == r {
                0.5
            } else {
                0.0
            };
            pairs += 1.0;
        }
    }
    wins / pairs
}

/// The curve of [`area`]: share of the right ones called wrong, share of the wrong ones called wrong.
fn curve(trials: &[Trial], measure: impl Fn(&Trial) -> f64) -> Vec<(f64, f64)> {
    let mut limits: Vec<f64> = trials.iter().map(&measure).collect();
    limits.sort_by(|a, b| b.total_cmp(a));
    limits.dedup();
    let share = |right: bool, limit: f64| {
        let of: Vec<_> = trials.iter().filter(|t| t.right == right).collect();
        of.iter().filter(|t| measure(t) >= limit).count() as f64 / of.len() as f64
    };
    let step = limits.len().div_ceil(60);
    let drawn = limits.iter().step_by(step).chain(limits.last());
    std::iter::once((0.0, 0.0)).chain(drawn.map(|&l| (share(true, l), share(false, l)))).collect()
}

fn svg(curves: &[(String, Vec<(f64, f64)>)]) -> String {
    const COLORS: [&str; 4] = ["#c33", "#e90", "#36c", "#292"];
    let mut text = String::from(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='-40 -10 560 350' font-family='sans-serif' font-size='11'>\n<rect width='300' height='300' fill='none' stroke='black'/><path d='M0 300 300 0' stroke='#bbb'/>\n<text x='60' y='325'>share of right matches called wrong</text><text transform='translate(-12 260) rotate(-90)'>share of wrong matches called wrong</text>\n",
    );
    for (k, (name, points)) in curves.iter().enumerate() {
        let path: Vec<_> =
            points.iter().map(|(x, y)| format!("{:.0} {:.0}", 300.0 * x, 300.0 * (1.0 - y))).collect();
        let (color, y) = (COLORS[k % COLORS.len()], 20 + 18 * k);
        text += &format!(
            "<polyline points='{}' fill='none' stroke='{color}' stroke-width='2'/>\n",
            path.join(" ")
        );
        text += &format!("<text x='312' y='{y}' fill='{color}'>{name}</text>\n");
    }
    text + "</svg>\n"
}

fn icp(
    target: &Target<2>,
    source: &Cloud<2>,
    start: &Isometry2<f64>,
    truth: &Isometry2<f64>,
    params: &IcpParams,
) -> Trial {
    let found = target.align(source, start, params).unwrap();
    let c = found.covariance;
    Trial {
        right: grade(&found.target_from_source, truth),
        sigma: (c[(0, 0)] + c[(1, 1)]).sqrt(),
        miss: 1.0 - found.overlap,
        degenerate: found.is_degenerate(),
    }
}

fn correlative(
    field: &Field,
    source: &[Point2<f64>],
    start: &Isometry2<f64>,
    truth: &Isometry2<f64>,
) -> Trial {
    let prior = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, 5f64.to_radians().powi(2)));
    let start = Start { target_from_source: *start, covariance: Some(prior) };
    let found = field.locate_within(source, &start, 3.0, 0.2).unwrap();
    Trial {
        right: grade(&found.target_from_source, truth),
        sigma: (found.covariance[(0, 0)] + found.covariance[(1, 1)]).sqrt(),
        miss: 1.0 - found.score,
        degenerate: found.at_border,
    }
}

fn table(name: &str, trials: &[Trial]) -> f64 {
    let share = |k: usize, n: usize| 100.0 * k as f64 / n.max(1) as f64;
    let right = trials.iter().filter(|t| t.right).count();
    let flagged = |right: bool| {
        let of: Vec<_> = trials.iter().filter(|t| t.right == right).collect();
        share(of.iter().filter(|t| t.degenerate).count(), of.len())
    };
    println!(
        "{name:34} {:5.1} % right of {}; area under ROC: sigma {:.2}, overlap or score {:.2}; flagged {:.0} % of wrong, {:.0} % of right",
        share(right, trials.len()),
        trials.len(),
        area(trials, |t| t.sigma),
        area(trials, |t| t.miss),
        flagged(false),
        flagged(true),
    );
    right as f64 / trials.len() as f64
}

#[test]
fn real_sonar_pairs_are_matched() {
    let Some(all) = keyframes() else { return };
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut pairs = Vec::new();
    for a in 0..all.len() {
        for b in 0..all.len() {
            let truth = all[a].truth.inv_mul(&all[b].truth);
            if all[a].robot < all[b].robot
                && truth.translation.vector.norm() < 5.0
                && angle(truth.rotation.angle()).abs() < 30f64.to_radians()
            {
                let phi = rng.random_range(-PI..PI);
                let turn = 5f64.to_radians() * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
                pairs.push((a, b, truth, truth * Isometry2::new(Vector2::new(phi.cos(), phi.sin()), turn)));
            }
        }
    }
    assert!(pairs.len() > 200);
    let (mut results, mut curves) = (Vec::new(), Vec::new());
    let reckoned: Vec<_> = all.iter().map(|k| k.dead_reckoning).collect();
    let mapped: Vec<_> = (0..3).flat_map(|robot| local_map(&all, robot)).collect();
    let cases = [
        (0, 0, "-", &reckoned),
        (2, 4, "dead reckoning", &reckoned),
        (0, 7, "own map", &mapped),
        (2, 4, "own map", &mapped),
        (3, 7, "own map", &mapped),
    ];
    for (source_width, target_width, by, poses) in cases {
        let mut trials: [Vec<Trial>; 3] = Default::default();
        for (a, b, truth, start) in &pairs {
            let (target, source) =
                (merged(&all, poses, *a, target_width), merged(&all, poses, *b, source_width));
            if target.is_empty() || source.is_empty() {
                continue;
            }
            let field = Field::new(
                &target.iter().map(|p| Point2::from(*p)).collect::<Vec<_>>(),
                &CorrelativeParams::default(),
            )
            .unwrap();
            let places: Vec<_> = source.iter().map(|p| Point2::from(*p)).collect();
            let (target, source) =
                (Target::new(&Cloud::new(target).unwrap()).unwrap(), Cloud::new(source).unwrap());
            trials[0].push(icp(&target, &source, start, truth, &IcpParams::libpointmatcher_like()));
            trials[1].push(icp(&target, &source, start, truth, &IcpParams::sonar_2d()));
            trials[2].push(correlative(&field, &places, start, truth));
        }
        println!("source +-{source_width}, target +-{target_width} keyframes, merged by {by}:");
        for (name, trials) in ["as the reference's chain", "sonar_2d", "correlative"].iter().zip(&trials) {
            results.push(table(name, trials));
        }
        if matches!((source_width, by), (0, "-") | (2, "own map")) {
            let scans = if source_width == 0 { "single" } else { "merged" };
            curves.push((format!("ICP, {scans}: deviation"), curve(&trials[1], |t| t.sigma)));
            curves.push((format!("correlative, {scans}: 1 - score"), curve(&trials[2], |t| t.miss)));
        }
    }
    if let Ok(path) = std::env::var("DRACO_ROC_SVG") {
        std::fs::write(path, svg(&curves)).unwrap();
    }
    // three methods a case, in the order above
    assert!(results[1] > 0.5, "single scans by ICP: {}", results[1]);
    assert!(results[2] > results[0], "the correlative matcher leads on single scans");
    assert!(
        results[11] >= 0.85 && results[14] >= 0.85,
        "submaps on submaps: {} {}",
        results[11],
        results[14]
    );
}
