use nalgebra::SVector;

use super::{at, number, text};
use crate::Error;

/// Points from text: numbers separated by commas, semicolons or blanks, one point a line.
///
/// A first line that is not numbers is a header and skipped; so are blank lines and lines that start with `#`.
/// A first line of one whole number is a count, which the rest must match. More than `D` columns are fine.
///
/// # Errors
/// [`Error::Parse`] with the line.
///
/// ```
/// let points = draco_registration::io::parse_columns::<2>(b"x,y\n1.0, 2.0\n3.0, 4.0\n")?;
/// assert_eq!(points[1], nalgebra::Vector2::new(3.0, 4.0));
/// # Ok::<(), draco_registration::Error>(())
/// ```
pub fn parse_columns<const D: usize>(bytes: &[u8]) -> Result<Vec<SVector<f64, D>>, Error> {
    let mut points = Vec::new();
    let mut count = None;
    let mut first = true;
    let mut last_line = 1;
    for (line, raw) in (1..).zip(bytes.split(|b| *b == b'\n')) {
        let content = text(line, raw)?;
        if content.is_empty() || content.starts_with('#') {
            continue;
        }
        last_line = line;
        let words: Vec<&str> = content
            .split(|c: char| c == ',' || c == ';' || c.is_whitespace())
            .filter(|w| !w.is_empty())
            .collect();
        let was_first = std::mem::replace(&mut first, false);
        if was_first && words.iter().all(|w| w.parse::<f64>().is_err()) {
            continue;
        }
        if was_first && words.len() == 1 {
            count =
                Some(words[0].parse::<usize>().map_err(|_| at(line, "one number where a count should be"))?);
            continue;
        }
        if words.len() < D {
            return Err(at(line, format!("{} columns, {D} are needed", words.len())));
        }
        let mut point = SVector::<f64, D>::zeros();
        for (axis, word) in words.iter().take(D).enumerate() {
            point[axis] = number(line, word)?;
        }
        points.push(point);
    }
    match count {
        Some(expected) if expected != points.len() => {
            Err(at(last_line, format!("the file ends after {} of {expected} points", points.len())))
        }
        _ => Ok(points),
    }
}
