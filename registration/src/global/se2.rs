use std::f64::consts::PI;

use nalgebra::{Isometry2, Rotation2, Vector2};

use super::best_first::{Boxes, best_first, kept_of, mean_kept, scattering_stride};
use super::near_grid::NearGrid;
use super::window::{Window, angle_between};
use crate::cloud::Cloud;
use crate::error::check;
use crate::icp::{Acceleration, IcpParams, Rejector, Residual, StopRule, Target};
use crate::{Error, RigidMotion};

/// The point of the source whose translation a search bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pivot {
    /// The centroid of the points: the box does not depend on where the source's frame lies.
    #[default]
    Centroid,
    /// The origin of the source's frame, usually the sensor: for a start whose translation and rotation are each good
    /// to so much, since a wrong heading carries the centroid far.
    Origin,
}

/// What a global search looks for, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchParams {
    /// Half width of the square searched for the pivot, metres, about where the start puts it.
    pub translation: f64,
    /// Which point of the source that is. Default the centroid.
    pub pivot: Pivot,
    /// Half width of the rotations searched, radians; π or more searches all.
    pub rotation: f64,
    /// Distance `τ` at which a point counts as not seen, metres. Default 0.3: ten times the noise of a laser.
    pub truncation: f64,
    /// Share of the points that count, those that fit best. Default 1.
    pub keep: f64,
    /// The search ends when no pose can beat the best by more than this share of `τ²`. Default 0.05; a
    /// smaller gap costs boxes by about its third power.
    pub gap: f64,
    /// Number of separate modes wanted, the best first. Default 1.
    pub modes: usize,
    /// Two poses are separate modes when the centroid differs by more than this, metres, or the rotation by
    /// more than [`SearchParams::separation_rotation`]. Default 0.5.
    pub separation: f64,
    /// See [`SearchParams::separation`], radians. Default 0.2.
    pub separation_rotation: f64,
    /// Source points used at most, evenly drawn. Default 200.
    pub max_points: usize,
    /// Boxes examined at most for each mode. Default 300 000.
    pub max_nodes: usize,
}

impl SearchParams {
    /// A search about a start that is roughly right: 30° either way, and few boxes, since the polished pose is
    /// found early and the certificate is what takes long.
    pub fn near_start(translation: f64) -> Self {
        Self { translation, pivot: Pivot::Origin, rotation: PI / 6.0, max_nodes: 20_000, ..Self::default() }
    }
}

impl Default for SearchParams {
    fn default() -> Self {
        Self {
            translation: 5.0,
            pivot: Pivot::Centroid,
            rotation: PI,
            truncation: 0.3,
            keep: 1.0,
            gap: 0.05,
            modes: 1,
            separation: 0.5,
            separation_rotation: 0.2,
            max_points: 200,
            max_nodes: 300_000,
        }
    }
}

/// One local optimum of a global search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Maps source points into the target's frame.
    pub target_from_source: Isometry2<f64>,
    /// Mean of `min(d, τ)²` over the points that count, m².
    pub cost: f64,
    /// `1 - cost / τ²`: 1 when every point lies on a target point, 0 when none is near one.
    pub score: f64,
    /// No pose of its search region costs less than this, m². For a rival the region leaves out the modes before.
    pub lower_bound: f64,
    /// Whether the search ended by its gap and not by its number of boxes.
    pub certified: bool,
    /// Boxes examined for it.
    pub nodes: usize,
}

/// What a global search found.
#[derive(Debug, Clone, PartialEq)]
pub struct GlobalMatch {
    /// Modes, best first; never empty.
    pub modes: Vec<Mode>,
}

impl GlobalMatch {
    /// The best mode.
    pub fn best(&self) -> &Mode {
        &self.modes[0]
    }

    /// Score of the best rival over the score of the best, in [0, 1]; near 1 the answer is ambiguous. `None`
    /// when only one mode was asked for.
    pub fn ambiguity(&self) -> Option<f64> {
        let rival = self.modes.get(1)?;
        Some(if self.modes[0].score > 0.0 { (rival.score / self.modes[0].score).min(1.0) } else { 1.0 })
    }
}

