use nalgebra::{Isometry2, Vector2};

use crate::cloud::Cloud;
use crate::error::check;
use crate::icp::{IcpParams, Registration, Target};
use crate::{Error, RigidMotion};

/// The registration of the first DRACo-SLAM, for comparison. Defaults are those of its released code.
#[derive(Debug, Clone, PartialEq)]
pub struct Draco1Params {
    /// Half width of the search in x and y, metres. Default 10.
    pub translation: f64,
    /// Half width of the search in heading, radians. Default 100°.
    pub rotation: f64,
    /// Edge of an occupancy cell, metres. Default 0.05.
    pub cell: f64,
    /// Radius by which target points are grown on the occupancy image, metres. Default 0.5; also the distance
    /// at which points count as overlapping.
    pub dilation: f64,
    /// Poses drawn in each round. Default 500.
    pub samples: usize,
    /// Rounds, each about the best pose so far in half the box. Default 5.
    pub rounds: usize,
    /// Fewest points of either scan. Default 75.
    pub min_points: usize,
    /// Largest ratio of the numbers of points. Default 2.
    pub max_point_ratio: f64,
    /// Least share of the target points with a source point near, tested before ICP. Default 0.55, the value of
    /// the original; its port uses 0.65 to 0.85.
    pub min_overlap: f64,
    /// The ICP that follows. Default [`IcpParams::libpointmatcher_like`].
    pub icp: IcpParams,
}

impl Default for Draco1Params {
    fn default() -> Self {
        Self {
            translation: 10.0,
            rotation: 100f64.to_radians(),
            cell: 0.05,
            dilation: 0.5,
            samples: 500,
            rounds: 5,
            min_points: 75,
            max_point_ratio: 2.0,
            min_overlap: 0.55,
            icp: IcpParams::libpointmatcher_like(),
        }
    }
}

/// Why the first DRACo-SLAM would not use a pair of scans.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Draco1Rejection {
    /// A scan has too few points.
    FewPoints,
    /// The numbers of points differ too much.
    PointRatio,
    /// The overlap after the search is too small.
    Overlap,
}

/// What the method gives for a pair of scans.
#[derive(Debug, Clone, PartialEq)]
pub struct Draco1Match {
    /// Pose after search and ICP; its covariance is the spacing-based one.
    pub registration: Registration<Isometry2<f64>, 3>,
    /// Share of the target points with a source point near, before ICP.
    pub search_overlap: f64,
    /// The first gate that failed, if any; the registration is computed all the same.
    pub rejection: Option<Draco1Rejection>,
}

/// Registers two sonar scans as the first DRACo-SLAM does: the pose in a box that puts the most source points on
/// the grown target points of an occupancy image, sought by sampling, then ICP.
///
/// One difference: the original samples by SHGO with Sobol points, this by an additive low-discrepancy sequence
/// whose box is halved about the best pose each round. Same number of evaluations; the same answer on every run.
///
/// **Source**: McConnell, Huang, Szenher, Collado-Gonzalez, Englot, "DRACo-SLAM: distributed robust acoustic
/// communication-efficient SLAM for imaging sonar equipped underwater robot teams", 2022.
///
/// # Errors
/// [`Error::Parameter`], and those of [`Target::align`].
pub fn draco1(
    target: &Target<2>,
    source: &Cloud<2>,
    start: &Isometry2<f64>,
    params: &Draco1Params,
) -> Result<Draco1Match, Error> {
    check("cell", params.cell, params.cell > 0.0 && params.cell.is_finite(), "more than 0")?;
    check("dilation", params.dilation, params.dilation > 0.0 && params.dilation.is_finite(), "more than 0")?;
    check("translation", params.translation, params.translation >= 0.0, "0 or more")?;
    check("rotation", params.rotation, params.rotation >= 0.0, "0 or more")?;
    let pose = search(target, source, start, params);
    let registration = target.align(source, &pose, &params.icp)?;
    let overlap = target.overlap(source, &pose, params.dilation)?.target;
    let (n, m) = (source.len(), target.len());
    let rejection = if n.min(m) < params.min_points {
        Some(Draco1Rejection::FewPoints)
    } else if n.max(m) as f64 > params.max_point_ratio * n.min(m) as f64 {
        Some(Draco1Rejection::PointRatio)
    } else if overlap < params.min_overlap {
        Some(Draco1Rejection::Overlap)
    } else {
        None
    };
    Ok(Draco1Match { registration, search_overlap: overlap, rejection })
}

fn search(
    target: &Target<2>,
    source: &Cloud<2>,
    start: &Isometry2<f64>,
    params: &Draco1Params,
) -> Isometry2<f64> {
    let count = |pose: &Isometry2<f64>| {
        let on_target = |p: &&Vector2<f64>| {
            let place = pose.transform_point(&(**p).into()).coords - target.origin;
            // the centre of the cell the point falls in, as on an image
            let cell = place.map(|v| (v / params.cell).floor() * params.cell + 0.5 * params.cell);
            target.tree.nearest_within(&cell, params.dilation).is_some()
        };
        source.points().iter().filter(on_target).count()
    };
    // the additive recurrence of the plastic number's cousin in three dimensions fills a cube evenly
    const G: f64 = 1.220_744_084_605_759_5;
    let steps = [1.0 / G, 1.0 / (G * G), 1.0 / (G * G * G)];
    let (mut best, mut most) = (*start, count(start));
    let mut width = 1.0;
    for round in 0..params.rounds {
        let centre = best;
        for sample in 0..params.samples {
            let at = |axis: usize| {
                2.0 * (0.5 + (round * params.samples + sample + 1) as f64 * steps[axis]).fract() - 1.0
            };
            let shift = Vector2::new(at(0), at(1)) * (params.translation * width);
            let angle = centre.rotation.angle() + at(2) * params.rotation * width;
            let pose = Isometry2::new(centre.translation_vector() + shift, angle);
            let here = count(&pose);
            if here > most {
                (best, most) = (pose, here);
            }
        }
        width *= 0.5;
    }
    best
}
