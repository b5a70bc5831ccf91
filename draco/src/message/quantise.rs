//! From SI units to whole numbers and back, and the shape of a message on the wire.

use nalgebra::{Isometry2, Matrix3, Point2, Vector2};
use serde::{Deserialize, Serialize};

use super::{
    CellUpdate, ClosureEntry, FactorEntry, GraphUpdate, KeyframeId, MapPlace, Message, ObjectEntry,
    ObjectUpdate, WireError, quadtree,
};
use crate::keyframe::RobotId;

/// Step sizes of everything that is quantised. They are part of the wire format: both ends must agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolution;

impl Resolution {
    /// Positions of poses: 1 cm, a tenth of the best registration sigma seen on real sonar.
    pub const POSITION_M: f64 = 0.01;
    /// Headings: 0.2 mrad, 2 cm at 100 m.
    pub const ANGLE_RAD: f64 = 2e-4;
    /// Points of a scan: 0.1 m; features are thinned to one in 0.3 to 0.5 m before.
    pub const SCAN_M: f64 = 0.1;
    /// Centres and sides of objects: 0.1 m.
    pub const OBJECT_M: f64 = 0.1;
    /// Smallest sigma that can be sent, metres or radians.
    pub const SIGMA_MIN: f64 = 1e-4;
    /// Ratio of neighbouring sigmas: 255 steps of 6 % reach from 1e-4 to 2.8e2.
    pub const SIGMA_RATIO: f64 = 1.06;
}

/// Largest length on the wire, metres: 100 km, past any mission of these vehicles.
const MAX_LENGTH_M: f64 = 1e5;

#[derive(Serialize, Deserialize)]
pub(super) struct WirePose {
    x: i32,
    y: i32,
    theta: i32,
}

#[derive(Serialize, Deserialize)]
pub(super) struct WireCovariance {
    /// Logarithm of the sigmas of x, y, theta.
    sigmas: [u8; 3],
    /// Partial correlations xy, x theta, and y theta given x; any values give a positive definite matrix.
    partial: [i8; 3],
}

/// A set of cells; `None` is the empty one.
#[derive(Serialize, Deserialize)]
pub(super) struct WireCells(Option<WireTree>);

#[derive(Serialize, Deserialize)]
pub(super) struct WireTree {
    /// Lowest column and row.
    corner: [i32; 2],
    levels: u8,
    code: Vec<u8>,
}

#[derive(Serialize, Deserialize)]
pub(super) struct WireObject {
    id: u32,
    centroid: [i32; 2],
    sides: [u32; 2],
}

#[derive(Serialize, Deserialize)]
pub(super) struct WireFactor {
    from: u32,
    to: u32,
    measured: WirePose,
    covariance: WireCovariance,
}

#[derive(Serialize, Deserialize)]
pub(super) struct WireId {
    robot: u8,
    index: u32,
}

#[derive(Serialize, Deserialize)]
pub(super) struct WireClosure {
    source: WireId,
    target: WireId,
    measured: WirePose,
    covariance: WireCovariance,
}

#[derive(Serialize, Deserialize)]
pub(super) enum WireMessage {
    Objects { version: u32, whole: bool, changed: Vec<WireObject>, removed: Vec<u32> },
    Cells { version: u32, whole: bool, size_cm: u32, keyframes: u32, added: WireCells, removed: WireCells },
    Graph { keyframes: u32, factors: Vec<WireFactor>, removed: Vec<(u32, u32)> },
    ScanRequest(Vec<u32>),
    Scan { keyframe: u32, cells: WireCells },
    Closures { found: Vec<WireClosure>, withdrawn: Vec<(WireId, WireId)> },
    MapRequest,
    Alignment { partner: u8, place: Option<WirePlace> },
}

#[derive(Serialize, Deserialize)]
pub(super) struct WirePlace {
    sender_from_other: WirePose,
    covariance: WireCovariance,
}

fn steps(value: f64, step: f64, what: &'static str) -> Result<i32, WireError> {
    if !value.is_finite() || value.abs() > MAX_LENGTH_M {
        return Err(WireError::Value { what });
    }
    Ok((value / step).round() as i32)
}

/// A whole number of steps back to a length or an angle.
fn length(steps: i32, step: f64, what: &'static str) -> Result<f64, WireError> {
    let value = f64::from(steps) * step;
    if value.abs() <= MAX_LENGTH_M { Ok(value) } else { Err(WireError::Value { what }) }
}