/// Finds the pose with the least `mean min(d_i, τ)²` over a box of SE(2), by branch and bound.
///
/// `d_i` is the distance of a moved source point to its nearest target point. In a box of rotations within `α`
/// and centroids within `h`, a point at radius `r` from the source's centroid strays at most
/// `γ = 2 r sin(α/2) + √2 h` from where the box's centre puts it, so `max(0, d - γ)` bounds its distance from
/// below. Boxes that cannot beat the best pose by the gap are dropped; the rest is halved along what adds more
/// to `γ`. The answer is therefore within the gap of the best pose anywhere in the box.
///
/// * `start` – centre of the search box.
///
/// # Errors
/// [`Error::TooFewPoints`], [`Error::Parameter`], [`Error::NonFinite`].
///
/// **Source**: the bound is that of Yang, Li, Campbell, Jia, "Go-ICP: a globally optimal solution to 3D ICP
/// point-set registration", 2016, in the plane, where the ball of rotations is an interval and the chord exact;
/// the cost is truncated, the search a single one over all three dimensions.
pub fn branch_and_bound_2d(
    target: &Target<2>,
    source: &Cloud<2>,
    start: &Isometry2<f64>,
    params: &SearchParams,
) -> Result<GlobalMatch, Error> {
    check_params(params)?;
    if source.is_empty() {
        return Err(Error::TooFewPoints { what: "the source", found: 0, needed: 1 });
    }
    if !start.to_row_major().iter().all(|v| v.is_finite()) {
        return Err(Error::NonFinite { what: "the initial pose" });
    }
    let tau_sq = params.truncation * params.truncation;
    let mut search = Search::new(target, source, start, params)?;
    let mut modes: Vec<Mode> = Vec::new();
    for _ in 0..params.modes {
        let root = search.window.root();
        let Some(found) = best_first(&mut search, root, params.gap * tau_sq, params.max_nodes)? else {
            break;
        };
        search.found.push(found.pose);
        modes.push(Mode {
            target_from_source: found.pose,
            cost: found.cost,
            score: 1.0 - found.cost / tau_sq,
            lower_bound: found.lower_bound,
            certified: found.certified,
            nodes: found.nodes,
        });
    }
    Ok(GlobalMatch { modes })
}

fn check_params(p: &SearchParams) -> Result<(), Error> {
    check("translation", p.translation, p.translation >= 0.0 && p.translation.is_finite(), "0 or more")?;
    check("rotation", p.rotation, p.rotation >= 0.0, "0 or more")?;
    check("truncation", p.truncation, p.truncation > 0.0 && p.truncation.is_finite(), "more than 0")?;
    check("keep", p.keep, p.keep > 0.0 && p.keep <= 1.0, "(0, 1]")?;
    check("gap", p.gap, p.gap > 0.0, "more than 0")?;
    check("separation", p.separation, p.separation > 0.0, "more than 0")?;
    check("separation_rotation", p.separation_rotation, p.separation_rotation > 0.0, "more than 0")?;
    check("max_points", p.max_points as f64, p.max_points > 0, "1 or more")?;
    check("modes", p.modes as f64, p.modes > 0, "1 or more")
}

/// A box of poses; `centroid` is relative to the target's origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region {
    pub(super) angle: f64,
    pub(super) centroid: Vector2<f64>,
    pub(super) half_angle: f64,
    pub(super) half_width: f64,
}

struct Search<'a> {
    params: &'a SearchParams,
    target: &'a Target<2>,
    grid: NearGrid,
    /// Source points about their centroid, in an order that mixes near and far.
    points: Vec<Vector2<f64>>,
    radii: Vec<f64>,
    mean_radius: f64,
    source_centre: Vector2<f64>,
    cloud: Cloud<2>,
    polish: IcpParams,
    window: Window,
    /// Modes already found, which the search leaves out.
    found: Vec<Isometry2<f64>>,
    /// Squares of the least and the likely distances of the points in a box.
    least: Vec<f64>,
    near: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(
        target: &'a Target<2>,
        source: &Cloud<2>,
        start: &Isometry2<f64>,
        params: &'a SearchParams,
    ) -> Result<Self, Error> {
        let (source_centre, all) = crate::icp::centre(source.points());
        let n = all.len();
        let used = n.min(params.max_points);
        let mut points: Vec<_> = (0..used).map(|i| all[i * n / used]).collect();
        let stride = scattering_stride(used);
        points = (0..used).map(|i| points[i * stride % used]).collect();
        let radii: Vec<f64> = points.iter().map(|p| p.norm()).collect();
        let places = (0..target.len()).map(|i| *target.tree.point_at(i));
        Ok(Self {
            params,
            target,
            grid: NearGrid::new(places, params.truncation, cells_per_reach(params.gap)),
            mean_radius: radii.iter().sum::<f64>() / used as f64,
            radii,
            cloud: Cloud::new(points.iter().map(|p| p + source_centre).collect())?,
            points,
            source_centre,
            polish: IcpParams {
                max_distance: params.truncation,
                rejectors: vec![Rejector::Trimmed { keep: params.keep }],
                residual: Residual::PointToPoint,
                covariance: crate::Covariance::Residual,
                acceleration: Acceleration::None,
                stop: StopRule { max_iterations: 15, ..StopRule::default() },
                ..IcpParams::sonar_2d()
            },
            window: Window::new(start, params, source_centre, target.origin),
            found: Vec::new(),
            least: Vec::with_capacity(used),
            near: Vec::with_capacity(used),
        })
    }

    fn cost(&self, pose: &Isometry2<f64>) -> f64 {
        let tau = self.params.truncation;
        let mut squares: Vec<f64> = self
            .cloud
            .points()
            .iter()
            .map(|p| {
                let place = pose.transform_point(&(*p).into()).coords - self.target.origin;
                self.target.tree.nearest_within(&place, tau).map_or(tau * tau, |n| n.distance_sq)
            })
            .collect();
        mean_kept(&mut squares, self.params.keep)
    }

    fn is_near(&self, mode: &Isometry2<f64>, pose: &Isometry2<f64>) -> bool {
        let centre = self.source_centre.into();
        let apart = (mode.transform_point(&centre) - pose.transform_point(&centre)).norm();
        apart <= self.params.separation
            && angle_between(mode.rotation.angle(), pose.rotation.angle()) <= self.params.separation_rotation
    }

    /// Whether a region lies wholly within the separation of a mode.
    fn covers(&self, mode: &Isometry2<f64>, region: &Region) -> bool {
        let place = mode.transform_point(&self.source_centre.into()).coords - self.target.origin;
        let reach = (region.centroid - place).norm() + std::f64::consts::SQRT_2 * region.half_width;
        let turn = angle_between(mode.rotation.angle(), region.angle) + region.half_angle;
        reach <= self.params.separation && turn <= self.params.separation_rotation
    }
}

