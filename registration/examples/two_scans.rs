//! Where does the second scan lie? Two sonar-like scans, one call, a picture.

use draco_registration::{Cloud, IcpParams, Target};
use nalgebra::{Isometry2, Point2, Vector2};

fn main() -> anyhow::Result<()> {
    let truth = Isometry2::new(Vector2::new(1.2, -0.6), 0.15);
    let first = harbour();
    let second: Vec<_> =
        first.iter().skip(20).map(|p| truth.inverse_transform_point(&Point2::from(*p)).coords).collect();

    let target = Target::new(&Cloud::new(first.clone())?)?;
    let found = target.align(&Cloud::new(second.clone())?, &Isometry2::identity(), &IcpParams::sonar_2d())?;

    let (pose, sigma) = (found.target_from_source, found.covariance.diagonal().map(f64::sqrt));
    println!("x {:+.3} ± {:.3} m", pose.translation.x, sigma.x);
    println!("y {:+.3} ± {:.3} m", pose.translation.y, sigma.y);
    println!("θ {:+.3} ± {:.3} rad", pose.rotation.angle(), sigma.z);
    println!("{:.0} % of the points have a partner; {} steps", 100.0 * found.overlap, found.iterations);
    let moved: Vec<_> = second.iter().map(|p| pose.transform_point(&Point2::from(*p)).coords).collect();
    let path = std::env::args().nth(1).map_or_else(|| std::env::temp_dir().join("two_scans.svg"), Into::into);
    std::fs::write(&path, svg(&[(&first[..], "black"), (&second[..], "orange"), (&moved[..], "green")]))?;
    println!("target black, source before orange, after green: {}", path.display());
    Ok(())
}

/// A quay with a corner and two rows of piles, 0.4 m between points, each a little off.
fn harbour() -> Vec<Vector2<f64>> {
    let off = |i: i32| 0.05 * (f64::from(i) * 12.9898).sin();
    let mut points: Vec<_> = (0..50).map(|i| Vector2::new(0.4 * f64::from(i), 14.0 + off(i))).collect();
    points.extend((0..15).map(|i| Vector2::new(20.0 + off(i), 14.0 - 0.4 * f64::from(i))));
    for k in 0..6 {
        let centre = Vector2::new(3.0 + 3.0 * f64::from(k % 3), 5.0 + 4.0 * f64::from(k / 3));
        points.extend(
            (0..6).map(|i| {
                centre + (0.5 + off(7 * k + i)) * Vector2::new(f64::from(i).cos(), f64::from(i).sin())
            }),
        );
    }
    points
}

fn svg(clouds: &[(&[Vector2<f64>], &str)]) -> String {
    let mut text = String::from("<svg xmlns='http://www.w3.org/2000/svg' viewBox='-3 -18 28 22'>\n");
    for (points, color) in clouds {
        for p in *points {
            text.push_str(&format!("<circle cx='{:.2}' cy='{:.2}' r='0.12' fill='{color}'/>\n", p.x, -p.y));
        }
    }
    text + "</svg>\n"
}
