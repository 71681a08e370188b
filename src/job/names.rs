//! Names of the files of phases in a work folder.

/// Prefixes and suffixes of the names of all other files.
const PREFIXES: [&str; 6] = ["scan-", "pass-", "bake-", "tile-", "write-", "measure-"];
const SUFFIXES: [&str; 13] = [
    ".col", ".plc", ".blk", ".buckets", ".piece", ".bin", ".cells", ".texels", ".png", ".jpg", ".state", ".results",
    ".tmp",
];

/// What a network disk, or a disk in user space, names a file that was removed while a process had it open, until that
/// process closes it; letters and digits follow.
const REMAINS: [&str; 2] = [".nfs", ".fuse_hidden"];

/// Reports whether a name is that of a file that was removed while it was open.
pub(super) fn is_remains(name: &str) -> bool {
    let rest = REMAINS.iter().find_map(|prefix| name.strip_prefix(prefix));
    rest.is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|c| c.is_ascii_hexdigit()))
}

/// Reports whether phases of a job write files of this name.
pub(super) fn is_phase_file(name: &str) -> bool {
    PREFIXES.iter().any(|prefix| name.starts_with(prefix)) && SUFFIXES.iter().any(|suffix| name.ends_with(suffix))
}
