//! Imports point up the list of modules in `src/lib.rs`, and no files import each other in a circle.

use std::fs;

use crate::source::{ModulePath, Source, circles};

/// Names of the modules in `src/lib.rs`, in its order.
fn modules(source: &Source) -> Vec<String> {
    let root = &source.files[&ModulePath::new()];
    let name = |item: &syn::Item| if let syn::Item::Mod(module) = item { Some(module.ident.to_string()) } else { None };
    root.items.iter().filter_map(name).collect()
}

fn name(module: &ModulePath) -> String {
    module.join("::")
}

#[test]
fn no_module_imports_one_that_comes_after_it() {
    let source = Source::read();
    let modules = modules(&source);
    assert!(modules.len() > 10, "the modules stand in src/lib.rs");
    let place = |module: &ModulePath| modules.iter().position(|name| Some(name) == module.first());
    let mut faults = Vec::new();
    for (module, others) in source.imports() {
        let Some(own) = place(module) else { continue };
        let later = others.iter().filter(|other| place(other).is_none_or(|other| other > own));
        faults.extend(later.map(|other| format!("{} imports {}", name(module), name(other))));
    }
    assert_eq!(faults, Vec::<String>::new());
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let source = Source::read();
    let imports = source.imports();
    let circles = circles(&imports);
    let described: Vec<String> = circles
        .iter()
        .map(|circle| {
            let edges = circle.iter().flat_map(|module| {
                let inside = imports[module].iter().filter(|other| circle.contains(other));
                inside.map(|other| format!("{} -> {}", name(module), name(other)))
            });
            edges.collect::<Vec<String>>().join("\n  ")
        })
        .collect();
    assert!(circles.is_empty(), "circles of files:\n  {}", described.join("\n\n  "));
}

#[test]
fn every_folder_and_file_below_src_is_in_the_list() {
    let modules = modules(&Source::read());
    for entry in fs::read_dir("src").unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        assert!(modules.contains(&name) || ["lib", "main"].contains(&&*name), "{name} is missing in src/lib.rs");
    }
}

#[test]
fn imports_are_found_in_every_form() {
    let source = Source::read();
    let imports = source.imports();
    let module = |name: &str| name.split("::").map(str::to_owned).collect::<ModulePath>();
    // `use crate::{...}`, `use super::`, a path in the code, and a name that `base/mod.rs` hands on.
    let cost = &imports[&module("cost::classic")];
    assert!(cost.contains(&module("cost::quadric")), "{cost:?}");
    assert!(imports.values().flatten().any(|other| **other == module("base::error")));
    assert!(
        !imports.values().flatten().any(|other| **other == module("base")),
        "names of base are defined in its files"
    );
}
