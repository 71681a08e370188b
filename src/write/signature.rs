//! The first line of the texts that are written, and statements in them.

/// The comment at the start of the OBJ and the MTL.
pub(super) fn signature() -> Vec<u8> {
    format!("# drystone {}\n", env!("CARGO_PKG_VERSION")).into_bytes()
}

/// Appends `key value` and a line end; replaces line ends and NULs in the value with blanks.
pub(super) fn put_statement(text: &mut Vec<u8>, key: &[u8], value: &[u8]) {
    text.extend_from_slice(key);
    text.push(b' ');
    text.extend(value.iter().map(|&c| if matches!(c, b'\n' | b'\r' | 0) { b' ' } else { c }));
    text.push(b'\n');
}
