//! A team's graph from a folder with one g2o file a robot.
//!
//! Robots are told apart by their ids, see [`Key::from_id`]. Edges between robots may stand in the files of both;
//! they are taken once. Poses that only edges name are composed from the measurements of the whole team.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::g2o::{AnyGraph, Contents, G2oPose, dimension};
use super::text;
use crate::{Error, Key, PoseGraph};

/// A team's graph and where it came from.
#[derive(Debug, Clone)]
pub struct Team<T> {
    /// The graph of all robots together.
    pub graph: T,
    /// The files, in the order they were read.
    pub files: Vec<PathBuf>,
    /// Edges that stood in a second file and were passed over.
    pub repeated_edges: usize,
}

/// Reads all `*.g2o` files of a folder, whose dimension the first one decides.
///
/// # Errors
/// As [`read_as`].
pub fn read(folder: impl AsRef<Path>) -> Result<Team<AnyGraph>, Error> {
    let folder = folder.as_ref();
    let mut found = None;
    for file in files(folder)? {
        found = text::read(&file, |text| Ok(dimension(text)))?;
        if found.is_some() {
            break;
        }
    }
    fn any<T>(team: Team<T>, graph: impl FnOnce(T) -> AnyGraph) -> Team<AnyGraph> {
        Team { graph: graph(team.graph), files: team.files, repeated_edges: team.repeated_edges }
    }
    match found {
        Some(3) => read_as(folder).map(|team| any(team, AnyGraph::Three)),
        _ => read_as(folder).map(|team| any(team, AnyGraph::Two)),
    }
}

/// Reads all `*.g2o` files of a folder, those named by a number first and in its order, then the others by name.
///
/// # Errors
/// [`Error::File`]; [`Error::InFile`] with what [`super::g2o::parse`] returns; [`Error::EmptyGraph`] when there is
/// no file or none holds a pose; [`Error::Contradiction`] when two files give a pose different values.
pub fn read_as<const N: usize, G: G2oPose<N>>(
    folder: impl AsRef<Path>,
) -> Result<Team<PoseGraph<G, N>>, Error> {
    let files = files(folder.as_ref())?;
    let mut team = Contents::<G, N>::default();
    let mut seen: BTreeSet<(Key, Option<Key>, Vec<u64>)> = BTreeSet::new();
    let mut repeated_edges = 0;
    for path in &files {
        let mut contents: Contents<G, N> = text::read(path, Contents::parse)?;
        // an edge twice in one file is two measurements, an edge in a second file is the first one told again
        let mut new = BTreeSet::new();
        contents.edges.retain(|edge| {
            let bits = edge.measured.to_numbers().into_iter().map(f64::to_bits).collect();
            let name = (edge.from, edge.to, bits);
            let repeated = seen.contains(&name);
            repeated_edges += usize::from(repeated);
            new.insert(name);
            !repeated
        });
        seen.append(&mut new);
        let name = path.display().to_string();
        team.take(contents, name.clone()).map_err(|(key, first)| Error::Contradiction {
            key,
            first: team.name(first),
            second: name,
        })?;
    }
    Ok(Team { graph: team.into_graph()?, files, repeated_edges })
}

fn files(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = std::fs::read_dir(folder).map_err(|e| text::file_error(folder, &e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| text::file_error(folder, &e))?.path();
        if path.extension().is_some_and(|extension| extension == "g2o") && path.is_file() {
            files.push(path);
        }
    }
    let number = |path: &PathBuf| path.file_stem()?.to_str()?.parse::<u64>().ok();
    files.sort_by_key(|path| (number(path).is_none(), number(path), path.clone()));
    Ok(files)
}