impl Boxes for Search<'_> {
    type Region = Region;
    type Pose = Isometry2<f64>;

    fn is_excluded(&self, region: &Region) -> bool {
        self.window.misses(region) || self.found.iter().any(|mode| self.covers(mode, region))
    }

    /// The box halved along what lets its points stray more.
    fn parts(&self, node: &Region) -> Vec<Region> {
        let turn = 2.0 * (0.5 * node.half_angle).min(0.5 * PI).sin() * self.mean_radius;
        if turn > std::f64::consts::SQRT_2 * node.half_width {
            let half = 0.5 * node.half_angle;
            [-half, half].map(|d| Region { angle: node.angle + d, half_angle: half, ..*node }).to_vec()
        } else {
            let half = 0.5 * node.half_width;
            [(-half, -half), (-half, half), (half, -half), (half, half)]
                .map(|(x, y)| Region {
                    centroid: node.centroid + Vector2::new(x, y),
                    half_width: half,
                    ..*node
                })
                .to_vec()
        }
    }

    fn bounds(&mut self, node: &Region, cut: f64) -> (f64, f64) {
        let tau = self.params.truncation;
        let chord = 2.0 * (0.5 * node.half_angle).min(0.5 * PI).sin();
        let shift = std::f64::consts::SQRT_2 * node.half_width;
        let exact = chord * self.mean_radius + shift < 0.25 * self.grid.slack();
        let rotation = Rotation2::new(node.angle);
        let kept = kept_of(self.points.len(), self.params.keep) as f64;
        // what the points left out by trimming may take at most
        let left_out = (self.points.len() as f64 - kept) * tau * tau;
        let mut lower = 0.0;
        self.least.clear();
        self.near.clear();
        for (point, radius) in self.points.iter().zip(&self.radii) {
            let place = rotation * point + node.centroid;
            let (bound, near) = if exact {
                let d = self.target.tree.nearest_within(&place, tau).map_or(tau, |n| n.distance_sq.sqrt());
                (d, d)
            } else {
                self.grid.bound(&place)
            };
            let least = (bound.min(tau) - radius * chord - shift).max(0.0);
            lower += least * least;
            if lower - left_out > cut * kept {
                return ((lower - left_out) / kept, f64::INFINITY);
            }
            self.least.push(least * least);
            self.near.push(near.min(tau).powi(2));
        }
        (mean_kept(&mut self.least, self.params.keep), mean_kept(&mut self.near, self.params.keep))
    }

    /// Polishes the centre of a box that looks better than the best pose.
    fn improve(
        &mut self,
        node: &Region,
        estimate: f64,
        best: f64,
    ) -> Result<Option<(f64, Isometry2<f64>)>, Error> {
        if estimate >= best {
            return Ok(None);
        }
        let rotation = Rotation2::new(node.angle);
        let translation = node.centroid + self.target.origin - rotation * self.source_centre;
        let centre = Isometry2::new(translation, node.angle);
        let polished = self.target.align(&self.cloud, &centre, &self.polish)?.target_from_source;
        let is_allowed = |pose: &Isometry2<f64>| {
            self.window.holds(pose) && !self.found.iter().any(|mode| self.is_near(mode, pose))
        };
        Ok([centre, polished]
            .into_iter()
            .filter(is_allowed)
            .map(|pose| (self.cost(&pose), pose))
            .filter(|(cost, _)| *cost < best)
            .min_by(|a, b| a.0.total_cmp(&b.0)))
    }
}

/// Cells of the distance grid along the truncation, so that a cell blurs the cost by less than the gap does.
fn cells_per_reach(gap: f64) -> f64 {
    (2.0 / gap.sqrt()).max(16.0)
}
