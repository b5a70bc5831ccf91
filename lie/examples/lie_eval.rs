//! What are the digits of a map or Jacobian? Reads requests on stdin, prints results with 17 digits.
//!
//! ```text
//! echo "log so2 0 -1 1 0" | cargo run --release -p draco-lie --example lie_eval
//! ```
use std::io::{BufRead, IsTerminal, Write};
use std::process::ExitCode;

use draco_lie::LieGroup;
use nalgebra::{Isometry2, Isometry3, SMatrix, SVector, UnitComplex, UnitQuaternion};

const USAGE: &str = "usage: lie_eval < requests

One request a line: OP GROUP NUMBERS...
  OP      exp log jl jr jl_inv jr_inv adjoint
  GROUP   so2 se2 so3 se3
  NUMBERS a tangent vector (translation, then rotation in radians); for log and adjoint
          a rotation (so) or homogeneous (se) matrix, row-major
Prints one line a request: the result row-major, 17 significant digits.";

/// One group's maps on plain numbers; `D` is the size of its matrices.
fn evaluate<const N: usize, const D: usize, G>(op: &str, numbers: &[f64]) -> Result<Vec<f64>, String>
where
    G: LieGroup<N, Matrix = SMatrix<f64, D, D>>,
{
    let count = |wanted: usize| {
        let found = numbers.len();
        if found == wanted { Ok(()) } else { Err(format!("{op} needs {wanted} numbers, found {found}")) }
    };
    let tangent = || {
        count(N)?;
        let xi = SVector::<f64, N>::from_column_slice(numbers);
        match numbers.iter().find(|x| !x.is_finite()) {
            Some(x) => Err(format!("{x} is not a finite number")),
            None => Ok(xi),
        }
    };
    let pose = || {
        count(D * D)?;
        G::try_from_matrix(&SMatrix::<f64, D, D>::from_row_slice(numbers)).map_err(|e| e.to_string())
    };
    Ok(match op {
        "exp" => row_major(&G::try_exp(&tangent()?).map_err(|e| e.to_string())?.to_matrix()),
        "log" => row_major(&pose()?.log()),
        "adjoint" => row_major(&pose()?.adjoint()),
        "jl" => row_major(&G::left_jacobian(&tangent()?)),
        "jr" => row_major(&G::right_jacobian(&tangent()?)),
        "jl_inv" => row_major(&G::left_jacobian_inverse(&tangent()?)),
        "jr_inv" => row_major(&G::right_jacobian_inverse(&tangent()?)),
        _ => return Err(format!("unknown operation {op:?}")),
    })
}

fn row_major<const R: usize, const C: usize>(m: &SMatrix<f64, R, C>) -> Vec<f64> {
    m.transpose().iter().copied().collect()
}

fn answer(line: &str) -> Result<String, String> {
    let mut words = line.split_whitespace();
    let (Some(op), Some(group)) = (words.next(), words.next()) else {
        return Err("expected an operation and a group".into());
    };
    let numbers = words
        .map(|word| word.parse().map_err(|_| format!("{word:?} is not a number")))
        .collect::<Result<Vec<f64>, _>>()?;
    let result = match group {
        "so2" => evaluate::<1, 2, UnitComplex<f64>>(op, &numbers),
        "se2" => evaluate::<3, 3, Isometry2<f64>>(op, &numbers),
        "so3" => evaluate::<3, 3, UnitQuaternion<f64>>(op, &numbers),
        "se3" => evaluate::<6, 4, Isometry3<f64>>(op, &numbers),
        _ => Err(format!("unknown group {group:?}")),
    }?;
    Ok(result.iter().map(|x| format!("{x:.16e}")).collect::<Vec<_>>().join(" "))
}

fn run() -> Result<(), String> {
    // line-buffered, so that a caller on a pipe may wait for each answer
    let mut out = std::io::stdout().lock();
    for (index, line) in std::io::stdin().lock().lines().enumerate() {
        let line = line.map_err(|e| format!("line {}: {e}", index + 1))?;
        if line.trim().is_empty() {
            continue;
        }
        let text = answer(&line).map_err(|e| format!("line {}: {e}", index + 1))?;
        writeln!(out, "{text}").map_err(|e| e.to_string())?;
    }
    out.flush().map_err(|e| e.to_string())
}

fn main() -> ExitCode {
    match std::env::args().nth(1).as_deref() {
        Some("--help" | "-h") => {
            println!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        Some(_) => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
        None if std::io::stdin().is_terminal() => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
        None => {}
    }
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("lie_eval: {message}");
            ExitCode::FAILURE
        }
    }
}
