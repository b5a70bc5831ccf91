use nalgebra::SVector;

use super::at;
use crate::Error;

/// How one value is stored in binary data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Int(usize),
    Unsigned(usize),
    Float(usize),
}

impl Kind {
    pub(crate) fn size(self) -> usize {
        match self {
            Kind::Int(size) | Kind::Unsigned(size) | Kind::Float(size) => size,
        }
    }

    /// The value at the start of `bytes`; `None` when they are too few.
    pub(crate) fn read(self, bytes: &[u8], big_endian: bool) -> Option<f64> {
        let mut raw = [0u8; 8];
        let size = self.size();
        raw[..size].copy_from_slice(bytes.get(..size)?);
        if big_endian {
            raw[..size].reverse();
        }
        let bits = u64::from_le_bytes(raw);
        Some(match self {
            Kind::Float(4) => f64::from(f32::from_bits(bits as u32)),
            Kind::Float(_) => f64::from_bits(bits),
            Kind::Unsigned(_) => bits as f64,
            Kind::Int(_) => {
                let unused = 64 - 8 * size as u32;
                ((bits << unused) as i64 >> unused) as f64
            }
        })
    }
}

/// Where the coordinates lie in a binary record.
pub(crate) struct Layout {
    /// Byte offset and kind of each coordinate.
    pub(crate) axes: Vec<(usize, Kind)>,
    pub(crate) record: usize,
    pub(crate) big_endian: bool,
}

/// Reads `count` records; points with a coordinate that is not finite are dropped.
pub(crate) fn binary_points<const D: usize>(
    bytes: &[u8],
    count: usize,
    layout: &Layout,
    line: usize,
) -> Result<Vec<SVector<f64, D>>, Error> {
    if layout.record == 0 {
        return Err(at(line, "the fields have no size"));
    }
    let available = bytes.len() / layout.record;
    if available < count {
        return Err(at(
            line,
            format!("the binary data after this line ends after {available} of {count} points"),
        ));
    }
    let mut points = Vec::with_capacity(count);
    for record in bytes.chunks_exact(layout.record).take(count) {
        let mut point = SVector::<f64, D>::zeros();
        for (axis, (offset, kind)) in layout.axes.iter().take(D).enumerate() {
            let field = record.get(*offset..).unwrap_or_default();
            point[axis] = kind.read(field, layout.big_endian).unwrap_or(f64::NAN);
        }
        if point.iter().all(|v| v.is_finite()) {
            points.push(point);
        }
    }
    Ok(points)
}

/// Reads `count` lines of text whose words `columns` are the coordinates.
pub(crate) fn text_points<const D: usize>(
    bytes: &[u8],
    count: usize,
    columns: &[usize],
    first_line: usize,
) -> Result<Vec<SVector<f64, D>>, Error> {
    let mut points = Vec::with_capacity(count.min(bytes.len()));
    let mut lines = (first_line..).zip(bytes.split(|b| *b == b'\n'));
    for read in 0..count {
        let Some((line, raw)) = lines.find(|(_, raw)| !raw.iter().all(u8::is_ascii_whitespace)) else {
            let ended = format!("the file ends after {read} of {count} points");
            return Err(at(first_line + bytes.split(|b| *b == b'\n').count() - 1, ended));
        };
        let words: Vec<&str> = super::text(line, raw)?.split_whitespace().collect();
        let mut point = SVector::<f64, D>::zeros();
        for (axis, column) in columns.iter().take(D).enumerate() {
            let word = words.get(*column).ok_or_else(|| at(line, format!("{} values only", words.len())))?;
            point[axis] = word.parse::<f64>().map_err(|_| at(line, format!("`{word}` is not a number")))?;
        }
        if point.iter().all(|v| v.is_finite()) {
            points.push(point);
        }
    }
    Ok(points)
}

/// Splits the first line off; `None` at the end.
pub(crate) fn next_line<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    if rest.is_empty() {
        return None;
    }
    let end = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
    let line = &rest[..end];
    *rest = &rest[(end + 1).min(rest.len())..];
    Some(line)
}
