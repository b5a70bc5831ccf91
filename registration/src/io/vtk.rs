use nalgebra::SVector;

use super::{at, number, text};
use crate::Error;

/// Points of a legacy ASCII VTK file: the section `POINTS n type`.
///
/// # Errors
/// [`Error::Parse`] with the line.
pub fn parse_vtk<const D: usize>(bytes: &[u8]) -> Result<Vec<SVector<f64, D>>, Error> {
    let mut lines = (1..).zip(bytes.split(|b| *b == b'\n'));
    let mut ascii = false;
    let (start, count) = loop {
        let (line, raw) = lines.next().ok_or_else(|| at(1, "no section `POINTS`"))?;
        let content = text(line, raw)?;
        if line == 1 && !content.starts_with("# vtk") {
            return Err(at(1, "a VTK file starts with `# vtk DataFile Version`"));
        }
        match content.split_whitespace().collect::<Vec<_>>().as_slice() {
            ["ASCII"] => ascii = true,
            ["BINARY"] => return Err(at(line, "binary VTK is not supported")),
            ["POINTS", n, _] => {
                let count = n.parse::<usize>().map_err(|_| at(line, format!("`{n}` is not a count")))?;
                break (line, count);
            }
            _ => {}
        }
    };
    if !ascii {
        return Err(at(start, "the format line `ASCII` is missing"));
    }
    let mut points = Vec::with_capacity(count.min(bytes.len()));
    let mut coordinates: Vec<f64> = Vec::new();
    for (line, raw) in lines {
        for word in text(line, raw)?.split_whitespace() {
            if points.len() == count {
                return Ok(points);
            }
            coordinates.push(number(line, word)?);
            if let [x, y, z] = coordinates[..] {
                points.push(SVector::from_fn(|i, _| [x, y, z].get(i).copied().unwrap_or(0.0)));
                coordinates.clear();
            }
        }
    }
    if points.len() == count {
        return Ok(points);
    }
    Err(at(start, format!("the file ends after {} of {count} points", points.len())))
}
