//! The g2o text format.
//!
//! Read are `VERTEX_SE2`, `EDGE_SE2`, `EDGE_PRIOR_SE2`, `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`, `EDGE_SE3_PRIOR`
//! (with an identity offset) and `FIX`; `PARAMS_SE3OFFSET` lines and lines that start with `#` are passed over.
//! Poses are `x y θ` or `x y z qx qy qz qw`, information matrices the upper triangle by rows, order translation
//! then rotation, used as they stand. Poses that only edges name get their first guess by composing
//! measurements: along the chain of consecutive indices first, then breadth-first over what is left.
//!
//! Kernels and user-defined factors have no place in the format and are not written.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;
use std::str::{FromStr, SplitAsciiWhitespace};

use draco_lie::LieGroup;
use nalgebra::{
    Isometry2, Isometry3, Quaternion, SMatrix, Translation2, Translation3, UnitComplex, UnitQuaternion,
};

use crate::{Error, Kernel, Key, Measurement, PoseGraph, PoseGraph2, PoseGraph3};

/// A graph in the plane or in space, whichever a file holds.
#[derive(Debug, Clone)]
pub enum AnyGraph {
    /// Poses in the plane.
    Two(PoseGraph2),
    /// Poses in space.
    Three(PoseGraph3),
}

/// Poses that the g2o format knows.
pub trait G2oPose<const N: usize>: LieGroup<N> {
    /// Tag of a pose.
    const VERTEX: &'static str;
    /// Tag of a relative pose.
    const EDGE: &'static str;
    /// Tag of a measurement of a pose itself.
    const PRIOR: &'static str;
    /// Whether the tag of a prior is followed by the number of a sensor offset.
    const PRIOR_HAS_OFFSET: bool;
    /// Numbers a pose takes.
    const NUMBERS: usize;
    /// The pose of its numbers in a file, or what is wrong with them.
    fn from_numbers(numbers: &[f64]) -> Result<Self, &'static str>;
    /// The numbers of a pose in a file; [`G2oPose::from_numbers`] of them gives the same bits again wherever
    /// the pose came from a file.
    fn to_numbers(&self) -> Vec<f64>;
}

impl G2oPose<3> for Isometry2<f64> {
    const VERTEX: &'static str = "VERTEX_SE2";
    const EDGE: &'static str = "EDGE_SE2";
    const PRIOR: &'static str = "EDGE_PRIOR_SE2";
    const PRIOR_HAS_OFFSET: bool = false;
    const NUMBERS: usize = 3;

    fn from_numbers(numbers: &[f64]) -> Result<Self, &'static str> {
        match numbers {
            [x, y, angle] => Ok(Isometry2::from_parts(Translation2::new(*x, *y), UnitComplex::new(*angle))),
            _ => Err("a pose in the plane takes 3 numbers"),
        }
    }

    fn to_numbers(&self) -> Vec<f64> {
        // the angle next to the arc tangent that gives back the same sine and cosine
        let near = self.rotation.angle();
        let steps = [0i64, 1, -1, 2, -2, 3, -3, 4, -4];
        let exact = steps
            .into_iter()
            .map(|step| f64::from_bits(near.to_bits().wrapping_add_signed(step)))
            .find(|angle| UnitComplex::new(*angle) == self.rotation);
        vec![self.translation.x, self.translation.y, exact.unwrap_or(near)]
    }
}

impl G2oPose<6> for Isometry3<f64> {
    const VERTEX: &'static str = "VERTEX_SE3:QUAT";
    const EDGE: &'static str = "EDGE_SE3:QUAT";
    const PRIOR: &'static str = "EDGE_SE3_PRIOR";
    const PRIOR_HAS_OFFSET: bool = true;
    const NUMBERS: usize = 7;

    fn from_numbers(numbers: &[f64]) -> Result<Self, &'static str> {
        let [x, y, z, i, j, k, w] = numbers else { return Err("a pose in space takes 7 numbers") };
        let q = Quaternion::new(*w, *i, *j, *k);
        let norm_sq = q.norm_squared();
        if norm_sq.is_nan() || norm_sq < 1e-12 {
            return Err("the quaternion is zero");
        }
        // normalising a unit quaternion again would change its last bits
        let rotation = if (norm_sq - 1.0).abs() <= 4.0 * f64::EPSILON {
            UnitQuaternion::new_unchecked(q)
        } else {
            UnitQuaternion::new_normalize(q)
        };
        Ok(Isometry3::from_parts(Translation3::new(*x, *y, *z), rotation))
    }

    fn to_numbers(&self) -> Vec<f64> {
        let (t, q) = (&self.translation, &self.rotation);
        vec![t.x, t.y, t.z, q.i, q.j, q.k, q.w]
    }
}

/// Reads a file of either dimension.
///
/// # Errors
/// [`Error::File`], or what [`parse`] returns.
pub fn read(path: impl AsRef<Path>) -> Result<AnyGraph, Error> {
    parse_any(&read_text(path.as_ref())?)
}

