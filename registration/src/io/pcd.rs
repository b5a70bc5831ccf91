use nalgebra::SVector;

use super::fields::{Kind, Layout, binary_points, next_line, text_points};
use super::{at, text};
use crate::Error;

/// Points of a PCD file (`DATA ascii` or `binary`): the fields `x`, `y`, `z`.
///
/// `binary_compressed` is refused.
///
/// # Errors
/// [`Error::Parse`] with the line; for binary data the line of `DATA`.
pub fn parse_pcd<const D: usize>(bytes: &[u8]) -> Result<Vec<SVector<f64, D>>, Error> {
    let mut rest = bytes;
    let mut line = 0;
    let mut header = Header::default();
    let data = loop {
        line += 1;
        let raw = next_line(&mut rest).ok_or_else(|| at(line, "the header has no line `DATA`"))?;
        let content = text(line, raw)?;
        if content.is_empty() || content.starts_with('#') {
            continue;
        }
        let mut words = content.split_whitespace();
        let key = words.next().unwrap_or_default();
        let values: Vec<String> = words.map(str::to_string).collect();
        match key {
            "FIELDS" => header.fields = values,
            "SIZE" => header.sizes = counts(line, &values)?,
            "TYPE" => header.types = values,
            "COUNT" => header.counts = Some(counts(line, &values)?),
            "POINTS" => header.points = counts(line, &values)?.first().copied(),
            "WIDTH" | "HEIGHT" => {
                let n = *counts(line, &values)?
                    .first()
                    .ok_or_else(|| at(line, format!("{key} needs a value")))?;
                header.area = header.area.checked_mul(n).ok_or_else(|| at(line, "too many points"))?;
            }
            "VERSION" | "VIEWPOINT" => {}
            "DATA" => break values.first().cloned().unwrap_or_default(),
            _ => return Err(at(line, format!("`{key}` is not a key of a PCD header"))),
        }
    };
    let fields = header.kinds(line)?;
    let (mut axes, mut columns) = (Vec::new(), Vec::new());
    for axis in ["x", "y", "z"].iter().take(D) {
        let at_field = header.fields.iter().position(|name| name == axis);
        let at_field = at_field.ok_or_else(|| at(line, format!("no field `{axis}`")))?;
        axes.push((fields[..at_field].iter().map(|(k, n)| k.size() * n).sum(), fields[at_field].0));
        columns.push(fields[..at_field].iter().map(|(_, n)| n).sum());
    }
    let count = header.points.unwrap_or(header.area);
    match data.as_str() {
        "ascii" => text_points(rest, count, &columns, line + 1),
        "binary" => {
            let record = fields.iter().map(|(kind, n)| kind.size() * n).sum();
            binary_points(rest, count, &Layout { axes, record, big_endian: false }, line)
        }
        other => Err(at(line, format!("DATA `{other}` is not supported"))),
    }
}

struct Header {
    fields: Vec<String>,
    sizes: Vec<usize>,
    types: Vec<String>,
    counts: Option<Vec<usize>>,
    points: Option<usize>,
    area: usize,
}

impl Default for Header {
    fn default() -> Self {
        Self { fields: vec![], sizes: vec![], types: vec![], counts: None, points: None, area: 1 }
    }
}

impl Header {
    /// Kind and number of values of each field.
    fn kinds(&self, line: usize) -> Result<Vec<(Kind, usize)>, Error> {
        let n = self.fields.len();
        let ones = vec![1; n];
        let counts = self.counts.as_ref().unwrap_or(&ones);
        if self.sizes.len() != n || self.types.len() != n || counts.len() != n {
            return Err(at(line, "FIELDS, SIZE, TYPE and COUNT differ in length"));
        }
        let kind = |i: usize| match (self.types[i].as_str(), self.sizes[i]) {
            ("F", size @ (4 | 8)) => Ok((Kind::Float(size), counts[i])),
            ("I", size @ (1 | 2 | 4 | 8)) => Ok((Kind::Int(size), counts[i])),
            ("U", size @ (1 | 2 | 4 | 8)) => Ok((Kind::Unsigned(size), counts[i])),
            (name, size) => Err(at(line, format!("field type `{name}` of {size} bytes is not known"))),
        };
        (0..n).map(kind).collect()
    }
}

fn counts(line: usize, values: &[String]) -> Result<Vec<usize>, Error> {
    // a bound keeps sums and products of sizes far from overflow
    const MOST: usize = 1 << 40;
    let one = |v: &String| v.parse::<usize>().ok().filter(|n| *n <= MOST);
    values.iter().map(|v| one(v).ok_or_else(|| at(line, format!("`{v}` is not a count")))).collect()
}
