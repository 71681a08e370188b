//! The source below `src/` as modules, and which file takes names from which.
#![allow(dead_code, reason = "each test uses a part of it")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};

/// A module: the words of its path below the crate, such as `["base", "error"]`.
pub type ModulePath = Vec<String>;

/// A file of the crate, parsed.
pub struct SourceFile {
    pub path: PathBuf,
    pub text: String,
    pub module: ModulePath,
    pub items: Vec<syn::Item>,
}

/// All files of the crate that its tests alone do not need, by module.
pub struct Source {
    pub files: BTreeMap<ModulePath, SourceFile>,
    /// For each module, the names that `use` brings into it, and what they stand for.
    uses: BTreeMap<ModulePath, BTreeMap<String, Vec<ModulePath>>>,
}

impl Source {
    /// Reads the crate whose root is `src/lib.rs`.
    pub fn read() -> Self {
        let mut files = BTreeMap::new();
        read_module(Path::new("src/lib.rs"), Path::new("src"), Vec::new(), &mut files);
        let uses = files.values().map(|file| (file.module.clone(), used_names(file))).collect();
        Self { files, uses }
    }

    /// Which file takes names from which, by module: `mod` and `pub use` do not count, the file that defines a name does.
    pub fn imports(&self) -> BTreeMap<&ModulePath, BTreeSet<&ModulePath>> {
        let of = |file: &SourceFile| {
            let mut paths = Paths { found: Vec::new() };
            file.items.iter().for_each(|item| paths.visit_item(item));
            let defining = paths.found.iter().flat_map(|path| self.definitions(&file.module, path, 0));
            defining.filter(|module| **module != file.module).collect()
        };
        self.files.values().map(|file| (&file.module, of(file))).collect()
    }

    /// The modules that define what a path names, seen from a module.
    fn definitions(&self, from: &ModulePath, path: &[String], depth: usize) -> Vec<&ModulePath> {
        let Some(path) = self.absolute(from, path) else { return Vec::new() };
        let deepest = (0..=path.len()).rev().find(|&length| self.files.contains_key(&path[..length]));
        let Some((module, _)) = deepest.and_then(|length| self.files.get_key_value(&path[..length])) else {
            return Vec::new();
        };
        let rest = &path[module.len()..];
        let re_exported = rest.first().and_then(|name| self.uses[module].get(name));
        match re_exported {
            Some(targets) if depth < 8 => targets
                .iter()
                .flat_map(|target| {
                    let longer: Vec<String> = target.iter().chain(&rest[1..]).cloned().collect();
                    self.definitions(module, &longer, depth + 1)
                })
                .collect(),
            _ => vec![module],
        }
    }

    /// The path from the crate's root; `None` if it leads to another crate.
    fn absolute(&self, from: &ModulePath, path: &[String]) -> Option<ModulePath> {
        let first = path.first()?;
        let rest = &path[1..];
        let join = |base: &[String], rest: &[String]| Some(base.iter().chain(rest).cloned().collect::<Vec<String>>());
        match first.as_str() {
            "crate" => join(&[], rest),
            "self" => join(from, rest),
            "super" => {
                let parent = &from[..from.len().checked_sub(1)?];
                match rest.first().map(String::as_str) {
                    Some("super") => self.absolute(&parent.to_vec(), rest),
                    _ => join(parent, rest),
                }
            }
            child => {
                let module: ModulePath = from.iter().cloned().chain([child.to_owned()]).collect();
                self.files.contains_key(&module).then(|| join(&module, rest)).flatten()
            }
        }
    }
}

fn read_module(path: &Path, folder: &Path, module: ModulePath, files: &mut BTreeMap<ModulePath, SourceFile>) {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut items = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display())).items;
    items.retain(|item| !is_for_tests(attributes_of(item)));
    for item in &items {
        let syn::Item::Mod(child) = item else { continue };
        if child.content.is_some() {
            continue;
        }
        let name = child.ident.to_string();
        let beside = [folder.join(format!("{name}.rs")), folder.join(&name).join("mod.rs")];
        let file = beside.iter().find(|file| file.exists()).unwrap_or_else(|| panic!("no file of module {name}"));
        let inner = module.iter().cloned().chain([name.clone()]).collect();
        read_module(file, &folder.join(&name), inner, files);
    }
    files.insert(module.clone(), SourceFile { path: path.to_owned(), text, module, items });
}