/// The nearest step; a sigma below the smallest is sent as that, which claims less than is known.
fn sigma_step(sigma: f64) -> Result<u8, WireError> {
    let step = ((sigma / Resolution::SIGMA_MIN).ln() / Resolution::SIGMA_RATIO.ln()).round().max(0.0);
    if step <= 255.0 { Ok(step as u8) } else { Err(WireError::Value { what: "a sigma above 280" }) }
}

impl WirePose {
    fn new(pose: &Isometry2<f64>) -> Result<Self, WireError> {
        Ok(WirePose {
            x: steps(pose.translation.x, Resolution::POSITION_M, "x of a pose")?,
            y: steps(pose.translation.y, Resolution::POSITION_M, "y of a pose")?,
            theta: steps(pose.rotation.angle(), Resolution::ANGLE_RAD, "heading of a pose")?,
        })
    }

    fn pose(&self) -> Result<Isometry2<f64>, WireError> {
        let x = length(self.x, Resolution::POSITION_M, "x of a pose")?;
        let y = length(self.y, Resolution::POSITION_M, "y of a pose")?;
        Ok(Isometry2::new(Vector2::new(x, y), f64::from(self.theta) * Resolution::ANGLE_RAD))
    }
}

impl WireCovariance {
    fn new(covariance: &Matrix3<f64>) -> Result<Self, WireError> {
        let error = || WireError::Value { what: "a covariance that is not positive definite" };
        let l = covariance.cholesky().ok_or_else(error)?.l();
        let sigmas = [0, 1, 2].map(|i| covariance[(i, i)].sqrt());
        if sigmas.iter().any(|s| !s.is_finite() || *s <= 0.0) {
            return Err(error());
        }
        // rows of the Cholesky factor of the correlation matrix are the partial correlations, nested
        let r12 = l[(1, 0)] / sigmas[1];
        let r13 = l[(2, 0)] / sigmas[2];
        let r23 = l[(2, 1)] / sigmas[2] / (1.0 - r13 * r13).sqrt().max(1e-9);
        let partial = [r12, r13, r23].map(|r| (r * 127.0).round().clamp(-126.0, 126.0) as i8);
        let [x, y, theta] = sigmas.map(sigma_step);
        Ok(WireCovariance { sigmas: [x?, y?, theta?], partial })
    }

    fn matrix(&self) -> Matrix3<f64> {
        let s = self.sigmas.map(|k| Resolution::SIGMA_MIN * Resolution::SIGMA_RATIO.powi(i32::from(k)));
        // -127 and -128 are never sent; clamping keeps a foreign frame positive definite all the same
        let [r12, r13, r23] = self.partial.map(|r| f64::from(r.clamp(-126, 126)) / 127.0);
        let rest = (1.0 - r13 * r13).sqrt();
        let l = Matrix3::new(
            s[0],
            0.0,
            0.0,
            s[1] * r12,
            s[1] * (1.0 - r12 * r12).sqrt(),
            0.0,
            s[2] * r13,
            s[2] * rest * r23,
            s[2] * rest * (1.0 - r23 * r23).sqrt(),
        );
        l * l.transpose()
    }
}

impl WireCells {
    /// `cells` as `[column, row]` in any order; equal ones are written once.
    fn new(cells: impl Iterator<Item = [i32; 2]>) -> Result<Self, WireError> {
        let cells: Vec<[i32; 2]> = cells.collect();
        let lowest = |k: usize| cells.iter().map(|cell| cell[k]).min();
        let Some(corner) = lowest(0).zip(lowest(1)).map(|(column, row)| [column, row]) else {
            return Ok(WireCells(None));
        };
        let offset = |cell: &[i32; 2]| [0, 1].map(|k| cell[k].wrapping_sub(corner[k]) as u32);
        let what = "more than 65536 cells, or cells too far apart";
        let (levels, code) = quadtree::encode(cells.iter().map(offset)).ok_or(WireError::Value { what })?;
        Ok(WireCells(Some(WireTree { corner, levels, code })))
    }

