use std::path::Path;
use std::str::{FromStr, SplitAsciiWhitespace};

use crate::Error;

/// The text of a file, parsed; an error names the file.
pub(super) fn read<T>(path: &Path, parse: impl FnOnce(&str) -> Result<T, Error>) -> Result<T, Error> {
    let bytes = std::fs::read(path).map_err(|e| file_error(path, &e))?;
    let parsed = match std::str::from_utf8(&bytes) {
        Ok(text) => parse(text),
        Err(e) => {
            let line = bytes.iter().take(e.valid_up_to()).filter(|b| **b == b'\n').count() + 1;
            Err(Error::Parse { line, reason: "is not text in UTF-8".into() })
        }
    };
    parsed.map_err(|error| Error::InFile { path: path.display().to_string(), error: Box::new(error) })
}

/// Writes a text to a file.
pub(super) fn write(path: &Path, text: &str) -> Result<(), Error> {
    std::fs::write(path, text).map_err(|e| file_error(path, &e))
}

pub(super) fn file_error(path: &Path, error: &std::io::Error) -> Error {
    Error::File { path: path.display().to_string(), reason: error.to_string() }
}

/// The next number of a line, finite.
pub(super) fn number(tokens: &mut SplitAsciiWhitespace) -> Result<f64, String> {
    let token = tokens.next().ok_or("the line ends where a number is due")?;
    let value = f64::from_str(token).map_err(|_| format!("{token:?} is not a number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("{token:?} is not finite")) }
}

/// Fails when a line goes on.
pub(super) fn end(tokens: &mut SplitAsciiWhitespace) -> Result<(), String> {
    match tokens.next() {
        Some(extra) => Err(format!("unexpected {extra:?} after the last number")),
        None => Ok(()),
    }
}

/// The poses of a text with one pose a line; empty lines and lines that start with `#` are passed over.
pub(super) fn lines<T>(
    text: &str,
    parse: impl Fn(&mut SplitAsciiWhitespace) -> Result<T, String>,
) -> Result<Vec<T>, Error> {
    let mut parsed = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let mut tokens = line.split_ascii_whitespace();
        if tokens.clone().next().is_none_or(|first| first.starts_with('#')) {
            continue;
        }
        let value = parse(&mut tokens).and_then(|value| end(&mut tokens).map(|()| value));
        parsed.push(value.map_err(|reason| Error::Parse { line: index + 1, reason })?);
    }
    Ok(parsed)
}
