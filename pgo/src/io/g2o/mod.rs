//! The g2o text format.
//!
//! Read are `VERTEX_SE2`, `EDGE_SE2`, `EDGE_PRIOR_SE2`, `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`, `EDGE_SE3_PRIOR`
//! with `PARAMS_SE3OFFSET`, and `FIX`; other `PARAMS_` lines and lines that start with `#` are passed over. Ids are 64-bit numbers, see
//! [`Key::from_id`]; they need not be consecutive.
//! Poses are `x y θ` or `x y z qx qy qz qw`, information matrices the upper triangle by rows, order translation
//! then rotation, used as they stand. Poses that only edges name get their first guess by composing
//! measurements: along the chain of consecutive indices first, then breadth-first over what is left.
//!
//! Kernels and user-defined factors have no place in the format and are not written.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Isometry2;

use super::text;
use crate::{Error, Key, Measurement, PoseGraph, PoseGraph2, PoseGraph3};

mod contents;
mod pose;

pub(super) use contents::Contents;
pub use pose::G2oPose;

/// A graph in the plane or in space, whichever a file holds.
#[derive(Debug, Clone)]
pub enum AnyGraph {
    /// Poses in the plane.
    Two(PoseGraph2),
    /// Poses in space.
    Three(PoseGraph3),
}

/// Reads a file of either dimension.
///
/// # Errors
/// [`Error::File`]; [`Error::InFile`] with what [`parse`] returns.
pub fn read(path: impl AsRef<Path>) -> Result<AnyGraph, Error> {
    text::read(path.as_ref(), parse_any)
}

/// Reads a file whose dimension the caller knows.
///
/// # Errors
/// [`Error::File`]; [`Error::InFile`] with what [`parse`] returns.
pub fn read_as<const N: usize, G: G2oPose<N>>(path: impl AsRef<Path>) -> Result<PoseGraph<G, N>, Error> {
    text::read(path.as_ref(), parse)
}

/// Parses a text of either dimension, which the first pose or edge decides.
///
/// # Errors
/// As [`parse`]; [`Error::EmptyGraph`] when there is neither pose nor edge.
pub fn parse_any(text: &str) -> Result<AnyGraph, Error> {
    match dimension(text) {
        Some(3) => parse(text).map(AnyGraph::Three),
        // a text without any is parsed for the sake of its errors
        _ => parse::<3, Isometry2<f64>>(text).map(AnyGraph::Two),
    }
}

/// The dimension that the first pose or edge of a text decides.
pub(super) fn dimension(text: &str) -> Option<usize> {
    text.lines().find_map(|line| match line.split_ascii_whitespace().next() {
        Some("VERTEX_SE2" | "EDGE_SE2" | "EDGE_PRIOR_SE2") => Some(2),
        Some("VERTEX_SE3:QUAT" | "EDGE_SE3:QUAT" | "EDGE_SE3_PRIOR") => Some(3),
        _ => None,
    })
}

/// Parses a text.
///
/// # Errors
/// [`Error::Parse`] with the line and the reason; [`Error::EmptyGraph`].
pub fn parse<const N: usize, G: G2oPose<N>>(text: &str) -> Result<PoseGraph<G, N>, Error> {
    Contents::parse(text)?.into_graph()
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
    let has_prior = graph.factors().any(|(_, f)| matches!(f.measurement, Measurement::Prior { .. }));
    if has_prior && !G::OFFSET.is_empty() {
        text.push_str(&format!("{} 0", G::OFFSET));
        push_numbers(&mut text, &G::identity().to_numbers());
        text.push('\n');
    }
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
                let offset = if G::OFFSET.is_empty() { "" } else { " 0" };
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
    text::write(path.as_ref(), &to_text(graph)?)
}
