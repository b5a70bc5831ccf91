use std::f64::consts::PI;

use draco_lie::LieGroup;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::best_first::{Boxes, best_first, kept_of, mean_kept, scattering_stride};
use super::nearest_grid::NearestGrid;
use crate::cloud::Cloud;
use crate::error::check;
use crate::icp::{Acceleration, IcpParams, Optimizer, Rejector, Residual, StopRule, Target};
use crate::rigid_fit::rigid_fit;
use crate::{Error, RigidMotion};

/// What a global search in three dimensions looks for, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchParams3 {
    /// Half width of the cube searched for the source's origin, metres, about where the start puts it.
    pub translation: f64,
    /// Half width of the cube of rotation vectors searched about the start, radians; π (the default) holds all
    /// rotations.
    pub rotation: f64,
    /// The search ends when no pose can cost less than the best by more than this, m².
    pub gap: f64,
    /// Share of the points that count, those that fit best. Default 1.
    pub keep: f64,
    /// Source points used at most in bounds and polishing, evenly drawn; the cost is that of all. Default 200.
    pub max_points: usize,
    /// Boxes examined at most for each mode. Default 200 000.
    pub max_nodes: usize,
    /// Number of separate modes wanted, the best first. Default 1.
    pub modes: usize,
    /// Two poses are separate modes when the source's centroid differs by more than this, metres, or the rotation
    /// by more than [`SearchParams3::separation_rotation`]. Default a tenth of the translation.
    pub separation: f64,
    /// See [`SearchParams3::separation`], radians. Default 0.3.
    pub separation_rotation: f64,
}

impl SearchParams3 {
    /// All rotations, and translations within `translation` metres.
    pub fn all_rotations(translation: f64, gap: f64) -> Self {
        Self {
            translation,
            rotation: PI,
            gap,
            keep: 1.0,
            max_points: 200,
            max_nodes: 200_000,
            modes: 1,
            separation: 0.1 * translation,
            separation_rotation: 0.3,
        }
    }
}

/// One local optimum of a global search in three dimensions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode3 {
    /// Maps source points into the target's frame.
    pub target_from_source: Isometry3<f64>,
    /// Mean squared distance of all source points (the share that counts) to the target, m².
    pub cost: f64,
    /// No pose of the search region costs less, on the points drawn, m². For a rival the region leaves out the
    /// modes before.
    pub lower_bound: f64,
    /// Whether the search ended by its gap and not by its number of boxes.
    pub certified: bool,
    /// Boxes examined for it.
    pub nodes: usize,
}

/// What a global search in three dimensions found.
#[derive(Debug, Clone, PartialEq)]
pub struct GlobalMatch3 {
    /// Modes, best first; never empty.
    pub modes: Vec<Mode3>,
}

impl GlobalMatch3 {
    /// The best mode.
    pub fn best(&self) -> &Mode3 {
        &self.modes[0]
    }

    /// Root mean square distance of the best over that of its best rival, in [0, 1]; near 1 the answer is
    /// ambiguous. `None` when only one mode was asked for.
    pub fn ambiguity(&self) -> Option<f64> {
        let (best, rival) = (self.modes[0].cost, self.modes.get(1)?.cost);
        Some(if rival > 0.0 { (best / rival).min(1.0).sqrt() } else { 1.0 })
    }
}

