use std::collections::{BTreeMap, BTreeSet};
use std::str::{FromStr, SplitAsciiWhitespace};

use nalgebra::SMatrix;

use super::G2oPose;
use crate::io::text::{end, number};
use crate::{Error, Kernel, Key, PoseGraph};

/// A line, and of which of several files.
#[derive(Debug, Clone, Copy)]
pub(in crate::io) struct Place {
    file: usize,
    line: usize,
}

pub(in crate::io) struct Edge<G, const N: usize> {
    place: Place,
    pub(in crate::io) from: Key,
    /// `None` for priors.
    pub(in crate::io) to: Option<Key>,
    pub(in crate::io) measured: G,
    information: SMatrix<f64, N, N>,
    /// The sensor offset a prior is of.
    offset: Option<u64>,
}

/// The lines of a file.
pub(in crate::io) struct Contents<G, const N: usize> {
    /// Names of the files the lines came from; empty while there is only one.
    files: Vec<String>,
    /// Declared poses with their places.
    pub(in crate::io) vertices: BTreeMap<Key, (Place, G)>,
    /// Keys in the order of the file.
    order: Vec<Key>,
    pub(in crate::io) edges: Vec<Edge<G, N>>,
    fixed: Vec<(Place, Key)>,
    /// By file and number.
    offsets: BTreeMap<(usize, u64), G>,
}

impl<G, const N: usize> Default for Contents<G, N> {
    fn default() -> Self {
        Self {
            files: Vec::new(),
            vertices: BTreeMap::new(),
            order: Vec::new(),
            edges: Vec::new(),
            fixed: Vec::new(),
            offsets: BTreeMap::new(),
        }
    }
}

impl<const N: usize, G: G2oPose<N>> Contents<G, N> {
    pub(in crate::io) fn parse(text: &str) -> Result<Self, Error> {
        let mut contents = Self::default();
        for (index, line) in text.lines().enumerate() {
            let read = contents.line(line, Place { file: 0, line: index + 1 });
            read.map_err(|reason| Error::Parse { line: index + 1, reason })?;
        }
        Ok(contents)
    }

    fn line(&mut self, line: &str, place: Place) -> Result<(), String> {
        let mut tokens = line.split_ascii_whitespace();
        let Some(tag) = tokens.next() else { return Ok(()) };
        if tag == G::VERTEX {
            self.vertex(&mut tokens, place)
        } else if tag == G::EDGE {
            self.edge(&mut tokens, place)
        } else if tag == G::PRIOR {
            self.prior(&mut tokens, place)
        } else if tag == "FIX" {
            for token in tokens {
                self.fixed.push((place, parse_key(token)?));
            }
            Ok(())
        } else if !G::OFFSET.is_empty() && tag == G::OFFSET {
            let id = id(&mut tokens)?;
            let read = pose::<N, G>(&mut tokens).and_then(|pose| end(&mut tokens).map(|()| pose));
            let pose = read.map_err(|reason| format!("offset {id}: {reason}"))?;
            match self.offsets.insert((0, id), pose) {
                Some(_) => Err(format!("offset {id} is declared twice")),
                None => Ok(()),
            }
        } else if tag.starts_with('#') || tag.starts_with("PARAMS_") {
            Ok(())
        } else {
            Err(format!("unknown tag {tag:?} (expected {}, {}, ...)", G::VERTEX, G::EDGE))
        }
    }

    fn vertex(&mut self, tokens: &mut SplitAsciiWhitespace, place: Place) -> Result<(), String> {
        let key = key(tokens)?;
        let read = pose::<N, G>(tokens).and_then(|pose| end(tokens).map(|()| pose));
        let pose = read.map_err(|reason| format!("pose {key}: {reason}"))?;
        if let Some((first, _)) = self.vertices.insert(key, (place, pose)) {
            return Err(format!("pose {key} is declared twice, first in line {}", first.line));
        }
        self.order.push(key);
        Ok(())
    }

    fn edge(&mut self, tokens: &mut SplitAsciiWhitespace, place: Place) -> Result<(), String> {
        let (from, to) = (key(tokens)?, key(tokens)?);
        if from == to {
            return Err(format!("the edge joins pose {from} to itself"));
        }
        let (measured, information) =
            measurement(tokens).map_err(|reason| format!("edge {from} -> {to}: {reason}"))?;
        self.edges.push(Edge { place, from, to: Some(to), measured, information, offset: None });
        Ok(())
    }

    fn prior(&mut self, tokens: &mut SplitAsciiWhitespace, place: Place) -> Result<(), String> {
        let from = key(tokens)?;
        let offset = if G::OFFSET.is_empty() { None } else { Some(id(tokens)?) };
        let (measured, information) =
            measurement(tokens).map_err(|reason| format!("prior of pose {from}: {reason}"))?;
        self.edges.push(Edge { place, from, to: None, measured, information, offset });
        Ok(())
    }

