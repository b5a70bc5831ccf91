use std::f64::consts::PI;

use nalgebra::{Isometry2, Rotation2, Vector2};

use super::se2::{Pivot, Region, SearchParams};

/// The poses a planar search may answer with; places are relative to the target's origin.
pub(super) struct Window {
    /// Where the start puts the pivot.
    place: Vector2<f64>,
    half_width: f64,
    angle: f64,
    half_angle: f64,
    /// The source's centroid as seen from the pivot, axes of the source.
    arm: Vector2<f64>,
    source_centre: Vector2<f64>,
    target_origin: Vector2<f64>,
}

impl Window {
    pub(super) fn new(
        start: &Isometry2<f64>,
        params: &SearchParams,
        source_centre: Vector2<f64>,
        target_origin: Vector2<f64>,
    ) -> Self {
        let pivot = match params.pivot {
            Pivot::Centroid => source_centre,
            Pivot::Origin => Vector2::zeros(),
        };
        Self {
            place: start.transform_point(&pivot.into()).coords - target_origin,
            half_width: params.translation,
            angle: start.rotation.angle(),
            half_angle: params.rotation.min(PI),
            arm: source_centre - pivot,
            source_centre,
            target_origin,
        }
    }

    /// A box around the window: where the pivot may be, and how far the arm may swing the centroid from there.
    pub(super) fn root(&self) -> Region {
        Region {
            angle: self.angle,
            centroid: self.place + Rotation2::new(self.angle) * self.arm,
            half_angle: self.half_angle,
            half_width: self.half_width + self.swing(self.half_angle),
        }
    }

    /// Whether no pose of the region lies in the window.
    pub(super) fn misses(&self, region: &Region) -> bool {
        let pivot = region.centroid - Rotation2::new(region.angle) * self.arm;
        let reach = self.half_width + region.half_width + self.swing(region.half_angle);
        self.arm != Vector2::zeros() && (pivot - self.place).amax() > reach
    }

    pub(super) fn holds(&self, pose: &Isometry2<f64>) -> bool {
        let pivot = pose.transform_point(&(self.source_centre - self.arm).into()).coords - self.target_origin;
        (pivot - self.place).amax() <= self.half_width
            && angle_between(pose.rotation.angle(), self.angle) <= self.half_angle
    }

    /// How far a turn by up to so much moves the centroid about the pivot.
    fn swing(&self, half_angle: f64) -> f64 {
        2.0 * (0.5 * half_angle).min(0.5 * PI).sin() * self.arm.norm()
    }
}

pub(super) fn angle_between(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(2.0 * PI);
    d.min(2.0 * PI - d)
}