    /// The cells, of edge `size` metres, again, ascending in row and then column.
    fn cells(&self, size: f64) -> Result<Vec<[i32; 2]>, WireError> {
        let Some(WireTree { corner, levels, code }) = &self.0 else { return Ok(Vec::new()) };
        let error = || WireError::Value { what: "a cell too far out" };
        let is_far = |index: i32| f64::from(index).abs() * size > MAX_LENGTH_M;
        let offsets = quadtree::decode(*levels, code)
            .map_err(|_| WireError::Value { what: "a set of cells that is none" })?;
        let mut cells = Vec::with_capacity(offsets.len());
        for [column, row] in offsets {
            let column = corner[0].checked_add_unsigned(column).ok_or_else(error)?;
            cells.push([column, corner[1].checked_add_unsigned(row).ok_or_else(error)?]);
        }
        if cells.iter().flatten().any(|index| is_far(*index)) {
            return Err(error());
        }
        cells.sort_unstable_by_key(|[column, row]| (*row, *column));
        Ok(cells)
    }
}

impl WireId {
    fn new(id: KeyframeId) -> Result<Self, WireError> {
        Ok(WireId { robot: robot_to_wire(id.robot)?, index: id.index })
    }

    fn id(&self) -> KeyframeId {
        KeyframeId { robot: u32::from(self.robot), index: self.index }
    }
}

impl WirePlace {
    fn new(place: &MapPlace) -> Result<Self, WireError> {
        Ok(WirePlace {
            sender_from_other: WirePose::new(&place.sender_from_other)?,
            covariance: WireCovariance::new(&place.covariance)?,
        })
    }

    fn place(&self) -> Result<MapPlace, WireError> {
        Ok(MapPlace {
            sender_from_other: self.sender_from_other.pose()?,
            covariance: self.covariance.matrix(),
        })
    }
}

pub(super) fn place_as_sent(place: &MapPlace) -> Result<MapPlace, WireError> {
    WirePlace::new(place)?.place()
}

pub(super) fn closure_as_sent(closure: &ClosureEntry) -> Result<ClosureEntry, WireError> {
    closure_from_wire(&closure_to_wire(closure)?)
}

fn robot_to_wire(robot: RobotId) -> Result<u8, WireError> {
    u8::try_from(robot).map_err(|_| WireError::Value { what: "a robot number above 254" })
}

impl WireMessage {
    pub(super) fn new(message: &Message) -> Result<Self, WireError> {
        Ok(match message {
            Message::Objects(update) => WireMessage::Objects {
                version: update.version,
                whole: update.whole,
                changed: update.changed.iter().map(object_to_wire).collect::<Result<_, _>>()?,
                removed: update.removed.clone(),
            },
            Message::Cells(update) => WireMessage::Cells {
                version: update.version,
                whole: update.whole,
                size_cm: u32::try_from(steps(update.size, 0.01, "the size of a cell")?)
                    .ok()
                    .filter(|size| *size > 0)
                    .ok_or(WireError::Value { what: "the size of a cell" })?,
                keyframes: update.keyframes,
                added: WireCells::new(update.added.iter().copied())?,
                removed: WireCells::new(update.removed.iter().copied())?,
            },
            Message::Graph(update) => WireMessage::Graph {
                keyframes: update.keyframes,
                factors: update.factors.iter().map(factor_to_wire).collect::<Result<_, _>>()?,
                removed: update.removed.clone(),
            },
            Message::ScanRequest(keyframes) => WireMessage::ScanRequest(keyframes.clone()),
            Message::Scan { keyframe, points } => {
                let mut cells = Vec::with_capacity(points.len());
                for p in points {
                    let column = steps(p.x, Resolution::SCAN_M, "x of a point")?;
                    cells.push([column, steps(p.y, Resolution::SCAN_M, "y of a point")?]);
                }
                WireMessage::Scan { keyframe: *keyframe, cells: WireCells::new(cells.into_iter())? }
            }
            Message::Closures { found, withdrawn } => WireMessage::Closures {
                found: found.iter().map(closure_to_wire).collect::<Result<_, _>>()?,
                withdrawn: withdrawn
                    .iter()
                    .map(|(source, target)| Ok((WireId::new(*source)?, WireId::new(*target)?)))
                    .collect::<Result<_, WireError>>()?,
            },
            Message::MapRequest => WireMessage::MapRequest,
            Message::Alignment { partner, place } => WireMessage::Alignment {
                partner: robot_to_wire(*partner)?,
                place: place.as_ref().map(WirePlace::new).transpose()?,
            },
        })
    }