/// Reads a file whose dimension the caller knows.
///
/// # Errors
/// [`Error::File`], or what [`parse`] returns.
pub fn read_as<const N: usize, G: G2oPose<N>>(path: impl AsRef<Path>) -> Result<PoseGraph<G, N>, Error> {
    parse(&read_text(path.as_ref())?)
}

fn read_text(path: &Path) -> Result<String, Error> {
    std::fs::read_to_string(path)
        .map_err(|e| Error::File { path: path.display().to_string(), reason: e.to_string() })
}

/// Parses a text of either dimension, which the first pose or edge decides.
///
/// # Errors
/// As [`parse`]; [`Error::EmptyGraph`] when there is neither pose nor edge.
pub fn parse_any(text: &str) -> Result<AnyGraph, Error> {
    for line in text.lines() {
        match line.split_ascii_whitespace().next() {
            Some("VERTEX_SE2" | "EDGE_SE2" | "EDGE_PRIOR_SE2") => return parse(text).map(AnyGraph::Two),
            Some("VERTEX_SE3:QUAT" | "EDGE_SE3:QUAT" | "EDGE_SE3_PRIOR") => {
                return parse(text).map(AnyGraph::Three);
            }
            _ => {}
        }
    }
    // a text without any is parsed for the sake of its errors
    parse::<3, Isometry2<f64>>(text).map(AnyGraph::Two)
}

/// Parses a text.
///
/// # Errors
/// [`Error::Parse`] with the line and the reason; [`Error::EmptyGraph`].
pub fn parse<const N: usize, G: G2oPose<N>>(text: &str) -> Result<PoseGraph<G, N>, Error> {
    let mut file = Contents::default();
    for (number, line) in text.lines().enumerate() {
        file.line(line, number + 1).map_err(|reason| Error::Parse { line: number + 1, reason })?;
    }
    file.into_graph()
}

struct Edge<G, const N: usize> {
    line: usize,
    from: Key,
    /// `None` for priors.
    to: Option<Key>,
    measured: G,
    information: SMatrix<f64, N, N>,
}

struct Contents<G, const N: usize> {
    vertices: BTreeMap<Key, G>,
    /// Keys in the order of the file.
    order: Vec<Key>,
    edges: Vec<Edge<G, N>>,
    fixed: Vec<(usize, Key)>,
}

impl<G, const N: usize> Default for Contents<G, N> {
    fn default() -> Self {
        Self { vertices: BTreeMap::new(), order: Vec::new(), edges: Vec::new(), fixed: Vec::new() }
    }
}

impl<const N: usize, G: G2oPose<N>> Contents<G, N> {
    fn line(&mut self, line: &str, number: usize) -> Result<(), String> {
        let mut tokens = line.split_ascii_whitespace();
        let Some(tag) = tokens.next() else { return Ok(()) };
        if tag == G::VERTEX {
            let key = key(&mut tokens)?;
            let pose = pose::<N, G>(&mut tokens)?;
            if self.vertices.insert(key, pose).is_some() {
                return Err(format!("pose {key} is declared twice"));
            }
            self.order.push(key);
        } else if tag == G::EDGE {
            let (from, to) = (key(&mut tokens)?, key(&mut tokens)?);
            if from == to {
                return Err(format!("the edge joins pose {from} to itself"));
            }
            let (measured, information) = measurement(&mut tokens)?;
            self.edges.push(Edge { line: number, from, to: Some(to), measured, information });
        } else if tag == G::PRIOR {
            let from = key(&mut tokens)?;
            if G::PRIOR_HAS_OFFSET {
                key(&mut tokens)?;
            }
            let (measured, information) = measurement(&mut tokens)?;
            self.edges.push(Edge { line: number, from, to: None, measured, information });
        } else if tag == "FIX" {
            for token in tokens.by_ref() {
                self.fixed.push((number, parse_key(token)?));
            }
        } else if tag.starts_with('#') || tag == "PARAMS_SE3OFFSET" {
            return Ok(());
        } else {
            return Err(format!("unknown tag {tag:?} (expected {}, {}, ...)", G::VERTEX, G::EDGE));
        }
        match tokens.next() {
            Some(extra) => Err(format!("unexpected {extra:?} after the last number")),
            None => Ok(()),
        }
    }

