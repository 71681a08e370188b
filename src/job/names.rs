//! Names of the files of phases in a work folder.

/// Prefixes and suffixes of the names of all other files.
const PREFIXES: [&str; 7] = ["scan-", "pass-", "bake-", "tile-", "write-", "measure-", "topology-"];
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Names of the first table of the reference, whose letters P, N, C, … stand for numbers.
    fn documented_names() -> Vec<String> {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reference/work-folder.md");
        let page = std::fs::read_to_string(page).unwrap();
        let table = page.split("\n\n").find(|part| part.starts_with("| File | Holds | Written by |")).unwrap();
        let cells = table.lines().skip(2).filter_map(|row| row.split('|').nth(1));
        let names = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2));
        names.filter(|name| name.contains('-') && !name.contains(['/', '*'])).map(str::to_owned).collect()
    }

    #[test]
    fn every_documented_file_of_a_phase_is_known_as_one() {
        let names = documented_names();
        assert!(names.len() > 30, "{names:?}");
        let unknown: Vec<&String> = names.iter().filter(|name| !is_phase_file(name)).collect();
        assert_eq!(unknown, Vec::<&String>::new());
        assert!(!is_phase_file("holiday-1.jpg") && !is_phase_file("topology-sides.txt"));
    }
}
