//! Names of the files of phases in a work folder.

/// Prefixes and suffixes of the names of all other files.
const PREFIXES: [&str; 6] = ["scan-", "pass-", "bake-", "tile-", "write-", "measure-"];
const SUFFIXES: [&str; 13] = [
    ".col", ".plc", ".blk", ".buckets", ".piece", ".bin", ".cells", ".texels", ".png", ".jpg", ".state", ".results",
    ".tmp",
];

/// Reports whether phases of a job write files of this name.
pub(super) fn is_phase_file(name: &str) -> bool {
    PREFIXES.iter().any(|prefix| name.starts_with(prefix)) && SUFFIXES.iter().any(|suffix| name.ends_with(suffix))
}
