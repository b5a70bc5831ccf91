//! Every map and Jacobian against 60-digit reference values (`reference_table.py` writes them with mpmath).
use std::collections::BTreeMap;

use draco_lie::LieGroup;
use nalgebra::{
    Complex, Isometry2, Isometry3, Quaternion, SMatrix, SVector, Translation2, Translation3, UnitComplex,
    UnitQuaternion, Vector3, Vector6,
};

/// Largest error of a block over its largest entry.
const TOLERANCE: f64 = 4e-15;

/// The part of a quantity an error is relative to: a rotation, a translation, one block of a Jacobian.
type Block = (&'static str, Vec<f64>);

fn row_major<const R: usize, const C: usize>(m: &SMatrix<f64, R, C>) -> Vec<f64> {
    m.transpose().iter().copied().collect()
}

fn view<const N: usize, const R: usize, const C: usize>(
    m: &SMatrix<f64, N, N>,
    row: usize,
    column: usize,
) -> Vec<f64> {
    row_major(&SMatrix::<f64, R, C>::from_fn(|i, j| m[(row + i, column + j)]))
}

fn space(quantity: &str, input: &[f64]) -> Vec<Block> {
    type Rotation = UnitQuaternion<f64>;
    let tangent = || Vector6::from_column_slice(input);
    let phi = || Vector3::from_column_slice(&input[3..]);
    let pose = || {
        let q = Quaternion::new(input[3], input[0], input[1], input[2]);
        let t = Translation3::new(input[4], input[5], input[6]);
        Isometry3::from_parts(t, UnitQuaternion::new_unchecked(q))
    };
    let jacobian = |m: SMatrix<f64, 6, 6>, so: SMatrix<f64, 3, 3>| {
        assert_eq!(view::<6, 3, 3>(&m, 0, 0), row_major(&so), "SO(3) and SE(3) agree");
        assert_eq!(view::<6, 3, 3>(&m, 0, 0), view::<6, 3, 3>(&m, 3, 3));
        assert!(view::<6, 3, 3>(&m, 3, 0).iter().all(|&entry| entry == 0.0));
        vec![("J", row_major(&so)), ("Q", view::<6, 3, 3>(&m, 0, 3))]
    };
    match quantity {
        "exp" => {
            let found = Isometry3::exp(&tangent());
            assert_eq!(found.rotation, <Rotation as LieGroup<3>>::exp(&phi()));
            assert!((found.rotation.norm() - 1.0).abs() < 4e-16);
            vec![
                ("R", row_major(&LieGroup::to_matrix(&found.rotation))),
                ("t", row_major(&found.translation.vector)),
            ]
        }
        "forward" => {
            let right = Isometry3::right_jacobian(&-tangent());
            assert_eq!(right, Isometry3::left_jacobian(&tangent()));
            jacobian(right, <Rotation as LieGroup<3>>::left_jacobian(&phi()))
        }
        "inverse" => {
            let right = Isometry3::right_jacobian_inverse(&-tangent());
            assert_eq!(right, Isometry3::left_jacobian_inverse(&tangent()));
            jacobian(right, <Rotation as LieGroup<3>>::left_jacobian_inverse(&phi()))
        }
        "log" => {
            let xi = pose().log();
            assert_eq!(xi.fixed_rows::<3>(3), LieGroup::log(&pose().rotation));
            vec![("rho", xi.as_slice()[..3].to_vec()), ("phi", xi.as_slice()[3..].to_vec())]
        }
        "adjoint" => {
            let m = pose().adjoint();
            jacobian(m, LieGroup::adjoint(&pose().rotation))
        }
        _ => unreachable!("{quantity}"),
    }
}

fn plane(quantity: &str, input: &[f64]) -> Vec<Block> {
    let tangent = || Vector3::from_column_slice(input);
    let pose = || {
        let rotation = UnitComplex::new_unchecked(Complex::new(input[0], input[1]));
        Isometry2::from_parts(Translation2::new(input[2], input[3]), rotation)
    };
    match quantity {
        "exp" => {
            let found = Isometry2::exp(&tangent());
            let (rotation, t) = (found.rotation, found.translation.vector);
            assert_eq!(rotation, <UnitComplex<f64> as LieGroup<1>>::exp(&SVector::from([input[2]])));
            vec![("R", vec![rotation.re, rotation.im]), ("t", vec![t.x, t.y])]
        }
        "forward" => {
            let m = Isometry2::right_jacobian(&-tangent());
            assert_eq!(m, Isometry2::left_jacobian(&tangent()));
            vec![("J", view::<3, 2, 2>(&m, 0, 0)), ("Q", view::<3, 2, 1>(&m, 0, 2))]
        }
        "inverse" => {
            let m = Isometry2::right_jacobian_inverse(&-tangent());
            assert_eq!(m, Isometry2::left_jacobian_inverse(&tangent()));
            vec![("J", view::<3, 2, 2>(&m, 0, 0)), ("Q", view::<3, 2, 1>(&m, 0, 2))]
        }
        "log" => {
            let xi = pose().log();
            assert_eq!(LieGroup::log(&pose().rotation)[0], xi[2]);
            vec![("rho", vec![xi[0], xi[1]]), ("phi", vec![xi[2]])]
        }
        "adjoint" => {
            let m = pose().adjoint();
            vec![("J", vec![m[(0, 0)], m[(1, 0)]]), ("Q", vec![m[(0, 2)], m[(1, 2)]])]
        }
        _ => unreachable!("{quantity}"),
    }
}

#[test]
fn all_maps_and_jacobians_match_sixty_digits() {
    let table = include_str!("data/reference.txt");
    let mut worst = BTreeMap::<String, (f64, f64)>::new();
    let mut values = 0;
    for line in table.lines() {
        let mut parts = line.split(" : ");
        let mut next = || parts.next().unwrap().split_whitespace();
        let head: Vec<&str> = next().collect();
        let input: Vec<f64> = next().map(|x| x.parse().unwrap()).collect();
        let mut expected = next().map(|x| x.parse::<f64>().unwrap());
        let found = if head[0] == "se3" { space(head[1], &input) } else { plane(head[1], &input) };
        for (block, entries) in found {
            let reference: Vec<f64> = expected.by_ref().take(entries.len()).collect();
            let scale = reference.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let error = entries.iter().zip(&reference).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
            let relative = if scale == 0.0 { error } else { error / scale };
            let entry = worst.entry(format!("{} {} {block}", head[0], head[1])).or_default();
            if relative > entry.0 || relative.is_nan() {
                *entry = (relative, head[2].parse().unwrap());
            }
            values += entries.len();
        }
        assert_eq!(expected.next(), None, "{line}");
    }
    println!("{values} reference values; largest relative error and the angle it is at:");
    for (quantity, (error, theta)) in &worst {
        println!("{quantity:16} {error:.2e} {theta}");
    }
    for (quantity, (error, theta)) in &worst {
        assert!(*error <= TOLERANCE, "{quantity}: {error:e} at {theta}");
    }
}
