//! The header at the start of every file in the work folder.
//!
//! ```text
//! 0        8        16      20      24       32         40      56         64
//! | magic  | kind   | vers. | size  | count  | checksum | zeros | checksum | records, little-endian …
//! ```
//!
//! The first checksum covers everything after the header, so length and first 64 bytes identify a file. The second
//! covers the header before it, in every version, so that another version is distinguishable from damage.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;

use crate::os::durable::no_links;

/// Size of the header in bytes.
pub const HEADER_BYTES: u64 = 64;
const MAGIC: [u8; 8] = *b"drystone";
/// Version of the work folder's files.
pub const FORMAT_VERSION: u32 = 28;
/// Offset of the header's own checksum.
const CHECKSUM_AT: usize = 56;

#[cfg(target_endian = "big")]
compile_error!("drystone's files are little-endian and are mapped as they are: big-endian machines are not supported");

/// The header of a file of records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Kind of the records, in ASCII, padded with blanks.
    pub kind: [u8; 8],
    /// Bytes per record; 0 if records vary in size.
    pub record_bytes: u32,
    /// Number of records.
    pub count: u64,
    /// XXH3 of everything after the header.
    pub checksum: u64,
}

impl Header {
    /// Encodes the header.
    pub fn encode(&self) -> [u8; HEADER_BYTES as usize] {
        let mut bytes = [0; HEADER_BYTES as usize];
        bytes[0..8].copy_from_slice(&MAGIC);
        bytes[8..16].copy_from_slice(&self.kind);
        bytes[16..20].copy_from_slice(&FORMAT_VERSION.to_le_bytes());
        bytes[20..24].copy_from_slice(&self.record_bytes.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.count.to_le_bytes());
        bytes[32..40].copy_from_slice(&self.checksum.to_le_bytes());
        seal(&mut bytes);
        bytes
    }

    /// Returns the format version of an encoded header; `None` if it is no header, or a damaged one.
    pub fn version(bytes: &[u8; HEADER_BYTES as usize]) -> Option<u32> {
        let version = u32::from_le_bytes([bytes[16], bytes[17], bytes[18], bytes[19]]);
        (bytes[0..8] == MAGIC && is_sealed(bytes)).then_some(version)
    }

    /// Reports whether a file starts like those of work folders.
    pub fn is_at(path: &Path) -> bool {
        let mut begins = [0; MAGIC.len()];
        let mut options = File::options();
        let file = no_links(options.read(true)).open(path);
        file.and_then(|mut file| file.read_exact(&mut begins)).is_ok() && begins == MAGIC
    }

    /// Decodes a header.
    ///
    /// # Errors
    /// A description of the mismatch.
    pub fn decode(bytes: &[u8; HEADER_BYTES as usize]) -> Result<Self, String> {
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        if bytes[0..8] != MAGIC {
            return Err("it does not begin with 'drystone'".into());
        }
        if !is_sealed(bytes) {
            return Err("its header does not have its checksum".into());
        }
        if word(16) != FORMAT_VERSION {
            return Err(format!("its format is version {}, this program writes version {FORMAT_VERSION}", word(16)));
        }
        let kind = std::array::from_fn(|k| bytes[8 + k]);
        Ok(Self { kind, record_bytes: word(20), count: long(24), checksum: long(32) })
    }
}

/// Stores the header's own checksum.
pub fn seal(bytes: &mut [u8; HEADER_BYTES as usize]) {
    let checksum = xxh3_64(&bytes[..CHECKSUM_AT]);
    bytes[CHECKSUM_AT..].copy_from_slice(&checksum.to_le_bytes());
}

fn is_sealed(bytes: &[u8; HEADER_BYTES as usize]) -> bool {
    bytes[CHECKSUM_AT..] == xxh3_64(&bytes[..CHECKSUM_AT]).to_le_bytes()
}

/// Reads the header of a file and asserts that its checksum matches the rest.
#[cfg(test)]
pub fn checked_header(path: &Path) -> Header {
    let bytes = std::fs::read(path).unwrap();
    let (header, rest) = bytes.split_first_chunk().unwrap();
    let header = Header::decode(header).unwrap();
    assert_eq!(header.checksum, xxh3_64(rest), "{}", path.display());
    header
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_header_of_another_version_is_refused() {
        let header = Header { kind: *b"test    ", record_bytes: 8, count: 3, checksum: 9 };
        let mut bytes = header.encode();
        assert_eq!(Header::decode(&bytes), Ok(header));
        bytes[16] = 77;
        seal(&mut bytes);
        assert!(Header::decode(&bytes).unwrap_err().contains("version 77"));
        assert_eq!(Header::version(&bytes), Some(77));
        // Another magic means a file of another program, whatever its checksum.
        bytes[0] = b'D';
        seal(&mut bytes);
        assert!(Header::decode(&bytes).unwrap_err().contains("begin"));
        assert_eq!(Header::version(&bytes), None);
    }

    proptest! {
        #[test]
        fn a_header_is_laid_out_as_described(
            kind in any::<[u8; 8]>(),
            record_bytes: u32,
            count: u64,
            checksum: u64,
            version: u32,
        ) {
            let header = Header { kind, record_bytes, count, checksum };
            let size = record_bytes.to_le_bytes();
            let [count, checksum] = [count, checksum].map(u64::to_le_bytes);
            let layout = |version: u32| {
                let parts = [b"drystone", &kind[..], &version.to_le_bytes(), &size, &count, &checksum, &[0; 16]];
                let parts = parts.concat();
                let own = xxh3_64(&parts).to_le_bytes();
                <[u8; 64]>::try_from([&parts[..], &own].concat()).unwrap()
            };
            prop_assert_eq!(header.encode(), layout(FORMAT_VERSION));
            prop_assert_eq!(Header::decode(&header.encode()), Ok(header));
            prop_assert_eq!(Header::version(&layout(version)), Some(version));
            prop_assert_eq!(Header::decode(&layout(version)).is_ok(), version == FORMAT_VERSION);
        }
    }

    #[test]
    fn a_damaged_header_is_no_other_version() {
        let whole = Header { kind: *b"test    ", record_bytes: 8, count: 3, checksum: 9 }.encode();
        for at in 0..whole.len() {
            let mut bytes = whole;
            bytes[at] ^= 1;
            assert!(Header::decode(&bytes).is_err(), "byte {at}");
            assert_eq!(Header::version(&bytes), None, "byte {at}");
        }
    }
}
