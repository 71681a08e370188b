//! Serialises vectors of plain numbers as one byte string: `#[serde(with = "records")]`.

use std::fmt;
use std::marker::PhantomData;

use bytemuck::Pod;
use serde::de::{Error, Visitor};
use serde::{Deserializer, Serializer};

/// Serialises the records as they lie in memory.
///
/// # Errors
/// Those of the serializer.
pub fn serialize<T: Pod, S: Serializer>(records: &impl AsRef<[T]>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytemuck::cast_slice(records.as_ref()))
}

/// Deserialises records.
///
/// # Errors
/// Those of the deserializer, and if the bytes are not a whole number of records.
pub fn deserialize<'de, T: Pod, V: From<Vec<T>>, D: Deserializer<'de>>(deserializer: D) -> Result<V, D::Error> {
    deserializer.deserialize_bytes(Records(PhantomData)).map(V::from)
}

struct Records<T>(PhantomData<T>);

impl<T: Pod> Visitor<'_> for Records<T> {
    type Value = Vec<T>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "records of {} bytes", size_of::<T>())
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<T>, E> {
        if bytes.len().is_multiple_of(size_of::<T>()) {
            Ok(bytemuck::pod_collect_to_vec(bytes))
        } else {
            Err(E::invalid_length(bytes.len(), &self))
        }
    }
}