/// Whether something is compiled for tests alone.
pub fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let syn::Meta::List(list) = &attribute.meta else { return false };
        list.path.is_ident("cfg") && list.tokens.to_string().contains("test")
    })
}

pub fn attributes_of(item: &syn::Item) -> &[syn::Attribute] {
    match item {
        syn::Item::Const(item) => &item.attrs,
        syn::Item::Enum(item) => &item.attrs,
        syn::Item::Fn(item) => &item.attrs,
        syn::Item::Impl(item) => &item.attrs,
        syn::Item::Mod(item) => &item.attrs,
        syn::Item::Struct(item) => &item.attrs,
        syn::Item::Trait(item) => &item.attrs,
        syn::Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// The names that `use` brings into a file, with the paths as they are written.
fn used_names(file: &SourceFile) -> BTreeMap<String, Vec<Vec<String>>> {
    let mut names: BTreeMap<String, Vec<Vec<String>>> = BTreeMap::new();
    for item in &file.items {
        let syn::Item::Use(item) = item else { continue };
        for (name, path) in leaves(&item.tree, &mut Vec::new()) {
            names.entry(name).or_default().push(path);
        }
    }
    names
}

/// Each name that a `use` tree brings, and its path; a glob brings none.
fn leaves(tree: &syn::UseTree, before: &mut Vec<String>) -> Vec<(String, Vec<String>)> {
    let with = |name: &syn::Ident| before.iter().cloned().chain([name.to_string()]).collect::<Vec<String>>();
    match tree {
        syn::UseTree::Path(path) => {
            before.push(path.ident.to_string());
            let found = leaves(&path.tree, before);
            before.pop();
            found
        }
        syn::UseTree::Name(name) if name.ident == "self" => {
            vec![(before.last().cloned().unwrap_or_default(), before.clone())]
        }
        syn::UseTree::Name(name) => vec![(name.ident.to_string(), with(&name.ident))],
        syn::UseTree::Rename(name) => vec![(name.rename.to_string(), with(&name.ident))],
        syn::UseTree::Group(group) => group.items.iter().flat_map(|tree| leaves(tree, before)).collect(),
        syn::UseTree::Glob(_) => vec![("*".to_owned(), before.clone())],
    }
}

/// Collects every path of more than one word, those of private `use` among them.
struct Paths {
    found: Vec<Vec<String>>,
}

impl<'ast> Visit<'ast> for Paths {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if !is_for_tests(attributes_of(item)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if matches!(item.vis, syn::Visibility::Inherited) {
            self.found.extend(leaves(&item.tree, &mut Vec::new()).into_iter().map(|(_, path)| path));
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.segments.len() > 1 {
            self.found.push(path.segments.iter().map(|segment| segment.ident.to_string()).collect());
        }
        visit::visit_path(self, path);
    }

    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}
}

/// Groups of modules that all reach each other. A module alone is no group. O(modules × imports).
pub fn circles<'a>(imports: &BTreeMap<&'a ModulePath, BTreeSet<&'a ModulePath>>) -> Vec<Vec<&'a ModulePath>> {
    let reachable = |from: &'a ModulePath| {
        let mut seen = BTreeSet::new();
        let mut open: Vec<&ModulePath> = imports[from].iter().copied().collect();
        while let Some(module) = open.pop() {
            if seen.insert(module) {
                open.extend(&imports[module]);
            }
        }
        seen
    };
    let reach: BTreeMap<&ModulePath, BTreeSet<&ModulePath>> =
        imports.keys().map(|&module| (module, reachable(module))).collect();
    let mut grouped: BTreeSet<&ModulePath> = BTreeSet::new();
    let mut circles = Vec::new();
    for (&module, others) in &reach {
        if !others.contains(module) || grouped.contains(module) {
            continue;
        }
        let circle: Vec<&ModulePath> = others.iter().copied().filter(|other| reach[other].contains(module)).collect();
        grouped.extend(&circle);
        circles.push(circle);
    }
    circles
}
