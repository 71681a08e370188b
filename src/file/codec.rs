//! Encodes values as bytes: bincode in its standard configuration, with a limit on allocations.
//!
//! A decoder takes counts from the bytes that it decodes. The limit is lower for few bytes, so that a forged count ends in
//! an error and not in a huge allocation.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Bytes of memory per encoded byte: a varint of one byte may stand for eight.
const GROWTH: usize = 16;
/// Encoded bytes below which the lower limit holds.
const FEW_BYTES: usize = 1 << 20;
/// Limit of memory for any number of encoded bytes.
const MOST_BYTES: usize = 4 << 30;

/// Encodes a value.
///
/// # Errors
/// A description of the fault if the value cannot be encoded.
pub fn encode<T: Serialize>(value: &T) -> Result<Vec<u8>, String> {
    bincode::serde::encode_to_vec(value, bincode::config::standard()).map_err(|e| e.to_string())
}

/// Decodes a value from all of `bytes`.
///
/// # Errors
/// A description of the fault if they are invalid or exceed the limit.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let config = bincode::config::standard();
    // The limit is part of the decoder's type, and the code of every decoded type stands in the program once for each.
    let decoded = match bytes.len() {
        0..FEW_BYTES => bincode::serde::decode_from_slice(bytes, config.with_limit::<{ GROWTH * FEW_BYTES }>()),
        _ => bincode::serde::decode_from_slice(bytes, config.with_limit::<MOST_BYTES>()),
    };
    match decoded {
        Ok((value, used)) if used == bytes.len() => Ok(value),
        Ok((_, used)) => Err(format!("{} bytes are left over", bytes.len() - used)),
        Err(error) => Err(error.to_string()),
    }
}

/// Serialises paths as bytes, since a path need not be UTF-8.
pub mod path {
    use std::path::{Path, PathBuf};

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// Writes a path.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
        path.as_os_str().as_encoded_bytes().serialize(serializer)
    }

    /// Reads a path.
    ///
    /// # Errors
    /// Those of the deserializer.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<PathBuf, D::Error> {
        Ok(from_bytes(Vec::deserialize(deserializer)?))
    }

    #[cfg(unix)]
    pub(super) fn from_bytes(bytes: Vec<u8>) -> PathBuf {
        use std::os::unix::ffi::OsStringExt;
        std::ffi::OsString::from_vec(bytes).into()
    }

    #[cfg(not(unix))]
    pub(super) fn from_bytes(bytes: Vec<u8>) -> PathBuf {
        String::from_utf8_lossy(&bytes).into_owned().into()
    }
}

/// Paths as lists of bytes.
pub mod paths {
    use std::path::PathBuf;

    use serde::{Deserialize, Deserializer, Serializer};

    /// Writes paths.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer>(paths: &[PathBuf], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(paths.iter().map(|path| path.as_os_str().as_encoded_bytes()))
    }

    /// Reads paths.
    ///
    /// # Errors
    /// Those of the deserializer.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<PathBuf>, D::Error> {
        let paths: Vec<Vec<u8>> = Vec::deserialize(deserializer)?;
        Ok(paths.into_iter().map(super::path::from_bytes).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    struct Pair(#[serde(with = "crate::base::records")] Vec<[u32; 3]>, u8);

    #[test]
    fn records_come_back_and_half_a_record_is_refused() {
        let pair = Pair(vec![[1, 2, 3], [4, 5, u32::MAX]], 7);
        let mut bytes = encode(&pair).unwrap();
        assert_eq!(decode::<Pair>(&bytes), Ok(pair));
        assert_eq!(bytes[0], 24);
        bytes[0] = 23;
        bytes.pop();
        assert!(decode::<Pair>(&bytes).is_err());
        bytes.splice(0..1, [253, 0, 0, 0, 0, 0, 0, 0, 0x10]);
        assert!(decode::<Pair>(&bytes).is_err());
    }

    #[test]
    fn a_forged_count_is_refused_before_it_is_allocated() {
        let mut bytes = encode(&vec![7u64; 3]).unwrap();
        assert_eq!(decode::<Vec<u64>>(&bytes), Ok(vec![7; 3]));
        bytes.splice(0..1, [253, 0xff, 0xff, 0xff, 0xff, 0xff, 0, 0, 0]);
        assert!(decode::<Vec<u64>>(&bytes).is_err());
        assert!(decode::<String>(&bytes).is_err());
    }

    #[test]
    fn bytes_behind_the_value_are_an_error() {
        assert!(decode::<u8>(&[7, 7]).unwrap_err().contains("left over"));
    }
}
