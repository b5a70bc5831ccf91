//! Strategies shared by the property tests.
use std::f64::consts::PI;

use draco_lie::LieGroup;
use nalgebra::SVector;
use proptest::prelude::*;

/// A signed rotation angle: zero, the small ones, both sides of every change of formula (√2, 3, π), and any up to 2π.
pub(crate) fn angles() -> impl Strategy<Value = f64> {
    let size = prop_oneof![
        Just(0.0),
        Just(PI),
        (-12.0..-1.0).prop_map(|e| 10_f64.powf(e)),
        0.0..2.0 * PI - 1e-3,
        prop_oneof![Just(2_f64.sqrt()), Just(3.0), Just(PI)]
            .prop_flat_map(|edge| (-12.0..-1.0).prop_map(move |e| edge - 10_f64.powf(e))),
        prop_oneof![Just(2_f64.sqrt()), Just(3.0), Just(PI)]
            .prop_flat_map(|edge| (-12.0..-1.0).prop_map(move |e| edge + 10_f64.powf(e))),
    ];
    (size, any::<bool>()).prop_map(|(size, positive)| if positive { size } else { -size })
}

/// Tangent vectors whose last `rotations` entries have a length from [`angles`].
pub(crate) fn tangents<const N: usize>(rotations: usize) -> impl Strategy<Value = SVector<f64, N>> {
    (angles(), proptest::collection::vec(-1.0..1.0, N)).prop_map(move |(angle, entries)| {
        let mut xi = SVector::<f64, N>::from_iterator(entries);
        let size = xi.rows(N - rotations, rotations).norm();
        xi.rows_mut(N - rotations, rotations).scale_mut(if size > 0.0 { angle / size } else { 0.0 });
        xi
    })
}

/// Poses of such tangents.
pub(crate) fn poses<const N: usize, G: LieGroup<N>>(rotations: usize) -> impl Strategy<Value = G> {
    tangents::<N>(rotations).prop_map(|xi| G::exp(&xi))
}