/// Finds the pose with the least mean squared distance to the target over a box of SE(3), by branch and bound.
///
/// In a box of rotation vectors within `α` along each axis and translations within `h`, a point at radius `r`
/// strays at most `2 r sin(√3 α / 2) + √3 h`. Boxes are halved along what adds more; the centre of every large
/// box of rotations is polished by ICP, and of a small one when it promises a better pose.
///
/// # Errors
/// [`Error::TooFewPoints`], [`Error::Parameter`], [`Error::NonFinite`].
///
/// **Source**: Yang, Li, Campbell, Jia, "Go-ICP: a globally optimal solution to 3D ICP point-set registration",
/// 2016. We search one six-dimensional tree instead of one of translations inside one of rotations, look wide boxes up
/// in a grid that holds nearest points of a thousand target points (with their cover as slack) and ask a k-d tree for
/// narrow ones, draw a subset of points, and polish a box fully only when a short polish of 40 points over that grid
/// looks promising and so does a long one of the points drawn over the coarse target.
pub fn branch_and_bound_3d(
    target: &Target<3>,
    source: &Cloud<3>,
    start: &Isometry3<f64>,
    params: &SearchParams3,
) -> Result<GlobalMatch3, Error> {
    check(
        "translation",
        params.translation,
        params.translation >= 0.0 && params.translation.is_finite(),
        "0 or more",
    )?;
    check("rotation", params.rotation, params.rotation >= 0.0, "0 or more")?;
    check("gap", params.gap, params.gap > 0.0, "more than 0")?;
    check("keep", params.keep, params.keep > 0.0 && params.keep <= 1.0, "(0, 1]")?;
    check("max_points", params.max_points as f64, params.max_points > 0, "1 or more")?;
    check("max_nodes", params.max_nodes as f64, params.max_nodes > 0, "1 or more")?;
    if source.is_empty() {
        return Err(Error::TooFewPoints { what: "the source", found: 0, needed: 1 });
    }
    if !start.to_row_major().iter().all(|v| v.is_finite()) {
        return Err(Error::NonFinite { what: "the initial pose" });
    }
    check("modes", params.modes as f64, params.modes > 0, "1 or more")?;
    if params.modes > 1 {
        check("separation", params.separation, params.separation > 0.0, "more than 0")?;
        let apart = params.separation_rotation;
        check("separation_rotation", apart, apart > 0.0, "more than 0")?;
    }
    let mut search = Search::new(target, source, start, params)?;
    let mut modes = Vec::with_capacity(params.modes);
    for _ in 0..params.modes {
        let root = search.root();
        let Some(found) = best_first(&mut search, root, params.gap, params.max_nodes)? else { break };
        search.found.push(found.pose);
        modes.push(Mode3 {
            target_from_source: found.pose,
            cost: found.cost,
            lower_bound: found.lower_bound,
            certified: found.certified,
            nodes: found.nodes,
        });
    }
    Ok(GlobalMatch3 { modes })
}

#[derive(Debug, Clone, Copy)]
struct Region {
    rotation: Vector3<f64>,
    translation: Vector3<f64>,
    half_angle: f64,
    half_width: f64,
    /// Whether its rotations are those of no region before it.
    turned: bool,
}

/// Boxes of rotations at least this wide (half, radians) are polished at their centre without being asked.
const POLISHED_HALF_ANGLE: f64 = PI / 8.0;

/// Target points of the coarse target: queries far from a surface visit many of its points, and most are far.
const COARSE_POINTS: usize = 1000;

/// Source points of the first polish, which only has to tell a promising box.
const SCOUTS: usize = 40;

/// The first polish ends when a step leaves more than this share of the cost.
const SETTLED: f64 = 0.95;

/// A scouted pose is polished fully when its cost is below this multiple of the best.
const PROMISING: f64 = 3.0;

/// A pose polished on a part of the points is polished on more when its cost is below this multiple of the best.
const WORTH_POLISHING: f64 = 1.5;

