use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

use draco_lie::LieGroup;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::cloud::Cloud;
use crate::error::check;
use crate::icp::{IcpParams, Optimizer, Rejector, Residual, StopRule, Target};
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
    /// Boxes examined at most. Default 200 000.
    pub max_nodes: usize,
}

impl SearchParams3 {
    /// All rotations, and translations within `translation` metres.
    pub fn all_rotations(translation: f64, gap: f64) -> Self {
        Self { translation, rotation: PI, gap, keep: 1.0, max_points: 200, max_nodes: 200_000 }
    }
}

/// What a global search in three dimensions found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlobalMatch3 {
    /// Maps source points into the target's frame.
    pub target_from_source: Isometry3<f64>,
    /// Mean squared distance of all source points (the share that counts) to the target, m².
    pub cost: f64,
    /// No pose of the box costs less, on the points drawn, m².
    pub lower_bound: f64,
    /// Whether the search ended by its gap and not by its number of boxes.
    pub certified: bool,
    /// Boxes examined.
    pub nodes: usize,
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
/// 2016. We search one six-dimensional tree instead of one of translations inside one of rotations, query the
/// k-d tree instead of a distance transform, so the bounds are exact, and draw a subset of points.
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
    Search::new(target, source, start, params)?.run()
}

#[derive(Debug, Clone, Copy)]
struct Node {
    lower: f64,
    id: usize,
    rotation: Vector3<f64>,
    translation: Vector3<f64>,
    half_angle: f64,
    half_width: f64,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Node {}
impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Node {
    /// The heap's greatest is the box with the smallest lower bound, older first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.lower.total_cmp(&self.lower).then(other.id.cmp(&self.id))
    }
}

/// Boxes of rotations at least this wide (half, radians) are polished at their centre without being asked.
const POLISHED_HALF_ANGLE: f64 = PI / 8.0;

