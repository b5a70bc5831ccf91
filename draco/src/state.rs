//! State files: what a robot, or a whole mission, needs to go on after its process has ended.
//!
//! A file holds a magic word, a BLAKE3 hash and the state. It is written beside its place, flushed to the disk and then
//! renamed, so that a crash leaves the old file or the new one; a file that is torn all the same, or was made by another
//! version, is refused by its hash or its magic word.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::Error;

/// Changes whenever the layout of a state does.
const MAGIC: [u8; 8] = *b"draco-08";
const HASH_BYTES: usize = 32;

/// The bytes of a state file that holds `state`.
///
/// # Errors
/// [`Error::State`] for a state that cannot be written down.
pub(crate) fn to_bytes(state: &impl Serialize) -> Result<Vec<u8>, Error> {
    let body = postcard::to_stdvec(state).map_err(|e| Error::State { reason: e.to_string() })?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(blake3::hash(&body).as_bytes());
    bytes.extend_from_slice(&body);
    Ok(bytes)
}

/// The state in the bytes of a state file.
///
/// # Errors
/// [`Error::State`] for bytes that are no whole state file of this version.
pub(crate) fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Error> {
    let refuse = |reason: &str| Error::State { reason: reason.into() };
    let rest = bytes.strip_prefix(&MAGIC).ok_or_else(|| refuse("not a state file of this version"))?;
    let (hash, body) =
        rest.split_first_chunk::<HASH_BYTES>().ok_or_else(|| refuse("the state file is cut off"))?;
    if blake3::hash(body) != *hash {
        return Err(refuse("the state file is torn: its hash does not fit"));
    }
    match postcard::take_from_bytes(body) {
        Ok((state, [])) => Ok(state),
        Ok(_) => Err(refuse("bytes are left over in the state file")),
        Err(error) => Err(refuse(&error.to_string())),
    }
}

/// Puts `bytes` at `path`, whole or not at all.
///
/// # Errors
/// [`Error::Io`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let io = |source| Error::io(path, source);
    let mut beside = path.as_os_str().to_os_string();
    beside.push(".new");
    let mut file = File::create(&beside).map_err(io)?;
    file.write_all(bytes).map_err(io)?;
    file.sync_all().map_err(io)?;
    fs::rename(&beside, path).map_err(io)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_not_whole_is_refused() {
        let bytes = to_bytes(&vec![1.5_f64, -0.0, f64::MIN_POSITIVE]).unwrap();
        assert_eq!(from_bytes::<Vec<f64>>(&bytes).unwrap(), [1.5, -0.0, f64::MIN_POSITIVE]);
        for length in 0..bytes.len() {
            assert!(from_bytes::<Vec<f64>>(&bytes[..length]).is_err(), "{length}");
        }
        for bit in 0..8 * bytes.len() {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(matches!(from_bytes::<Vec<f64>>(&flipped), Err(Error::State { .. })), "{bit}");
        }
    }
}
