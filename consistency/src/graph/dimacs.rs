use std::path::Path;

use super::{Graph, SparseGraph, bit_matrix::BitMatrix};
use crate::Error;

/// A graph of a file, stored as it takes less memory.
#[derive(Clone, Debug, PartialEq)]
pub enum FileGraph {
    /// Rows of bits, where all of them are no larger than the file.
    Dense(Graph),
    /// Lists of neighbours.
    Sparse(SparseGraph),
}

/// Reads a DIMACS clique file without turning its edges into lists where rows of bits are smaller.
///
/// # Errors
/// [`Error::Io`], and those of [`dimacs`].
pub fn read_dimacs_smaller(path: &Path) -> Result<FileGraph, Error> {
    Ok(match parse(&super::matrix_market::read_text(path)?)? {
        (Edges::Rows(rows), weights) if weights.len() <= Graph::MAX_VERTICES => {
            FileGraph::Dense(Graph::from_rows(rows, weights))
        }
        (edges, weights) => FileGraph::Sparse(edges.into_lists(weights)),
    })
}

/// Reads a DIMACS clique file (`c` comment, `p col|edge n m`, `e u v`, `n v weight`), vertices from one.
///
/// # Errors
/// [`Error::Io`], and those of [`dimacs`].
pub fn read_dimacs(path: &Path) -> Result<SparseGraph, Error> {
    dimacs(&super::matrix_market::read_text(path)?)
}

/// The graph in the text of a DIMACS clique file.
///
/// The edge count of the `p` line is not trusted, since known files count each edge once or twice; an edge named
/// twice counts once.
///
/// # Errors
/// [`Error::Parse`] with the line: no `p` line or two, an unknown line type, numbers out of range, a self loop.
pub fn dimacs(text: &str) -> Result<SparseGraph, Error> {
    let (edges, weights) = parse(text)?;
    Ok(edges.into_lists(weights))
}

/// The edges of a file, and a weight for each vertex.
fn parse(text: &str) -> Result<(Edges, Vec<f64>), Error> {
    let (mut vertices, mut edges) = (None, Edges::Arcs(Vec::new()));
    let mut weights: Vec<(usize, f64)> = Vec::new();
    let (mut at, mut line) = (0, 0);
    while at < text.len() {
        line += 1;
        // Nearly all lines are sound edges; all others take the long way, which names what is wrong.
        if let (Some(n), Some((u, v, length))) = (vertices, edge(&text.as_bytes()[at..]))
            && u != v
            && (1..=n).contains(&u)
            && (1..=n).contains(&v)
        {
            edges.join(u - 1, v - 1);
            at += length;
            continue;
        }
        let content = text[at..].lines().next().unwrap_or_default();
        at = text[at..].find('\n').map_or(text.len(), |end| at + end + 1);
        let fail = |reason: &str| Error::Parse { line, reason: reason.into() };
        let mut words = content.split_whitespace();
        match words.next() {
            None | Some("c") => {}
            Some("p") if vertices.is_some() => return Err(fail("a second `p` line")),
            Some("p") => {
                words.next().ok_or_else(|| fail("`p` line without a format"))?;
                let n = super::matrix_market::number(words.next(), line, "number of vertices")?;
                if n > MAX_VERTICES {
                    return Err(fail(&format!("{n} vertices; at most {MAX_VERTICES} are read")));
                }
                vertices = Some(n);
                edges = Edges::among(n, text.len());
            }
            Some(kind @ ("e" | "n")) => {
                let n = vertices.ok_or_else(|| fail("before the `p` line"))?;
                let u = super::matrix_market::vertex(words.next(), n, line)?;
                if kind == "e" {
                    let v = super::matrix_market::vertex(words.next(), n, line)?;
                    if u == v {
                        return Err(fail(&format!("vertex {} has an edge to itself", u + 1)));
                    }
                    edges.join(u, v);
                } else {
                    let weight = words.next().and_then(|w| w.parse::<f64>().ok());
                    match weight.filter(|w| w.is_finite() && *w >= 0.0) {
                        Some(weight) => weights.push((u, weight)),
                        None => return Err(fail("a vertex weight is a finite number, not negative")),
                    }
                }
            }
            Some(other) => return Err(fail(&format!("unknown line type `{other}`"))),
        }
    }
    let n =
        vertices.ok_or_else(|| Error::Parse { line: text.lines().count(), reason: "no `p` line".into() })?;
    let mut all = vec![1.0; n];
    weights.into_iter().for_each(|(v, weight)| all[v] = weight);
    Ok((edges, all))
}