struct Search<'a> {
    params: &'a SearchParams3,
    target: &'a Target<3>,
    start: Isometry3<f64>,
    drawn: Cloud<3>,
    radii: Vec<f64>,
    mean_radius: f64,
    all: &'a Cloud<3>,
    polish: IcpParams,
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
        let points: Vec<_> = (0..used).map(|i| source.points()[i * n / used]).collect();
        let radii: Vec<f64> = points.iter().map(|p| p.norm()).collect();
        let rejectors =
            if params.keep < 1.0 { vec![Rejector::Trimmed { keep: params.keep }] } else { Vec::new() };
        let span = source.points().iter().map(|p| p.norm()).fold(0.0, f64::max);
        let polish = IcpParams {
            max_distance: 4.0 * (span + params.translation).max(f64::MIN_POSITIVE) + 1.0,
            rejectors,
            residual: Residual::PointToPoint,
            optimizer: Optimizer::ClosedForm,
            covariance: crate::Covariance::Residual,
            stop: StopRule { max_iterations: 60, translation: 1e-3 * span, rotation: 1e-3, window: 1 },
            ..IcpParams::sonar_2d()
        };
        Ok(Self {
            params,
            target,
            start: *start,
            mean_radius: radii.iter().sum::<f64>() / used as f64,
            radii,
            drawn: Cloud::new(points)?,
            all: source,
            polish,
        })
    }

    fn run(&self) -> Result<GlobalMatch3, Error> {
        let root = Node {
            lower: 0.0,
            id: 0,
            rotation: Vector3::zeros(),
            translation: Vector3::zeros(),
            half_angle: self.params.rotation.min(PI),
            half_width: self.params.translation,
        };
        let mut best = (f64::INFINITY, self.start);
        self.try_pose(&root, &mut best)?;
        let mut heap = BinaryHeap::from([root]);
        let (mut nodes, mut lower_bound, mut certified) = (0usize, f64::INFINITY, true);
        'search: while let Some(node) = heap.pop() {
            if node.lower >= best.0 - self.params.gap || nodes >= self.params.max_nodes {
                certified = node.lower >= best.0 - self.params.gap;
                lower_bound = lower_bound.min(node.lower);
                break;
            }
            for mut child in self.parts(&node) {
                nodes += 1;
                child.id = nodes;
                let turned = child.half_angle < node.half_angle;
                let (lower, estimate) = self.bounds(&child, best.0 - self.params.gap);
                child.lower = lower.max(node.lower);
                if (turned && child.half_angle >= POLISHED_HALF_ANGLE) || estimate < best.0 {
                    self.try_pose(&child, &mut best)?;
                    if best.0 <= self.params.gap {
                        // no cost is below zero, so the gap is closed
                        lower_bound = 0.0;
                        break 'search;
                    }
                }
                if child.lower < best.0 - self.params.gap {
                    heap.push(child);
                } else {
                    lower_bound = lower_bound.min(child.lower);
                }
            }
        }
        let (cost, target_from_source) = best;
        Ok(GlobalMatch3 { target_from_source, cost, lower_bound: lower_bound.min(cost), certified, nodes })
    }

    /// The box cut in eight along what lets its points stray more; rotations beyond π are left out, since they
    /// are the same as others inside.
    fn parts(&self, node: &Node) -> Vec<Node> {
        let root3 = 3f64.sqrt();
        let turn = 2.0 * (0.5 * root3 * node.half_angle).min(0.5 * PI).sin() * self.mean_radius;
        let corners = (0..8).map(|k| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -0.5 } else { 0.5 }));
        if turn > root3 * node.half_width {
            let half_angle = 0.5 * node.half_angle;
            corners
                .map(|c| Node { rotation: node.rotation + c * node.half_angle, half_angle, ..*node })
                .filter(|n| n.rotation.norm() - root3 * half_angle <= PI)
                .collect()
        } else {
            let half_width = 0.5 * node.half_width;
            corners
                .map(|c| Node { translation: node.translation + c * node.half_width, half_width, ..*node })
                .collect()
        }
    }

    fn pose(&self, node: &Node) -> Isometry3<f64> {
        let turn = <UnitQuaternion<f64> as LieGroup<3>>::exp(&node.rotation);
        let translation = self.start.translation.vector + node.translation;
        Isometry3::from_parts(Translation3::from(translation), self.start.rotation * turn)
    }

    /// A lower bound of the cost in the box and the cost at its centre, both on the drawn points. A sum beyond
    /// `cut` stops.
    fn bounds(&self, node: &Node, cut: f64) -> (f64, f64) {
        let root3 = 3f64.sqrt();
        let chord = 2.0 * (0.5 * root3 * node.half_angle).min(0.5 * PI).sin();
        let shift = root3 * node.half_width;
        let pose = self.pose(node);
        let (r, t) = (pose.rotation_matrix(), pose.translation_vector() - self.target.origin);
        let n = self.radii.len() as f64;
        let (mut lower, mut centre) = (Vec::with_capacity(self.radii.len()), 0.0);
        let mut sum = 0.0;
        for (point, radius) in self.drawn.points().iter().zip(&self.radii) {
            let distance_sq =
                self.target.tree.nearest(&(r * point + t)).map_or(f64::INFINITY, |n| n.distance_sq);
            let least = (distance_sq.sqrt() - radius * chord - shift).max(0.0);
            lower.push(least * least);
            sum += least * least;
            centre += distance_sq;
            if self.params.keep >= 1.0 && sum > cut * n {
                return (sum / n, f64::INFINITY);
            }
        }
        (self.mean_kept(&mut lower), centre / n)
    }

    fn mean_kept(&self, squares: &mut [f64]) -> f64 {
        let kept = ((squares.len() as f64 * self.params.keep).ceil() as usize).clamp(1, squares.len());
        if kept < squares.len() {
            squares.select_nth_unstable_by(kept - 1, f64::total_cmp);
        }
        squares[..kept].iter().sum::<f64>() / kept as f64
    }

    /// Polishes the centre of a box and keeps it if it is the best on all points.
    fn try_pose(&self, node: &Node, best: &mut (f64, Isometry3<f64>)) -> Result<(), Error> {
        let coarse = self.target.align(&self.drawn, &self.pose(node), &self.polish)?.target_from_source;
        if self.cost(&self.drawn, &coarse) > 1.5 * best.0 {
            return Ok(());
        }
        let pose = self.target.align(self.all, &coarse, &self.polish)?.target_from_source;
        let moved = self.start.translation.vector - pose.translation.vector;
        let turned = (self.start.rotation.inverse() * pose.rotation).log();
        let inside = moved.amax() <= self.params.translation
            && (self.params.rotation >= PI || turned.amax() <= self.params.rotation);
        let cost = self.cost(self.all, &pose);
        if inside && cost < best.0 {
            *best = (cost, pose);
        }
        Ok(())
    }

    fn cost(&self, cloud: &Cloud<3>, pose: &Isometry3<f64>) -> f64 {
        let (r, t) = (pose.rotation_matrix(), pose.translation_vector() - self.target.origin);
        let near = |p: &Vector3<f64>| {
            self.target.tree.nearest(&(r * p + t)).map_or(f64::INFINITY, |n| n.distance_sq)
        };
        self.mean_kept(&mut cloud.points().iter().map(near).collect::<Vec<_>>())
    }
}
