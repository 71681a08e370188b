//! The first line of the files that are written.

/// The comment at the start of the OBJ and the MTL.
pub(super) fn signature() -> Vec<u8> {
    format!("# drystone {}\n", env!("CARGO_PKG_VERSION")).into_bytes()
}