    pub(super) fn message(&self) -> Result<Message, WireError> {
        Ok(match self {
            WireMessage::Objects { version, whole, changed, removed } => Message::Objects(ObjectUpdate {
                version: *version,
                whole: *whole,
                changed: changed.iter().map(object_from_wire).collect::<Result<_, _>>()?,
                removed: removed.clone(),
            }),
            WireMessage::Cells { version, whole, size_cm, keyframes, added, removed } => {
                if *size_cm == 0 || f64::from(*size_cm) * 0.01 > MAX_LENGTH_M {
                    return Err(WireError::Value { what: "the size of a cell" });
                }
                let size = f64::from(*size_cm) * 0.01;
                let (added, removed) = (added.cells(size)?, removed.cells(size)?);
                let (version, whole, keyframes) = (*version, *whole, *keyframes);
                Message::Cells(CellUpdate { version, whole, size, keyframes, added, removed })
            }
            WireMessage::Graph { keyframes, factors, removed } => {
                let out_of_range = factors.iter().any(|f| f.from.max(f.to) >= *keyframes || f.from == f.to);
                if out_of_range {
                    return Err(WireError::Value {
                        what: "a factor of a keyframe that the sender does not have",
                    });
                }
                Message::Graph(GraphUpdate {
                    keyframes: *keyframes,
                    factors: factors.iter().map(factor_from_wire).collect::<Result<_, _>>()?,
                    removed: removed.clone(),
                })
            }
            WireMessage::ScanRequest(keyframes) => Message::ScanRequest(keyframes.clone()),
            WireMessage::Scan { keyframe, cells } => {
                let point = |[x, y]: [i32; 2]| Point2::new(f64::from(x), f64::from(y)) * Resolution::SCAN_M;
                let cells = cells.cells(Resolution::SCAN_M)?;
                Message::Scan { keyframe: *keyframe, points: cells.into_iter().map(point).collect() }
            }
            WireMessage::Closures { found, withdrawn } => Message::Closures {
                found: found.iter().map(closure_from_wire).collect::<Result<_, _>>()?,
                withdrawn: withdrawn.iter().map(|(source, target)| (source.id(), target.id())).collect(),
            },
            WireMessage::MapRequest => Message::MapRequest,
            WireMessage::Alignment { partner, place } => Message::Alignment {
                partner: u32::from(*partner),
                place: place.as_ref().map(WirePlace::place).transpose()?,
            },
        })
    }
}

fn object_to_wire(object: &ObjectEntry) -> Result<WireObject, WireError> {
    let side = |length: f64| {
        u32::try_from(steps(length, Resolution::OBJECT_M, "a side of an object")?)
            .map_err(|_| WireError::Value { what: "a side of an object" })
    };
    Ok(WireObject {
        id: object.id,
        centroid: [
            steps(object.centroid.x, Resolution::OBJECT_M, "x of an object")?,
            steps(object.centroid.y, Resolution::OBJECT_M, "y of an object")?,
        ],
        sides: [side(object.length)?, side(object.breadth)?],
    })
}

fn object_from_wire(object: &WireObject) -> Result<ObjectEntry, WireError> {
    let [x, y] = object.centroid.map(|c| length(c, Resolution::OBJECT_M, "the centre of an object"));
    let side = |s: u32| {
        let what = "a side of an object";
        length(i32::try_from(s).map_err(|_| WireError::Value { what })?, Resolution::OBJECT_M, what)
    };
    let [long, short] = object.sides.map(side);
    Ok(ObjectEntry { id: object.id, centroid: Point2::new(x?, y?), length: long?, breadth: short? })
}

fn factor_to_wire(factor: &FactorEntry) -> Result<WireFactor, WireError> {
    Ok(WireFactor {
        from: factor.from,
        to: factor.to,
        measured: WirePose::new(&factor.measured)?,
        covariance: WireCovariance::new(&factor.covariance)?,
    })
}

fn factor_from_wire(factor: &WireFactor) -> Result<FactorEntry, WireError> {
    let (measured, covariance) = (factor.measured.pose()?, factor.covariance.matrix());
    Ok(FactorEntry { from: factor.from, to: factor.to, measured, covariance })
}

fn closure_to_wire(closure: &ClosureEntry) -> Result<WireClosure, WireError> {
    Ok(WireClosure {
        source: WireId::new(closure.source)?,
        target: WireId::new(closure.target)?,
        measured: WirePose::new(&closure.measured)?,
        covariance: WireCovariance::new(&closure.covariance)?,
    })
}

fn closure_from_wire(closure: &WireClosure) -> Result<ClosureEntry, WireError> {
    Ok(ClosureEntry {
        source: closure.source.id(),
        target: closure.target.id(),
        measured: closure.measured.pose()?,
        covariance: closure.covariance.matrix(),
    })
}
