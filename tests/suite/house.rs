//! What keeps the house easy to read: short functions, few arguments, short files, one name for one type, plain words.
//!
//! Prints every fault. A fault that is known and not mended yet is listed in `tests/house_debts.txt`, which may only
//! shrink.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::source::{Source, SourceFile, attributes_of, is_for_tests};
use crate::words::PHRASES;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};

/// Lines of a function, from its signature to its closing brace.
const FUNCTION_LINES_MAX: usize = 80;
/// Arguments of a function, `self` not counted.
const ARGUMENTS_MAX: usize = 6;
/// Lines of a file without its tests.
const FILE_LINES_MAX: usize = 500;

/// Faults of one kind, named by what they concern, so that the list of debts does not change with every line.
type Faults = BTreeSet<String>;

/// Compares faults with the debts of this kind.
fn compare(kind: &str, faults: Faults) {
    let text = fs::read_to_string("tests/house_debts.txt").unwrap_or_default();
    let debts: Faults =
        text.lines().filter_map(|line| line.strip_prefix(kind)?.strip_prefix(": ")).map(str::to_owned).collect();
    let new: Vec<&String> = faults.difference(&debts).collect();
    assert!(new.is_empty(), "{kind}:\n  {new:#?}");
    let paid: Vec<&String> = debts.difference(&faults).collect();
    assert!(paid.is_empty(), "{kind}: mended, so they leave tests/house_debts.txt:\n  {paid:#?}");
}

/// Visits the functions of a file outside of its tests.
struct Functions<'a> {
    file: &'a SourceFile,
    see: &'a mut dyn FnMut(String, &syn::Signature, usize),
}

impl Functions<'_> {
    fn name(&self, signature: &syn::Signature) -> String {
        format!("{} {}", self.file.path.display(), signature.ident)
    }

    fn lines(span: proc_macro2::Span) -> usize {
        span.end().line - span.start().line + 1
    }
}

impl<'ast> Visit<'ast> for Functions<'_> {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if !is_for_tests(attributes_of(item)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_fn(&mut self, function: &'ast syn::ItemFn) {
        let lines = Self::lines(function.sig.span()) + Self::lines(function.block.span()) - 1;
        let name = self.name(&function.sig);
        (self.see)(name, &function.sig, lines);
        visit::visit_item_fn(self, function);
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        let lines = Self::lines(function.sig.span()) + Self::lines(function.block.span()) - 1;
        let name = self.name(&function.sig);
        (self.see)(name, &function.sig, lines);
        visit::visit_impl_item_fn(self, function);
    }
}

fn each_function(source: &Source, mut see: impl FnMut(String, &syn::Signature, usize)) {
    for file in source.files.values() {
        let mut functions = Functions { file, see: &mut see };
        file.items.iter().for_each(|item| functions.visit_item(item));
    }
}

#[test]
fn no_function_is_longer_than_a_screen() {
    let mut faults = Faults::new();
    each_function(&Source::read(), |name, _, lines| {
        if lines > FUNCTION_LINES_MAX {
            faults.insert(name);
        }
    });
    compare("long function", faults);
}

#[test]
fn no_function_has_more_arguments_than_one_can_remember() {
    let mut faults = Faults::new();
    each_function(&Source::read(), |name, signature, _| {
        let is_own = |argument: &&syn::FnArg| matches!(argument, syn::FnArg::Typed(_));
        if signature.inputs.iter().filter(is_own).count() > ARGUMENTS_MAX {
            faults.insert(name);
        }
    });
    compare("many arguments", faults);
}

/// Visits the data-parallel loops of a file that are not within the arguments of `in_parallel`.
struct LooseLoops {
    found: Vec<String>,
}

impl<'ast> Visit<'ast> for LooseLoops {
    fn visit_expr_call(&mut self, call: &'ast syn::ExprCall) {
        let name =
            |path: &syn::ExprPath, at: usize| path.path.segments.iter().nth(at).map(|part| part.ident.to_string());
        if let syn::Expr::Path(path) = &*call.func {
            if path.path.segments.last().is_some_and(|last| last.ident == "in_parallel") {
                return;
            }
            if name(path, 0).is_some_and(|first| first == "rayon") {
                self.found.push(name(path, 1).unwrap_or_default());
            }
        }
        visit::visit_expr_call(self, call);
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        let name = call.method.to_string();
        if name.starts_with("par_") || name.starts_with("into_par_") {
            self.found.push(name);
        }
        visit::visit_expr_method_call(self, call);
    }
}

#[test]
fn data_parallel_loops_run_in_the_pool_of_their_job() {
    let mut faults = Faults::new();
    for (module, file) in &Source::read().files {
        if module.join("::") == "base::pool" {
            continue;
        }
        let mut loops = LooseLoops { found: Vec::new() };
        file.items.iter().for_each(|item| loops.visit_item(item));
        faults.extend(loops.found.into_iter().map(|name| format!("{} {name}", file.path.display())));
    }
    compare("loop outside of in_parallel", faults);
    let loose: syn::File =
        syn::parse_str("fn f() { v.par_iter(); rayon::join(a, b); in_parallel(|| v.par_sort()); }").unwrap();
    let mut loops = LooseLoops { found: Vec::new() };
    loops.visit_file(&loose);
    assert_eq!(loops.found, ["par_iter", "join"]);
}

#[test]
fn no_file_is_longer_than_one_idea() {
    let source = Source::read();
    let lines = |file: &SourceFile| {
        let own = file.text.split("\n#[cfg(test)]").next().unwrap_or_default();
        own.lines().count()
    };
    let long = source.files.values().filter(|file| lines(file) > FILE_LINES_MAX);
    compare("long file", long.map(|file| file.path.display().to_string()).collect());
}

#[test]
fn one_name_stands_for_one_type() {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in Source::read().files.values() {
        for item in &file.items {
            let name = match item {
                syn::Item::Struct(item) => &item.ident,
                syn::Item::Enum(item) => &item.ident,
                syn::Item::Trait(item) => &item.ident,
                syn::Item::Type(item) => &item.ident,
                _ => continue,
            };
            places.entry(name.to_string()).or_default().push(file.path.display().to_string());
        }
    }
    let doubled = places.into_iter().filter(|(_, files)| files.len() > 1);
    compare("one name, several types", doubled.map(|(name, files)| format!("{name} {}", files.join(" "))).collect());
}

/// Further words that the glossary retires in the source.
const RETIRED: [&str; 11] = [
    "made of it",
    "is no more",
    "are no more",
    "picture",
    "census",
    "crumb",
    "crowding",
    "knob",
    "settler",
    " scatter ",
    ".scatter",
];

#[test]
fn retired_words_stay_retired() {
    let mut faults = Faults::new();
    let mut look = |path: &Path| {
        let text = fs::read_to_string(path).unwrap_or_default().to_lowercase();
        let found = PHRASES.iter().chain(&RETIRED).filter(|phrase| text.contains(**phrase));
        faults.extend(found.map(|phrase| format!("{} '{phrase}'", path.display())));
    };
    Source::read().files.values().for_each(|file| look(&file.path));
    compare("retired words", faults);
}