/// Edges read so far.
enum Edges {
    /// As bits, where all rows together are no larger than the text.
    Rows(BitMatrix),
    /// Each in both directions.
    Arcs(Vec<(u32, u32)>),
}

impl Edges {
    fn among(vertices: usize, text: usize) -> Self {
        if vertices.saturating_mul(vertices) <= 8 * text {
            Self::Rows(BitMatrix::new(vertices))
        } else {
            Self::Arcs(Vec::new())
        }
    }

    fn into_lists(self, weights: Vec<f64>) -> SparseGraph {
        match self {
            Self::Rows(rows) => SparseGraph::from_rows(&rows, weights),
            Self::Arcs(arcs) => SparseGraph::from_arcs(&arcs, weights),
        }
    }

    #[inline(always)]
    fn join(&mut self, u: usize, v: usize) {
        match self {
            Self::Rows(rows) => rows.join(u, v),
            Self::Arcs(arcs) => arcs.extend([(u as u32, v as u32), (v as u32, u as u32)]),
        }
    }
}

/// The numbers of a plain line `e u v` at the front of `text`, and the length of that line with its end.
#[inline(always)]
fn edge(text: &[u8]) -> Option<(usize, usize, usize)> {
    let mut at = text.starts_with(b"e ").then_some(2)?;
    let u = decimal(text, &mut at)?;
    at += usize::from(text.get(at) == Some(&b' '));
    let v = decimal(text, &mut at)?;
    at += usize::from(text.get(at) == Some(&b'\r'));
    matches!(text.get(at), None | Some(b'\n')).then_some((u, v, at + 1))
}

/// The decimal number at `at`, which moves behind it; `None` if there is none, or a long one.
#[inline(always)]
fn decimal(text: &[u8], at: &mut usize) -> Option<usize> {
    const DIGITS: usize = 9;
    let (begin, mut value) = (*at, 0u64);
    while let Some(byte) = text.get(*at) {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            break;
        }
        value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
        *at += 1;
    }
    (1..=DIGITS).contains(&(*at - begin)).then_some(value as usize)
}

/// Largest number of vertices a file may declare: a hostile header must not exhaust the memory.
pub(super) const MAX_VERTICES: usize = 1 << 24;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Adjacency;

    #[test]
    fn reads_edges_once_and_weights() {
        let graph = dimacs("c hi\np edge 3 9\ne 1 2\r\ne 2 1\n\ne 2 3\nn 3 2.5\n").unwrap();
        assert_eq!((graph.len(), graph.edge_count(), graph.weight(2)), (3, 2, 2.5));
    }

    #[test]
    fn files_are_stored_as_they_are_smaller() {
        for (text, dense) in [("p edge 8 1\ne 1 2\nn 2 3\n", true), ("p edge 200 1\ne 1 2\n", false)] {
            let path = std::env::temp_dir().join(format!("draco-{}-{dense}.clq", std::process::id()));
            std::fs::write(&path, text).unwrap();
            let read = read_dimacs_smaller(&path).unwrap();
            std::fs::remove_file(&path).unwrap();
            let lists = dimacs(text).unwrap();
            let expected = match dense {
                true => FileGraph::Dense(Graph::from_sparse(&lists).unwrap()),
                false => FileGraph::Sparse(lists),
            };
            assert_eq!(read, expected);
        }
    }

    #[test]
    fn plain_and_odd_edge_lines_give_the_same_graph() {
        let odd = dimacs("p edge 12 3\n e  1\t2 \ne 12 3\r\ne 0000000004 5\ne 6 7").unwrap();
        let plain = dimacs("p edge 12 3\ne 1 2\ne 12 3\ne 4 5\ne 6 7\n").unwrap();
        assert_eq!(odd, plain);
        assert!(dimacs("p edge 20 1\ne 12").is_err() && dimacs("p edge 20 1\ne 1 2 x").is_ok());
    }

    #[test]
    fn errors_name_the_line() {
        for (text, at) in [
            ("", 0),
            ("e 1 2", 1),
            ("p edge 2 1\ne 1 3", 2),
            ("p edge 2 1\ne 0 1", 2),
            ("p edge 2 1\n\ne 1 1", 3),
            ("p edge 2 1\np edge 2 1", 2),
            ("p edge x 1", 1),
            ("p edge 99999999999 0", 1),
            ("p edge 2 1\nn 1 NaN", 2),
            ("p edge 2 1\nz", 2),
            ("p edge 2 1\ne 1", 2),
        ] {
            assert!(matches!(dimacs(text), Err(Error::Parse { line, .. }) if line == at), "{text:?}");
        }
    }
}
