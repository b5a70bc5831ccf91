use std::path::Path;

use super::{SparseGraph, dimacs::MAX_VERTICES};
use crate::Error;

/// Reads a MatrixMarket coordinate file as an undirected graph.
///
/// # Errors
/// [`Error::Io`], and those of [`matrix_market`].
pub fn read_matrix_market(path: &Path) -> Result<SparseGraph, Error> {
    matrix_market(&read_text(path)?)
}

/// The undirected graph in the text of a MatrixMarket coordinate file (`%%MatrixMarket matrix coordinate ...`).
///
/// Every stored entry off the diagonal is an edge, whatever its value; entries on the diagonal are dropped and
/// the two halves of a general matrix are joined.
///
/// # Errors
/// [`Error::Parse`] with the line: a wrong header, a matrix that is not square, an index out of range, fewer or
/// more entries than declared.
pub fn matrix_market(text: &str) -> Result<SparseGraph, Error> {
    let mut lines = text.lines().enumerate().map(|(index, content)| (index + 1, content));
    let header = lines.next().map(|(_, content)| content.to_ascii_lowercase()).unwrap_or_default();
    if !header.starts_with("%%matrixmarket matrix coordinate") {
        return Err(Error::Parse { line: 1, reason: "not a MatrixMarket coordinate matrix".into() });
    }
    let mut size: Option<(usize, usize)> = None;
    let mut edges = Vec::new();
    let (mut entries, mut last) = (0, 1);
    for (line, content) in lines {
        last = line;
        // Nearly all lines are sound entries; all others take the long way, which names what is wrong.
        if let (Some((n, _)), Some((u, v))) = (size, two_numbers(content))
            && u != v
            && (1..=n).contains(&u)
            && (1..=n).contains(&v)
        {
            entries += 1;
            edges.push((u - 1, v - 1));
            continue;
        }
        let mut words = content.split_whitespace();
        let Some(first) = words.next().filter(|word| !word.starts_with('%')) else { continue };
        match size {
            None => {
                let rows = number(Some(first), line, "number of rows")?;
                let columns = number(words.next(), line, "number of columns")?;
                let declared = number(words.next(), line, "number of entries")?;
                if rows != columns || rows > MAX_VERTICES {
                    let reason =
                        format!("{rows} x {columns}: a graph is square, of at most {MAX_VERTICES} rows");
                    return Err(Error::Parse { line, reason });
                }
                size = Some((rows, declared));
            }
            Some((rows, _)) => {
                let (u, v) = (vertex(Some(first), rows, line)?, vertex(words.next(), rows, line)?);
                entries += 1;
                if u != v {
                    edges.push((u, v));
                }
            }
        }
    }
    match size {
        None => Err(Error::Parse { line: last, reason: "no size line".into() }),
        Some((_, declared)) if declared != entries => {
            Err(Error::Parse { line: last, reason: format!("{entries} entries, {declared} declared") })
        }
        Some((rows, _)) => SparseGraph::from_edges(rows, edges),
    }
}

pub(super) fn read_text(path: &Path) -> Result<String, Error> {
    std::fs::read_to_string(path)
        .map_err(|e| Error::Io { path: path.display().to_string(), reason: e.to_string() })
}

/// Two short decimal numbers with a space between them and nothing else on the line, or `None`.
fn two_numbers(content: &str) -> Option<(usize, usize)> {
    let (first, second) = content.split_once(' ')?;
    let decimal = |digits: &str| {
        if digits.is_empty() || digits.len() > 9 {
            return None;
        }
        digits.bytes().try_fold(0, |value, digit| {
            digit.is_ascii_digit().then(|| 10 * value + usize::from(digit - b'0'))
        })
    };
    Some((decimal(first)?, decimal(second)?))
}

pub(super) fn number(word: Option<&str>, line: usize, what: &str) -> Result<usize, Error> {
    let word = word.ok_or_else(|| Error::Parse { line, reason: format!("{what} missing") })?;
    word.parse().map_err(|_| Error::Parse { line, reason: format!("{what}: `{word}` is no number") })
}

/// A vertex number from one, returned from zero.
pub(super) fn vertex(word: Option<&str>, vertices: usize, line: usize) -> Result<usize, Error> {
    let v = number(word, line, "vertex")?;
    if (1..=vertices).contains(&v) {
        Ok(v - 1)
    } else {
        Err(Error::Parse { line, reason: format!("vertex {v} is not in 1..={vertices}") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Adjacency;

    const HEAD: &str = "%%MatrixMarket matrix coordinate pattern symmetric\n";

    #[test]
    fn reads_edges_and_drops_the_diagonal() {
        let graph = matrix_market(&format!("{HEAD}% note\n3 3 3\n2 1\n3 3\n3 2 0.5\n")).unwrap();
        assert_eq!((graph.len(), graph.edge_count()), (3, 2));
    }

    #[test]
    fn errors_name_the_line() {
        for (body, at) in [("", 1), ("2 3 1\n1 1", 2), ("2 2 1\n1 3", 3), ("2 2 2\n1 2", 3), ("2 2 1\n1", 3)]
        {
            let found = matrix_market(&format!("{HEAD}{body}"));
            assert!(matches!(found, Err(Error::Parse { line, .. }) if line == at), "{body:?} {found:?}");
        }
        assert!(matches!(matrix_market("p edge 1 0"), Err(Error::Parse { line: 1, .. })));
    }
}
