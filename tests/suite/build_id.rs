//! What the program calls its build: two builds that may write other bytes have two names.

use std::fs;
use std::path::Path;

#[path = "../../build.rs"]
#[expect(dead_code, reason = "cargo runs the rest")]
mod build;

use build::checksum;

/// Sources of a package.
fn write(folder: &Path) {
    fs::create_dir_all(folder.join("src/inner")).unwrap();
    for (path, text) in [("src/lib.rs", "mod inner;"), ("src/inner/mod.rs", "// a"), ("Cargo.lock", "version = 4")] {
        fs::write(folder.join(path), text).unwrap();
    }
}

#[test]
fn builds_of_other_sources_have_other_names() {
    let [one, two] = [(), ()].map(|()| tempfile::tempdir().unwrap());
    let [one, two] = [one.path(), two.path()];
    write(one);
    write(two);
    let name = checksum(one, "rustc 1");
    assert_eq!(name, checksum(two, "rustc 1"), "it depends on the folder");
    assert_ne!(name, checksum(one, "rustc 2"));
    type Change = fn(&Path);
    let changes: [Change; 5] = [
        |folder| fs::write(folder.join("src/inner/mod.rs"), "// b").unwrap(),
        |folder| fs::write(folder.join("Cargo.lock"), "version = 5").unwrap(),
        |folder| fs::write(folder.join("src/new.rs"), "").unwrap(),
        |folder| fs::rename(folder.join("src/lib.rs"), folder.join("src/main.rs")).unwrap(),
        // The same bytes in succession, in other files.
        |folder| {
            fs::write(folder.join("src/lib.rs"), "mod inner").unwrap();
            fs::write(folder.join("src/inner/mod.rs"), ";// a").unwrap();
        },
    ];
    for (number, change) in changes.into_iter().enumerate() {
        change(two);
        assert_ne!(name, checksum(two, "rustc 1"), "change {number}");
        fs::remove_dir_all(two.join("src")).unwrap();
        write(two);
        assert_eq!(name, checksum(two, "rustc 1"));
    }
}

#[test]
fn the_program_names_its_sources() {
    let (_, sources) = drystone::cli::LONG_VERSION.split_once(", sources ").unwrap();
    assert_eq!(sources.len(), "0123456789abcdef)".len(), "{sources}");
}
