//! Imports point up the list of modules in `src/lib.rs`, never down it.

use std::fs;
use std::path::{Path, PathBuf};

/// Names of the modules in `src/lib.rs`, in its order.
fn modules() -> Vec<String> {
    let text = fs::read_to_string("src/lib.rs").unwrap();
    let names = text.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'));
    names.map(str::to_owned).collect()
}

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// First word of each path after `crate::` in the code, comments left out: `crate::base::Error`, and each member of
/// `crate::{pipeline, report}`.
fn imported(text: &str) -> Vec<String> {
    let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
    let code = code.join("\n");
    let mut words = Vec::new();
    for (at, found) in code.match_indices("crate::") {
        let path = &code[at + found.len()..];
        match path.strip_prefix('{') {
            Some(list) => words.extend(members(list)),
            None => words.push(first_word(path)),
        }
    }
    words
}

/// First words of the members of a list, up to its closing brace.
fn members(list: &str) -> Vec<String> {
    let (mut depth, mut words, mut start) = (0, Vec::new(), 0);
    for (at, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                words.push(first_word(list[start..at].trim()));
                start = at + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

fn first_word(path: &str) -> String {
    path.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

#[test]
fn no_module_imports_one_that_comes_after_it() {
    let modules = modules();
    let place = |name: &str| modules.iter().position(|module| module == name);
    assert!(modules.len() > 10, "the modules stand in src/lib.rs, one `pub mod` a line");
    let mut files = Vec::new();
    rust_files(Path::new("src"), &mut files);
    files.sort();
    let mut faults = Vec::new();
    for path in files {
        let inside = path.strip_prefix("src").unwrap();
        let first = inside.components().next().unwrap().as_os_str().to_string_lossy().into_owned();
        let Some(own) = place(first.trim_end_matches(".rs")) else { continue };
        for word in imported(&fs::read_to_string(&path).unwrap()) {
            match place(&word) {
                Some(other) if other > own => faults.push(format!("{}: imports crate::{word}", path.display())),
                _ => {}
            }
        }
    }
    assert_eq!(faults, Vec::<String>::new());
}

#[test]
fn every_folder_and_file_below_src_is_in_the_list() {
    let modules = modules();
    for entry in fs::read_dir("src").unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        assert!(modules.contains(&name) || ["lib", "main"].contains(&&*name), "{name} is missing in src/lib.rs");
    }
}

#[test]
fn imports_are_found_in_every_form() {
    let text = "use crate::base::{Error, Result};\nuse crate::{pipeline, report::{a, b}};\n// crate::cli\nlet x = crate::os::y();";
    assert_eq!(imported(text), ["base", "pipeline", "report", "os"]);
}
