//! Damaged files are errors or something valid, never a panic.

#[path = "../examples/support/npy.rs"]
mod npy;
#[path = "../examples/support/mod.rs"]
mod support;

use draco_graphmatch::{Costs, Method, Qap, assign, match_objects};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One change of a file: a byte replaced, removed or put in, or the rest cut off.
#[derive(Debug, Clone)]
enum Damage {
    Replace(usize, u8),
    Remove(usize),
    Insert(usize, u8),
    Cut(usize),
}

fn damages() -> impl Strategy<Value = Vec<Damage>> {
    let byte = prop_oneof![any::<u8>(), prop::sample::select(b"0123456789 -+.eE,[]{}()'\":\n".to_vec())];
    let one = prop_oneof![
        4 => (any::<usize>(), byte.clone()).prop_map(|(at, b)| Damage::Replace(at, b)),
        2 => any::<usize>().prop_map(Damage::Remove),
        2 => (any::<usize>(), byte).prop_map(|(at, b)| Damage::Insert(at, b)),
        1 => any::<usize>().prop_map(Damage::Cut),
    ];
    prop::collection::vec(one, 0..6)
}

fn spoil(file: &[u8], damages: &[Damage]) -> Vec<u8> {
    let mut bytes = file.to_vec();
    for damage in damages.iter().filter(|_| !file.is_empty()) {
        let n = bytes.len().max(1);
        match *damage {
            Damage::Replace(at, b) if !bytes.is_empty() => bytes[at % n] = b,
            Damage::Remove(at) if !bytes.is_empty() => drop(bytes.remove(at % n)),
            Damage::Insert(at, b) => bytes.insert(at % n, b),
            Damage::Cut(at) => bytes.truncate(at % n),
            _ => {}
        }
    }
    bytes
}

fn npy_file(rows: usize, columns: usize) -> Vec<u8> {
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    let length = u16::try_from(header.len()).unwrap();
    bytes.extend(length.to_le_bytes());
    bytes.extend(header.bytes());
    for k in 0..rows * columns {
        bytes.extend((k as f64).sin().to_le_bytes());
    }
    bytes
}

const PROBLEMS: &str = r#"[{"map1": [[0, 0, 4, 2], [9.5, 2, 3, 3], [4, 12, 8, 2.5], [-6, 7, 5, 4]],
 "map2": [[0, 0, 4, 2], [9.5, 2, 3, 3], [4, 12, 8, 2.5], [-6, 7, 5, 4]],
 "gt": [[0, 0], [1, 1]], "T": [0.0, 0.0, 0.0], "sigma": 0.2}]"#;

#[test]
fn whole_files_are_read() {
    let (rows, columns, values) = npy::read_npy(&npy_file(2, 3)).unwrap();
    assert_eq!((rows, columns, values.len()), (2, 3, 6));
    assert_eq!(values[1], 1_f64.sin());
    let problems = support::Problem::parse_all(PROBLEMS).unwrap();
    assert_eq!((problems.len(), problems[0].map1.len(), problems[0].gt.len()), (1, 4, 2));
    assert_eq!(Qap::from_qaplib("2\n\n0 1\n2 0\n\n0 3\n4 0\n").unwrap().cost(&[1, 0]), Some(10.0));
}

const QAPLIB: &[u8] = b"2\n\n0 1\n2 0\n\n0 3.5\n-4e1 0\n";

fn read_qaplib(bytes: &[u8]) {
    if let Ok(problem) = Qap::from_qaplib(&String::from_utf8_lossy(bytes)) {
        let image: Vec<usize> = (0..problem.size()).collect();
        assert!(problem.cost(&image).is_some());
    }
}

fn read_npy(bytes: &[u8]) {
    if let Ok((rows, columns, values)) = npy::read_npy(bytes) {
        assert_eq!(values.len(), rows * columns);
        if let Ok(costs) = Costs::new(rows, columns, &values) {
            let _ = assign(costs);
        }
    }
}

fn read_problems(bytes: &[u8]) {
    for p in support::Problem::parse_all(&String::from_utf8_lossy(bytes)).into_iter().flatten() {
        let (map1, map2) = (support::Problem::objects(&p.map1), support::Problem::objects(&p.map2));
        if let Ok(found) = match_objects(&map1, &map2, &Method::default()) {
            p.score(&found.pairs, found.map1_from_map2.as_ref().map(|t| t.mean()));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn damaged_qaplib_files_do_not_panic(damages in damages()) {
        read_qaplib(&spoil(QAPLIB, &damages));
    }

    #[test]
    fn damaged_npy_files_do_not_panic(rows in 0..4_usize, columns in 0..4_usize, damages in damages()) {
        read_npy(&spoil(&npy_file(rows, columns), &damages));
    }

    #[test]
    fn damaged_problem_files_do_not_panic(damages in damages()) {
        read_problems(&spoil(PROBLEMS.as_bytes(), &damages));
    }
}

/// The same at length, with a plain generator: a million damaged files of each kind.
#[test]
#[ignore = "takes minutes"]
fn a_million_damaged_files_do_not_panic() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let signs = b"0123456789 -+.eE,[]{}()'\":\n";
    for _ in 0..1_000_000 {
        let count = rng.random_range(1..6);
        let damages: Vec<Damage> = (0..count)
            .map(|_| {
                let (at, any) = (rng.random_range(0..4096), rng.random::<bool>());
                let byte = if any { rng.random() } else { signs[rng.random_range(0..signs.len())] };
                match rng.random_range(0..9) {
                    0..4 => Damage::Replace(at, byte),
                    4 | 5 => Damage::Remove(at),
                    6 | 7 => Damage::Insert(at, byte),
                    _ => Damage::Cut(at),
                }
            })
            .collect();
        read_qaplib(&spoil(QAPLIB, &damages));
        read_npy(&spoil(&npy_file(rng.random_range(0..4), rng.random_range(0..4)), &damages));
        read_problems(&spoil(PROBLEMS.as_bytes(), &damages));
    }
}
