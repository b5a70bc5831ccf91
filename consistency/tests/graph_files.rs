//! Damaged graph files: each gives a sound graph or an error that names a line, and never a panic.

mod common;

use common::{data, rng};
use draco_consistency::Error;
use draco_consistency::graph::{Adjacency, SparseGraph, dimacs, matrix_market};
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt};

const DIMACS: &str =
    "c a comment\np edge 7 8\nn 3 2.5\ne 1 2\ne 2 3\ne 3 1\ne 4 5\ne 5 6\ne 6 7\ne 7 4\ne 1 7\n";
const MATRIX: &str =
    "%%MatrixMarket matrix coordinate pattern symmetric\n% a comment\n6 6 5\n2 1\n3 1\n3 2\n6 5\n4 4\n";

/// Words that a file is likely to be damaged with.
const PIECES: [&str; 16] = [
    "e",
    "p",
    "n",
    "c",
    "0",
    "1",
    "-1",
    "99",
    "4294967296",
    "18446744073709551616",
    "1e9",
    "NaN",
    "\n",
    " ",
    "\u{e4}",
    "%",
];

/// Removes, repeats, replaces or inserts a few pieces of a text.
fn damaged(text: &str, rng: &mut impl Rng) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..rng.random_range(1..6) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(0..8)).min(bytes.len());
        let piece = PIECES.choose(rng).map_or(&b""[..], |piece| piece.as_bytes());
        match rng.random_range(0..4) {
            0 => drop(bytes.drain(at..end)),
            1 => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            2 => drop(bytes.splice(at..end, piece.iter().copied())),
            _ => drop(bytes.splice(at..at, piece.iter().copied())),
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Whether a graph was read.
fn check(text: &str, read: fn(&str) -> Result<SparseGraph, Error>) -> bool {
    match read(text) {
        Ok(graph) => {
            for v in 0..graph.len().min(1000) {
                assert!(graph.neighbors(v).all(|u| u != v && graph.has_edge(u, v)), "{text:?}");
                assert!(graph.weight(v) >= 0.0, "{text:?}");
            }
            true
        }
        Err(Error::Parse { line, reason }) => {
            assert!(line <= text.lines().count().max(1) && !reason.is_empty(), "{text:?}");
            false
        }
        Err(other) => panic!("{text:?}: {other}"),
    }
}

#[test]
fn damaged_files_are_read_or_refused() {
    for (text, read) in [(DIMACS, dimacs as fn(&str) -> _), (MATRIX, matrix_market as fn(&str) -> _)] {
        assert!(check(text, read));
        let mut sound = 0;
        for seed in 0..3_000 {
            let mut rng = rng(seed);
            sound += usize::from(check(&damaged(text, &mut rng), read));
        }
        // The damage must reach both outcomes to show anything.
        assert!((100..2_900).contains(&sound), "{sound} of 3000 were read");
    }
}

#[test]
fn every_prefix_of_a_real_file_is_read_or_refused() {
    let Some(path) = data("maxclique/dimacs/johnson8-2-4.clq") else { return };
    let text = std::fs::read_to_string(path).unwrap();
    for end in (0..text.len()).filter(|&end| text.is_char_boundary(end)) {
        check(&text[..end], dimacs);
    }
    assert_eq!(dimacs(&text).unwrap().edge_count(), 210);
}

#[test]
fn fast_and_slow_lines_give_the_same_edges() {
    let plain = dimacs("p edge 4 3\ne 1 2\ne 2 3\ne 4 1\n").unwrap();
    let odd = dimacs("p col 4 3\n  e 1 2\ne  2\t3\r\ne 4 1 \n").unwrap();
    assert_eq!(plain, odd);
    let head = "%%MatrixMarket matrix coordinate integer general\n";
    let plain = matrix_market(&format!("{head}4 4 3\n2 1\n3 2\n4 1\n")).unwrap();
    let odd = matrix_market(&format!("{head}4 4 3\n 1 2 7\n2 3\t1\n4  1\n")).unwrap();
    assert_eq!(plain, odd);
}

#[test]
fn headers_that_promise_too_much_are_refused() {
    for text in ["p edge 18446744073709551615 0", "p edge 99999999999999999999 0", "p edge 16777217 0"] {
        assert!(matches!(dimacs(text), Err(Error::Parse { line: 1, .. })), "{text}");
    }
    let head = "%%MatrixMarket matrix coordinate pattern symmetric\n";
    for size in ["16777217 16777217 0", "1 18446744073709551616 0", "3 4 0"] {
        assert!(
            matches!(matrix_market(&format!("{head}{size}")), Err(Error::Parse { line: 2, .. })),
            "{size}"
        );
    }
    let million = dimacs("p edge 1000000 1\ne 1 1000000\n").unwrap();
    assert_eq!((million.len(), million.edge_count()), (1_000_000, 1));
}