struct Search<'a> {
    params: &'a SearchParams3,
    target: &'a Target<3>,
    start: Isometry3<f64>,
    /// A part of the target's points, spread evenly.
    coarse: Target<3>,
    /// No target point is farther from a coarse one, metres.
    cover: f64,
    /// Mean squared distance of a target point to the nearest coarse one, m².
    mean_cover_sq: f64,
    grid: NearestGrid,
    scouts: Vec<Vector3<f64>>,
    drawn: Cloud<3>,
    radii: Vec<f64>,
    mean_radius: f64,
    all: &'a Cloud<3>,
    centroid: Vector3<f64>,
    polish: IcpParams,
    /// Modes already found, which the search leaves out.
    found: Vec<Isometry3<f64>>,
    buffer: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(
        target: &'a Target<3>,
        source: &'a Cloud<3>,
        start: &Isometry3<f64>,
        params: &'a SearchParams3,
    ) -> Result<Self, Error> {
        let n = source.len();
        let used = n.min(params.max_points);
        let stride = scattering_stride(used);
        let points: Vec<_> = (0..used).map(|i| source.points()[(i * stride % used) * n / used]).collect();
        let radii: Vec<f64> = points.iter().map(|p| p.norm()).collect();
        let rejectors =
            if params.keep < 1.0 { vec![Rejector::Trimmed { keep: params.keep }] } else { Vec::new() };
        let span = source.points().iter().map(|p| p.norm()).fold(0.0, f64::max);
        let polish = IcpParams {
            acceleration: Acceleration::Anderson,
            max_distance: 4.0 * (span + params.translation).max(f64::MIN_POSITIVE) + 1.0,
            rejectors,
            residual: Residual::PointToPoint,
            optimizer: Optimizer::ClosedForm,
            covariance: crate::Covariance::Residual,
            stop: StopRule { max_iterations: 60, translation: 1e-3 * span, rotation: 1e-3, window: 1 },
            ..IcpParams::sonar_2d()
        };
        // neighbours in the tree's order lie close together, so every k-th point covers them all
        let every = target.len().div_ceil(COARSE_POINTS);
        let coarse: Vec<_> =
            (0..target.len()).step_by(every).map(|i| target.tree.point_at(i) + target.origin).collect();
        let coarse = Target::new(&Cloud::new(coarse)?)?;
        let (cover, mean_cover_sq) = cover(target, &coarse);
        Ok(Self {
            params,
            target,
            start: *start,
            grid: NearestGrid::new(&coarse),
            coarse,
            cover,
            mean_cover_sq,
            scouts: points.iter().take(SCOUTS).copied().collect(),
            mean_radius: radii.iter().sum::<f64>() / used as f64,
            radii,
            drawn: Cloud::new(points)?,
            all: source,
            centroid: crate::icp::centre(source.points()).0,
            polish,
            found: Vec::new(),
            buffer: Vec::with_capacity(used),
        })
    }

    fn root(&self) -> Region {
        Region {
            rotation: Vector3::zeros(),
            translation: Vector3::zeros(),
            half_angle: self.params.rotation.min(PI),
            half_width: self.params.translation,
            turned: true,
        }
    }

    fn pose(&self, node: &Region) -> Isometry3<f64> {
        let turn = <UnitQuaternion<f64> as LieGroup<3>>::exp(&node.rotation);
        let translation = self.start.translation.vector + node.translation;
        Isometry3::from_parts(Translation3::from(translation), self.start.rotation * turn)
    }

    fn cost(&self, target: &Target<3>, cloud: &Cloud<3>, pose: &Isometry3<f64>) -> f64 {
        let (r, t) = (pose.rotation_matrix(), pose.translation_vector() - target.origin);
        let near =
            |p: &Vector3<f64>| target.tree.nearest(&(r * p + t)).map_or(f64::INFINITY, |n| n.distance_sq);
        mean_kept(&mut cloud.points().iter().map(near).collect::<Vec<_>>(), self.params.keep)
    }

    /// A pose near `start` that fits the scouts better, by ICP over the grid, and its cost.
    fn scout(&self, start: &Isometry3<f64>) -> (Isometry3<f64>, f64) {
        let (mut r, mut t) = (start.rotation_matrix(), start.translation_vector() - self.coarse.origin);
        let mut pairs: Vec<(Vector3<f64>, Vector3<f64>, f64)> = Vec::with_capacity(self.scouts.len());
        let mut buffer = Vec::with_capacity(self.scouts.len());
        let mut before = f64::INFINITY;
        loop {
            pairs.clear();
            for p in &self.scouts {
                let place = r * p + t;
                let partner = self.grid.near(&place).copied().or_else(|| self.coarse_near(&place));
                pairs.extend(partner.map(|q| (*p, q, (q - place).norm_squared())));
            }
            buffer.clear();
            buffer.extend(pairs.iter().map(|pair| pair.2));
            let cost = mean_kept(&mut buffer, self.params.keep);
            let limit =
                if self.params.keep < 1.0 { last_kept(&buffer, self.params.keep) } else { f64::INFINITY };
            if cost >= SETTLED * before {
                break (Isometry3::from_matrix(&r, &(t + self.coarse.origin)), cost);
            }
            before = cost;
            let kept = pairs.iter().filter(|pair| pair.2 <= limit).map(|(p, q, _)| (*p, *q, 1.0));
            (r, t) = rigid_fit::<3, 6, Isometry3<f64>>(kept).unwrap_or((r, t));
        }
    }

    /// The distance to the nearest target point, twice.
    #[inline]
    fn exact_bounds(&self, place: &Vector3<f64>) -> (f64, f64) {
        let distance = self.target.tree.nearest_from(place, 0).1.sqrt();
        (distance, distance)
    }

    /// A lower bound of the distance to the nearest target point, and the distance to one.
    #[inline]
    fn coarse_bounds(&self, place: &Vector3<f64>) -> (f64, f64) {
        let (low, high) = self.grid.bounds(place).unwrap_or_else(|| {
            let distance = self.coarse.tree.nearest_from(place, 0).1.sqrt();
            (distance, distance)
        });
        (low - self.cover, high)
    }

    fn coarse_near(&self, place: &Vector3<f64>) -> Option<Vector3<f64>> {
        let guess = 0;
        Some(*self.coarse.tree.point_at(self.coarse.tree.nearest_from(place, guess).0 as usize))
    }

    /// Whether a pose is one of the modes already found.
    fn is_taken(&self, pose: &Isometry3<f64>) -> bool {
        self.found.iter().any(|mode| {
            (mode.transform(&self.centroid) - pose.transform(&self.centroid)).norm() <= self.params.separation
                && mode.rotation.angle_to(&pose.rotation) <= self.params.separation_rotation
        })
    }
}