    fn into_graph(self) -> Result<PoseGraph<G, N>, Error> {
        let mut graph = PoseGraph::new();
        for key in &self.order {
            if let Some(pose) = self.vertices.get(key) {
                graph.add_pose(*key, *pose)?;
            }
        }
        let declared = graph.pose_count();
        let named = self.edges.iter().flat_map(|e| [Some(e.from), e.to]).flatten();
        for key in named.filter(|key| !self.vertices.contains_key(key)).collect::<BTreeSet<Key>>() {
            graph.add_pose(key, G::identity())?;
        }
        if graph.pose_count() == 0 {
            return Err(Error::EmptyGraph);
        }
        for e in self.edges {
            let added = match e.to {
                Some(to) => graph.add_between(e.from, to, e.measured, e.information, Kernel::None),
                None => graph.add_prior(e.from, e.measured, e.information, Kernel::None),
            };
            added.map_err(|error| Error::Parse { line: e.line, reason: error.to_string() })?;
        }
        for (line, key) in self.fixed {
            let fixed = graph.set_fixed(key, true);
            fixed.map_err(|error| Error::Parse { line, reason: error.to_string() })?;
        }
        if declared < graph.pose_count() {
            let placed = (0..graph.pose_count()).map(|slot| slot < declared).collect();
            crate::spanning_tree::compose(&mut graph, placed)?;
        }
        Ok(graph)
    }
}

fn key(tokens: &mut SplitAsciiWhitespace) -> Result<Key, String> {
    parse_key(tokens.next().ok_or("the line ends where an id is due")?)
}

fn parse_key(token: &str) -> Result<Key, String> {
    u64::from_str(token)
        .map(Key::from_id)
        .map_err(|_| format!("{token:?} is not an id (a whole number from 0 to 2^64 - 1)"))
}

fn number(tokens: &mut SplitAsciiWhitespace) -> Result<f64, String> {
    let token = tokens.next().ok_or("the line ends where a number is due")?;
    let value = f64::from_str(token).map_err(|_| format!("{token:?} is not a number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("{token:?} is not finite")) }
}

fn pose<const N: usize, G: G2oPose<N>>(tokens: &mut SplitAsciiWhitespace) -> Result<G, String> {
    let mut numbers = [0.0; 7];
    for x in &mut numbers[..G::NUMBERS] {
        *x = number(tokens)?;
    }
    G::from_numbers(&numbers[..G::NUMBERS]).map_err(str::to_owned)
}

fn measurement<const N: usize, G: G2oPose<N>>(
    tokens: &mut SplitAsciiWhitespace,
) -> Result<(G, SMatrix<f64, N, N>), String> {
    let measured = pose::<N, G>(tokens)?;
    let mut information = SMatrix::zeros();
    for row in 0..N {
        for column in row..N {
            let value = number(tokens)?;
            information[(row, column)] = value;
            information[(column, row)] = value;
        }
    }
    Ok((measured, information))
}

/// The text of a graph: poses ascending by key, then `FIX` lines, then factors in the order they were added.
///
/// Reading it again gives the same poses, measurements and information matrices to the bit, except that in the
/// plane a heading that was computed, not read, may change by its last bit the first time.
///
/// # Errors
/// [`Error::KeyTooLarge`].
pub fn to_text<const N: usize, G: G2oPose<N>>(graph: &PoseGraph<G, N>) -> Result<String, Error> {
    let id = |key: Key| key.to_id().ok_or(Error::KeyTooLarge { key });
    let mut text = String::new();
    for (key, pose) in graph.poses() {
        text.push_str(&format!("{} {}", G::VERTEX, id(key)?));
        push_numbers(&mut text, &pose.to_numbers());
        text.push('\n');
    }
    for (key, _) in graph.poses().filter(|(key, _)| graph.is_fixed(*key)) {
        text.push_str(&format!("FIX {}\n", id(key)?));
    }
    for (_, factor) in graph.factors() {
        let measured = match &factor.measurement {
            Measurement::Prior { key, measured } => {
                let offset = if G::PRIOR_HAS_OFFSET { " 0" } else { "" };
                text.push_str(&format!("{} {}{offset}", G::PRIOR, id(*key)?));
                measured
            }
            Measurement::Between { from, to, measured } => {
                text.push_str(&format!("{} {} {}", G::EDGE, id(*from)?, id(*to)?));
                measured
            }
            Measurement::Custom(_) => continue,
        };
        push_numbers(&mut text, &measured.to_numbers());
        for row in 0..N {
            push_numbers(
                &mut text,
                &factor.information.row(row).iter().copied().skip(row).collect::<Vec<_>>(),
            );
        }
        text.push('\n');
    }
    Ok(text)
}

fn push_numbers(text: &mut String, numbers: &[f64]) {
    for x in numbers {
        // the shortest digits that read back as the same number; writing to a string cannot fail
        let _ = write!(text, " {x}");
    }
}

/// Writes a graph to a file.
///
/// # Errors
/// [`Error::KeyTooLarge`], [`Error::File`].
pub fn write<const N: usize, G: G2oPose<N>>(
    graph: &PoseGraph<G, N>,
    path: impl AsRef<Path>,
) -> Result<(), Error> {
    let path = path.as_ref();
    std::fs::write(path, to_text(graph)?)
        .map_err(|e| Error::File { path: path.display().to_string(), reason: e.to_string() })
}