    /// Takes in the lines of a further file, called `name`.
    ///
    /// # Errors
    /// A pose whose value differs from the one known, and where that one stood.
    pub(in crate::io) fn take(&mut self, other: Self, name: String) -> Result<(), (Key, Place)> {
        let file = self.files.len();
        self.files.push(name);
        let here = |place: Place| Place { file, ..place };
        for (key, (place, pose)) in other.vertices {
            match self.vertices.get(&key) {
                Some((_, known)) if *known == pose => {}
                Some((first, _)) => return Err((key, *first)),
                None => {
                    self.vertices.insert(key, (here(place), pose));
                    self.order.push(key);
                }
            }
        }
        self.offsets.extend(other.offsets.into_iter().map(|((_, id), pose)| ((file, id), pose)));
        self.edges.extend(other.edges.into_iter().map(|edge| Edge { place: here(edge.place), ..edge }));
        self.fixed.extend(other.fixed.into_iter().map(|(place, key)| (here(place), key)));
        Ok(())
    }

    /// The name of the file of a place.
    pub(in crate::io) fn name(&self, place: Place) -> String {
        self.files.get(place.file).cloned().unwrap_or_default()
    }

    fn error(&self, place: Place, reason: String) -> Error {
        let error = Error::Parse { line: place.line, reason };
        match self.files.get(place.file) {
            Some(path) => Error::InFile { path: path.clone(), error: Box::new(error) },
            None => error,
        }
    }

    /// The graph of the lines; poses that only edges name are composed from measurements.
    pub(in crate::io) fn into_graph(self) -> Result<PoseGraph<G, N>, Error> {
        let mut graph = PoseGraph::new();
        for key in &self.order {
            if let Some((place, pose)) = self.vertices.get(key) {
                graph.add_pose(*key, *pose).map_err(|error| self.error(*place, error.to_string()))?;
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
        self.add_edges(&mut graph)?;
        for (place, key) in &self.fixed {
            graph.set_fixed(*key, true).map_err(|error| self.error(*place, format!("FIX: {error}")))?;
        }
        if declared < graph.pose_count() {
            let placed = (0..graph.pose_count()).map(|slot| slot < declared).collect();
            crate::spanning_tree::compose(&mut graph, placed)?;
        }
        Ok(graph)
    }

    fn add_edges(&self, graph: &mut PoseGraph<G, N>) -> Result<(), Error> {
        for e in &self.edges {
            let at = |reason: String| self.error(e.place, reason);
            let added = match e.to {
                Some(to) => graph.add_between(e.from, to, e.measured, e.information, Kernel::None),
                None => {
                    let (measured, information) = self.of_body(e).map_err(at)?;
                    graph.add_prior(e.from, measured, information, Kernel::None)
                }
            };
            added.map_err(|error| {
                let what = match e.to {
                    Some(to) => format!("edge {} -> {to}", e.from),
                    None => format!("prior of pose {}", e.from),
                };
                at(format!("{what}: {error}"))
            })?;
        }
        Ok(())
    }

    /// A prior of a sensor as one of the body: with the offset `o` and the reading `z`, the residual
    /// `log(z⁻¹ x o)` is `Ad(o⁻¹) log((z o⁻¹)⁻¹ x)`.
    fn of_body(&self, e: &Edge<G, N>) -> Result<(G, SMatrix<f64, N, N>), String> {
        let Some(id) = e.offset else { return Ok((e.measured, e.information)) };
        let offset = self
            .offsets
            .get(&(e.place.file, id))
            .ok_or_else(|| format!("prior of pose {}: no line {} declares offset {id}", e.from, G::OFFSET))?;
        if *offset == G::identity() {
            return Ok((e.measured, e.information));
        }
        let inverse = offset.inverse();
        let adjoint = inverse.adjoint();
        let information = adjoint.transpose() * e.information * adjoint;
        Ok((e.measured.compose(&inverse), (information + information.transpose()) * 0.5))
    }
}

fn key(tokens: &mut SplitAsciiWhitespace) -> Result<Key, String> {
    id(tokens).map(Key::from_id)
}

fn id(tokens: &mut SplitAsciiWhitespace) -> Result<u64, String> {
    parse_id(tokens.next().ok_or("the line ends where an id is due")?)
}

fn parse_key(token: &str) -> Result<Key, String> {
    parse_id(token).map(Key::from_id)
}

fn parse_id(token: &str) -> Result<u64, String> {
    u64::from_str(token).map_err(|_| format!("{token:?} is not an id (a whole number from 0 to 2^64 - 1)"))
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
    end(tokens)?;
    Ok((measured, information))
}