impl Boxes for Search<'_> {
    type Region = Region;
    type Pose = Isometry3<f64>;

    fn is_excluded(&self, region: &Region) -> bool {
        let root3 = 3f64.sqrt();
        let pose = self.pose(region);
        self.found.iter().any(|mode| {
            // a turn by `a` moves the centroid by no more than its chord about the source's origin
            let chord = 2.0 * (0.5 * root3 * region.half_angle).min(0.5 * PI).sin() * self.centroid.norm();
            let apart = (mode.transform(&self.centroid) - pose.transform(&self.centroid)).norm();
            apart + chord + root3 * region.half_width <= self.params.separation
                && mode.rotation.angle_to(&pose.rotation) + root3 * region.half_angle
                    <= self.params.separation_rotation
        })
    }

    /// The box cut in eight along what lets its points stray more; rotations beyond π are left out, since they
    /// are the same as others inside.
    fn parts(&self, node: &Region) -> Vec<Region> {
        let root3 = 3f64.sqrt();
        let turn = 2.0 * (0.5 * root3 * node.half_angle).min(0.5 * PI).sin() * self.mean_radius;
        let corners = (0..8).map(|k| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -0.5 } else { 0.5 }));
        if turn > root3 * node.half_width {
            let half_angle = 0.5 * node.half_angle;
            corners
                .map(|c| Region {
                    rotation: node.rotation + c * node.half_angle,
                    half_angle,
                    turned: true,
                    ..*node
                })
                .filter(|n| n.rotation.norm() - root3 * half_angle <= PI)
                .collect()
        } else {
            let half_width = 0.5 * node.half_width;
            corners
                .map(|c| Region {
                    translation: node.translation + c * node.half_width,
                    half_width,
                    turned: false,
                    ..*node
                })
                .collect()
        }
    }

    fn bounds(&mut self, node: &Region, cut: f64) -> (f64, f64) {
        let root3 = 3f64.sqrt();
        let chord = 2.0 * (0.5 * root3 * node.half_angle).min(0.5 * PI).sin();
        let shift = root3 * node.half_width;
        let pose = self.pose(node);
        // far boxes are bounded by the coarse target, whose distances exceed the true ones by at most its cover
        let exact = chord * self.mean_radius + shift < 2.0 * self.cover;
        let origin = if exact { self.target.origin } else { self.coarse.origin };
        let (r, t) = (pose.rotation_matrix(), pose.translation_vector() - origin);
        let n = self.radii.len() as f64;
        let (mut sum, mut centre) = (0.0, 0.0);
        self.buffer.clear();
        for (point, radius) in self.drawn.points().iter().zip(&self.radii) {
            let place = r * point + t;
            let (low, high) = if exact { self.exact_bounds(&place) } else { self.coarse_bounds(&place) };
            let least = (low - radius * chord - shift).max(0.0);
            centre += high * high;
            self.buffer.push(least * least);
            sum += least * least;
            if self.params.keep >= 1.0 && sum > cut * n {
                return (sum / n, f64::INFINITY);
            }
        }
        (mean_kept(&mut self.buffer, self.params.keep), centre / n)
    }

    fn improve(
        &mut self,
        region: &Region,
        estimate: f64,
        best: f64,
    ) -> Result<Option<(f64, Isometry3<f64>)>, Error> {
        if !((region.turned && region.half_angle >= POLISHED_HALF_ANGLE) || estimate < best) {
            return Ok(None);
        }
        let (scouted, cost) = self.scout(&self.pose(region));
        if cost > PROMISING * best {
            return Ok(None);
        }
        // a full polish takes many small steps, most of them in vain: the coarse target tells where
        let coarse = self.coarse.align(&self.drawn, &scouted, &self.polish)?.target_from_source;
        if self.cost(&self.coarse, &self.drawn, &coarse) > WORTH_POLISHING * best + self.mean_cover_sq {
            return Ok(None);
        }
        let pose = self.target.align(&self.drawn, &coarse, &self.polish)?.target_from_source;
        if self.drawn.len() < self.all.len()
            && self.cost(self.target, &self.drawn, &pose) > WORTH_POLISHING * best
        {
            return Ok(None);
        }
        let pose = if self.drawn.len() < self.all.len() {
            self.target.align(self.all, &pose, &self.polish)?.target_from_source
        } else {
            pose
        };
        let moved = self.start.translation.vector - pose.translation.vector;
        let turned = (self.start.rotation.inverse() * pose.rotation).log();
        let inside = moved.amax() <= self.params.translation
            && (self.params.rotation >= PI || turned.amax() <= self.params.rotation);
        let cost = self.cost(self.target, self.all, &pose);
        Ok((inside && cost < best && !self.is_taken(&pose)).then_some((cost, pose)))
    }
}

/// The largest of the values [`mean_kept`] has just kept.
fn last_kept(squares: &[f64], keep: f64) -> f64 {
    squares[..kept_of(squares.len(), keep)].iter().copied().fold(0.0, f64::max)
}

/// The largest distance from a point of `target` to the nearest of `coarse`, and the mean of the squares.
fn cover(target: &Target<3>, coarse: &Target<3>) -> (f64, f64) {
    let shift = target.origin - coarse.origin;
    let places: Vec<_> = (0..target.len()).map(|i| target.tree.point_at(i) + shift).collect();
    let (mut most, mut sum) = (0.0f64, 0.0);
    for (_, distance_sq) in coarse.tree.nearest_to_each(&places) {
        most = most.max(distance_sq);
        sum += distance_sq;
    }
    (most.sqrt(), sum / target.len() as f64)
}
