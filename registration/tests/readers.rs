//! Point files: what is read, what is refused and with which line, and that no mutation makes a reader panic.

use draco_registration::io::{parse_columns, parse_pcd, parse_ply, parse_vtk};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

const PLY: &str = "ply\nformat ascii 1.0\ncomment c\nelement vertex 2\nproperty double x\nproperty float y\nproperty uchar red\nproperty float z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n1 2 255 3\n4 5 0 6\n";
const PCD: &str = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y rgb z\nSIZE 4 4 4 8\nTYPE F F U F\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n1 2 9 3\n4 5 9 6\n";
const VTK: &str = "# vtk DataFile Version 3.0\ndata\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n1 2 3 4\n5 6\nVERTICES 2 4\n1 0\n1 1\n";

fn expected() -> Vec<Vector3<f64>> {
    vec![Vector3::new(1.0, 2.0, 3.0), Vector3::new(4.0, 5.0, 6.0)]
}

fn binary_ply(big_endian: bool) -> Vec<u8> {
    let order = if big_endian { "big" } else { "little" };
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 2\nproperty float x\nproperty short i\nproperty double y\nproperty float z\nend_header\n"
    )
    .into_bytes();
    for p in expected() {
        let (x, i, y, z) = (p.x as f32, -7i16, p.y, p.z as f32);
        if big_endian {
            bytes.extend(
                [&x.to_be_bytes()[..], &i.to_be_bytes(), &y.to_be_bytes(), &z.to_be_bytes()].concat(),
            );
        } else {
            bytes.extend(
                [&x.to_le_bytes()[..], &i.to_le_bytes(), &y.to_le_bytes(), &z.to_le_bytes()].concat(),
            );
        }
    }
    bytes
}

fn binary_pcd() -> Vec<u8> {
    let mut bytes =
        b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA binary\n".to_vec();
    expected().iter().flat_map(|p| p.iter().map(|v| *v as f32)).for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

#[test]
fn every_format_gives_the_same_points() {
    assert_eq!(parse_ply::<3>(PLY.as_bytes()).unwrap(), expected());
    assert_eq!(parse_ply::<3>(&binary_ply(false)).unwrap(), expected());
    assert_eq!(parse_ply::<3>(&binary_ply(true)).unwrap(), expected());
    assert_eq!(parse_pcd::<3>(PCD.as_bytes()).unwrap(), expected());
    assert_eq!(parse_pcd::<3>(&binary_pcd()).unwrap(), expected());
    assert_eq!(parse_vtk::<3>(VTK.as_bytes()).unwrap(), expected());
    for text in ["1 2 3\n4 5 6\n", "x;y;z\n1;2;3\n4;5;6", "# c\n2\n1,2,3\n\n4 , 5 , 6\n"] {
        assert_eq!(parse_columns::<3>(text.as_bytes()).unwrap(), expected(), "{text}");
    }
    let flat: Vec<_> = expected().iter().map(|p| Vector2::new(p.x, p.y)).collect();
    assert_eq!(parse_ply::<2>(PLY.as_bytes()).unwrap(), flat);
}

#[test]
fn errors_name_the_line() {
    let columns = |text: &str| parse_columns::<2>(text.as_bytes()).unwrap_err().to_string();
    assert_eq!(columns("1 2\n3\n"), "line 2: 1 columns, 2 are needed");
    assert_eq!(columns("1 2\n3 NaN\n"), "line 2: `NaN` is not a finite number");
    assert_eq!(columns("3\n1 2\n3 4\n"), "line 3: the file ends after 2 of 3 points");
    let ply = parse_ply::<3>(PLY.replace("4 5 0 6", "4 five 0 6").as_bytes()).unwrap_err();
    assert_eq!(ply.to_string(), "line 13: `five` is not a number");
    let short = parse_ply::<3>(&PLY.as_bytes()[..PLY.len() - 8]).unwrap_err();
    assert_eq!(short.to_string(), "line 13: the file ends after 1 of 2 points");
    let pcd = parse_pcd::<3>(PCD.replace("SIZE 4 4 4 8", "SIZE 4 4 x 8").as_bytes()).unwrap_err();
    assert_eq!(pcd.to_string(), "line 4: `x` is not a count");
    let vtk = parse_vtk::<3>(VTK.replace("5 6\n", "5 inf\n").as_bytes()).unwrap_err();
    assert_eq!(vtk.to_string(), "line 7: `inf` is not a finite number");
}

fn mutated(mut bytes: Vec<u8>, edits: &[(usize, u8, u8)]) -> Vec<u8> {
    for &(at, byte, how) in edits {
        let at = at % bytes.len().max(1);
        match how % 4 {
            0 if !bytes.is_empty() => bytes[at] = byte,
            1 => bytes.insert(at.min(bytes.len()), byte),
            2 if !bytes.is_empty() => drop(bytes.remove(at)),
            _ => bytes.truncate(at.max(1)),
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn mutated_files_never_panic(
        which in 0usize..7,
        edits in prop::collection::vec((0usize..400, any::<u8>(), 0u8..4), 1..6),
    ) {
        let seeds = [PLY.into(), PCD.into(), VTK.into(), binary_ply(false), binary_ply(true), binary_pcd(), b"x y\n1 2\n3 4\n".to_vec()];
        let bytes = mutated(seeds[which].clone(), &edits);
        for points in [parse_ply::<3>(&bytes), parse_pcd::<3>(&bytes), parse_vtk::<3>(&bytes), parse_columns::<3>(&bytes)].into_iter().flatten() {
            prop_assert!(points.iter().all(|p| p.iter().all(|v| v.is_finite())));
        }
    }
}

#[test]
fn a_hundred_thousand_mutated_files_never_panic() {
    read_mutated(120_000, 17);
}

#[test]
#[ignore = "a minute"]
fn a_million_mutated_files_never_panic() {
    read_mutated(1_000_000, 18);
}

fn read_mutated(files: usize, seed: u64) {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let seeds: [Vec<u8>; 7] = [
        PLY.into(),
        PCD.into(),
        VTK.into(),
        binary_ply(false),
        binary_ply(true),
        binary_pcd(),
        b"x y\n1 2\n3 4\n".to_vec(),
    ];
    let (mut read, mut refused) = (0, 0);
    for round in 0..files {
        let seed = &seeds[round % seeds.len()];
        let edits: Vec<_> = (0..rng.random_range(1..6))
            .map(|_| (rng.random_range(0..400), rng.random::<u8>(), rng.random::<u8>()))
            .collect();
        let bytes = mutated(seed.clone(), &edits);
        for points in [parse_ply::<3>(&bytes), parse_pcd(&bytes), parse_vtk(&bytes), parse_columns(&bytes)] {
            match points {
                Ok(points) => {
                    read += 1;
                    assert!(points.iter().all(|p| p.iter().all(|v| v.is_finite())));
                }
                Err(error) => {
                    refused += 1;
                    assert!(!error.to_string().contains('\n'), "{error}");
                }
            }
        }
    }
    println!("{files} mutated files: {read} times read, {refused} times refused");
    assert!(read > files / 12 && refused > files / 2, "{read} {refused}");
}
