use std::collections::BTreeMap;

use draco_graphmatch::dbscan;
use nalgebra::{Isometry2, Matrix2, Point2, Vector2};
use serde::{Deserialize, Serialize};

use super::persistence::stays;
use super::rectangle::{Rectangle, minimum_area_rectangle};
use crate::Error;
use crate::keyframe::Keyframe;

/// What counts as an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectParams {
    /// Points closer than this belong together, metres. Default 1.5, as the published system.
    pub eps_m: f64,
    /// Points within `eps_m` that make a core. Default 20, as the published system.
    pub min_samples: usize,
    /// Shorter clusters are dropped, metres. Default 2: a group of four piles on a square of 1.6 m stays. The
    /// published system asks for 3, measured on dense pixels.
    pub min_length_m: f64,
    /// Longer clusters are cut into pieces, metres. Default 10: the middle of a quay depends on how much of it was
    /// seen, that of a bounded piece does not by more than a few metres. Infinite keeps clusters whole, as the
    /// published system does.
    pub max_length_m: f64,
    /// Keyframes that must have contributed. Default 2: what only one scan saw may have been passing by.
    pub min_keyframes: usize,
    /// Whether places that more keyframes looked through than saw something at are left out: what moves. Default yes; the
    /// published system keeps them.
    pub drop_moving: bool,
    /// How the centroid is taken. Default [`Centroid::Area`].
    pub centroid: Centroid,
}

/// What the middle of an object is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Centroid {
    /// Mean of the cells of this edge, metres, that hold a point, so that a side seen ten times weighs no more than
    /// one seen once.
    Area(f64),
    /// Mean of all points, as the published system has it; drifts towards the side seen most.
    Points,
}

impl Default for ObjectParams {
    fn default() -> Self {
        Self {
            eps_m: 1.5,
            min_samples: 20,
            min_length_m: 2.0,
            max_length_m: 10.0,
            min_keyframes: 2,
            drop_moving: true,
            centroid: Centroid::Area(0.3),
        }
    }
}

impl ObjectParams {
    /// The published system: whole clusters from 3 m, mean of all points, one keyframe is enough, moving or not.
    pub fn published() -> Self {
        Self {
            min_length_m: 3.0,
            max_length_m: f64::INFINITY,
            min_keyframes: 1,
            drop_moving: false,
            centroid: Centroid::Points,
            ..Self::default()
        }
    }
}

/// Something that stands in the water.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// Number within the robot; see [`ObjectTracks`](super::ObjectTracks) for numbers that last.
    pub id: u32,
    /// Its middle, metres.
    pub centroid: Point2<f64>,
    /// Covariance of the centroid from the spread between keyframes, m².
    pub covariance: Matrix2<f64>,
    /// Long side of its rectangle, metres.
    pub length: f64,
    /// Short side of its rectangle, metres.
    pub breadth: f64,
    /// Corners of its rectangle.
    pub corners: [Point2<f64>; 4],
    /// Indices of the keyframes that saw it, ascending.
    pub keyframes: Vec<u32>,
    /// How many points it has.
    pub points: usize,
}

/// Least standard deviation of a centroid, metres: the resolution of the points.
const CENTROID_FLOOR_M: f64 = 0.1;

/// The objects in the map that `keyframes`, put at `poses`, make; numbered in the order in which their clusters were
/// first seen. Cost O(n log n) in the number of points.
///
/// # Errors
/// [`Error::Matching`] when `eps_m` or `min_samples` is out of range or a point is not finite.
pub fn extract(
    keyframes: &[Keyframe],
    poses: &[Isometry2<f64>],
    params: &ObjectParams,
) -> Result<Vec<Object>, Error> {
    let mut points = Vec::new();
    let mut seen_by = Vec::new();
    let stay = params.drop_moving.then(|| stays(keyframes, poses));
    for (at, (keyframe, pose)) in keyframes.iter().zip(poses).enumerate() {
        let kept = |place: usize| stay.as_ref().is_none_or(|stay| stay[at][place]);
        for (_, point) in keyframe.points.iter().enumerate().filter(|(place, _)| kept(*place)) {
            points.push(pose * point);
            seen_by.push(keyframe.index);
        }
    }
    let mut clusters: BTreeMap<usize, Vec<Member>> = BTreeMap::new();
    let labels = dbscan(&points, params.eps_m, params.min_samples)?;
    for ((label, &point), &keyframe) in labels.into_iter().zip(&points).zip(&seen_by) {
        if let Some(label) = label {
            clusters.entry(label).or_default().push(Member { point, keyframe });
        }
    }
    let pieces = clusters.into_values().flat_map(|cluster| split(cluster, params.max_length_m));
    let mut objects: Vec<Object> = pieces.filter_map(|piece| describe(&piece, params)).collect();
    for (object, id) in objects.iter_mut().zip(0..) {
        object.id = id;
    }
    Ok(objects)
}

