use nalgebra::SVector;

use super::fields::{Kind, Layout, binary_points, next_line, text_points};
use super::{at, text};
use crate::Error;

/// Points of a PLY file (ASCII or binary, either byte order): `x`, `y`, `z` of the element `vertex`, which must
/// come first.
///
/// # Errors
/// [`Error::Parse`] with the line; for binary data the last line of the header.
pub fn parse_ply<const D: usize>(bytes: &[u8]) -> Result<Vec<SVector<f64, D>>, Error> {
    let mut rest = bytes;
    let mut line = 1;
    if next_line(&mut rest).map(|l| text(1, l)) != Some(Ok("ply")) {
        return Err(at(1, "a PLY file starts with `ply`"));
    }
    let (mut format, mut count, mut in_vertex) = (None, None, false);
    let mut names: Vec<(String, Kind)> = Vec::new();
    loop {
        line += 1;
        let raw = next_line(&mut rest).ok_or_else(|| at(line, "the header does not end"))?;
        let words: Vec<&str> = text(line, raw)?.split_whitespace().collect();
        match words.as_slice() {
            ["end_header"] => break,
            ["format", name, _] => format = Some((*name).to_string()),
            ["element", "vertex", n] => {
                if in_vertex || count.is_some() {
                    return Err(at(line, "a second element `vertex`"));
                }
                count = Some(n.parse::<usize>().map_err(|_| at(line, format!("`{n}` is not a count")))?);
                in_vertex = true;
            }
            ["element", name, _] => {
                if count.is_none() {
                    return Err(at(line, format!("element `{name}` before `vertex` is not supported")));
                }
                in_vertex = false;
            }
            ["property", "list", ..] if in_vertex => return Err(at(line, "a list property of `vertex`")),
            ["property", kind, name] if in_vertex => names.push(((*name).to_string(), kind_of(line, kind)?)),
            _ => {}
        }
    }
    let count = count.ok_or_else(|| at(line, "no element `vertex`"))?;
    let mut axes = Vec::new();
    let mut columns = Vec::new();
    for axis in ["x", "y", "z"].iter().take(D) {
        let column = names.iter().position(|(name, _)| name == axis);
        let column = column.ok_or_else(|| at(line, format!("no property `{axis}`")))?;
        let offset = names[..column].iter().map(|(_, kind)| kind.size()).sum();
        axes.push((offset, names[column].1));
        columns.push(column);
    }
    let record = names.iter().map(|(_, kind)| kind.size()).sum();
    match format.as_deref() {
        Some("ascii") => text_points(rest, count, &columns, line + 1),
        Some(name @ ("binary_little_endian" | "binary_big_endian")) => {
            let layout = Layout { axes, record, big_endian: name == "binary_big_endian" };
            binary_points(rest, count, &layout, line)
        }
        other => Err(at(line, format!("format `{}` is not known", other.unwrap_or("(none)")))),
    }
}

fn kind_of(line: usize, name: &str) -> Result<Kind, Error> {
    Ok(match name {
        "char" | "int8" => Kind::Int(1),
        "uchar" | "uint8" => Kind::Unsigned(1),
        "short" | "int16" => Kind::Int(2),
        "ushort" | "uint16" => Kind::Unsigned(2),
        "int" | "int32" => Kind::Int(4),
        "uint" | "uint32" => Kind::Unsigned(4),
        "float" | "float32" => Kind::Float(4),
        "double" | "float64" => Kind::Float(8),
        _ => return Err(at(line, format!("property type `{name}` is not known"))),
    })
}