/// A point of a cluster and the keyframe that saw it.
#[derive(Clone, Copy)]
struct Member {
    point: Point2<f64>,
    keyframe: u32,
}

fn rectangle_of(members: &[Member]) -> Option<Rectangle> {
    let points: Vec<_> = members.iter().map(|member| member.point).collect();
    minimum_area_rectangle(&points)
}

/// Cuts a cluster across its long side into equal pieces of at most `max_length`; a bent cluster is cut again.
fn split(cluster: Vec<Member>, max_length: f64) -> Vec<Vec<Member>> {
    let Some(rectangle) = rectangle_of(&cluster).filter(|rectangle| rectangle.length > max_length) else {
        return vec![cluster];
    };
    let count = (rectangle.length / max_length).ceil() as usize;
    let [start, end, ..] = rectangle.corners;
    let axis = (end - start) / rectangle.length;
    let mut pieces = vec![Vec::new(); count];
    for member in cluster {
        let along = (member.point - start).dot(&axis) / rectangle.length;
        let piece = ((along * count as f64) as usize).min(count - 1);
        pieces[piece].push(member);
    }
    pieces.retain(|piece| !piece.is_empty());
    // Pieces are shorter along the cut than the whole; only where they are long across it another cut is due.
    if pieces.len() < 2 {
        return pieces;
    }
    pieces.into_iter().flat_map(|piece| split(piece, max_length)).collect()
}

fn describe(members: &[Member], params: &ObjectParams) -> Option<Object> {
    let rectangle = rectangle_of(members)?;
    let mut by_keyframe: BTreeMap<u32, Vec<Point2<f64>>> = BTreeMap::new();
    for member in members {
        by_keyframe.entry(member.keyframe).or_default().push(member.point);
    }
    if rectangle.length < params.min_length_m || by_keyframe.len() < params.min_keyframes {
        return None;
    }
    let centroid = match params.centroid {
        Centroid::Points => mean(members.iter().map(|member| member.point)),
        Centroid::Area(cell) => {
            let of_cell = |point: &Point2<f64>| point.coords.map(|value| (value / cell).floor() as i64);
            let mut cells: BTreeMap<[i64; 2], Vec<Point2<f64>>> = BTreeMap::new();
            for member in members {
                cells.entry(of_cell(&member.point).into()).or_default().push(member.point);
            }
            mean(cells.values().map(|points| mean(points.iter().copied())))
        }
    };
    Some(Object {
        id: 0,
        centroid,
        covariance: centroid_covariance(&by_keyframe),
        length: rectangle.length,
        breadth: rectangle.breadth,
        corners: rectangle.corners,
        keyframes: by_keyframe.into_keys().collect(),
        points: members.len(),
    })
}

fn mean(points: impl Iterator<Item = Point2<f64>>) -> Point2<f64> {
    let (sum, count) = points.fold((Vector2::zeros(), 0.0), |(sum, count), p| (sum + p.coords, count + 1.0));
    Point2::from(sum / f64::max(count, 1.0))
}

/// Covariance of the mean of the keyframes' own centroids. Points of one scan share its pose error, so a keyframe,
/// not a point, counts as one observation; a single keyframe gets the spread of its points.
fn centroid_covariance(by_keyframe: &BTreeMap<u32, Vec<Point2<f64>>>) -> Matrix2<f64> {
    let samples: Vec<Point2<f64>> = match by_keyframe.len() {
        1 => by_keyframe.values().flatten().copied().collect(),
        _ => by_keyframe.values().map(|points| mean(points.iter().copied())).collect(),
    };
    let middle = mean(samples.iter().copied());
    let scatter: Matrix2<f64> =
        samples.iter().map(|sample| (sample - middle) * (sample - middle).transpose()).sum();
    let freedom = (samples.len() as f64 - 1.0).max(1.0);
    let spread = scatter / (freedom * by_keyframe.len() as f64);
    spread + Matrix2::identity() * CENTROID_FLOOR_M.powi(2)
}
