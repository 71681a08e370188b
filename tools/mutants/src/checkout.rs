//! The copy of the checkout under `target/mutants`, with all switches built in, compiled once.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{fs, io};

use serde_json::Value;

use crate::find::{self, Mutant};
use crate::switch::{Switched, Switches};

/// The copy, and where it is compiled.
pub struct Checkout {
    pub folder: PathBuf,
    target: PathBuf,
    sources: BTreeMap<PathBuf, (String, Switches)>,
    /// Hash of all other files.
    others: u64,
    pub mutants: Vec<Mutant>,
    /// Numbers of the mutants that do not compile.
    pub left_out: BTreeSet<usize>,
}

impl Checkout {
    /// Brings the copy of `project` up to date and finds all mutants of `paths`; writes what differs, so that little is
    /// compiled again.
    pub fn new(project: &Path, under: &Path, paths: &[PathBuf]) -> io::Result<Self> {
        let folder = under.join("checkout");
        let target = under.join("build");
        let listed = Command::new("git").args(["ls-files", "-z"]).current_dir(project).output()?.stdout;
        let listed = String::from_utf8_lossy(&listed).into_owned();
        let names = || listed.split('\0').filter(|name| project.join(name).is_file()).map(Path::new);
        remove_others(&folder, &folder, &names().collect())?;
        let (mut sources, mut tests) = (BTreeMap::new(), BTreeSet::new());
        let mut others = DefaultHasher::new();
        for name in names() {
            if name.starts_with("src") && name.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(project.join(name))?;
                for module in find::test_modules(&text).map_err(io::Error::other)? {
                    let parent = if matches!(name.file_stem(), Some(stem) if stem == "mod" || stem == "lib") {
                        name.parent().unwrap_or(name).to_owned()
                    } else {
                        name.with_extension("")
                    };
                    tests.insert(parent.join(&module).with_extension("rs"));
                    tests.insert(parent.join(&module).join("mod.rs"));
                }
                sources.insert(name.to_owned(), (text, Switches::new()));
            } else {
                let content = fs::read(project.join(name))?;
                (name, &content).hash(&mut others);
                write_if_other(&folder.join(name), &content)?;
            }
        }
        let mut mutants = Vec::new();
        for (name, (text, switches)) in &mut sources {
            // The main file of the program is a crate of its own, without the module that switches.
            let is_chosen = paths.iter().any(|path| name.starts_with(path)) && name != Path::new("src/main.rs");
            if is_chosen && !tests.contains(name) {
                *switches = find::find(name, text, &mut mutants).map_err(io::Error::other)?;
            }
        }
        Ok(Self { folder, target, sources, others: others.finish(), mutants, left_out: BTreeSet::new() })
    }

    /// A number that is another one where a file that decides about mutants or tests differs.
    pub fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.others.hash(&mut hasher);
        self.mutants.len().hash(&mut hasher);
        self.sources.iter().for_each(|(name, (text, _))| (name, text).hash(&mut hasher));
        hasher.finish()
    }

    /// Names a mutant and the text of its file: what was found out of it holds for no other text.
    pub fn key(&self, number: usize) -> String {
        let mutant = &self.mutants[number - 1];
        let mut hasher = DefaultHasher::new();
        self.sources.get(&mutant.file).map(|(text, _)| text).hash(&mut hasher);
        format!("{:016x}\t{mutant}", hasher.finish())
    }

    /// Writes the sources with their switches.
    pub fn write(&self) -> io::Result<()> {
        for (name, (source, switches)) in &self.sources {
            let mut text = Switched::new(source, switches, &self.left_out).text;
            if name == Path::new("src/lib.rs") {
                let allowed = "warnings, arithmetic_overflow, overflowing_literals, unconditional_panic";
                text = format!("#![allow({allowed})]\n{text}\n/// Which change is on.\npub mod mutant;\n");
            }
            write_if_other(&self.folder.join(name), text.as_bytes())?;
        }
        let text =
            include_str!("mutant.rs.txt").to_owned() + &format!("\nconst COUNT: usize = {};\n", self.mutants.len());
        write_if_other(&self.folder.join("src/mutant.rs"), text.as_bytes())
    }

    /// Leaves out what does not compile, until the rest does.
    pub fn leave_out_what_does_not_compile(&mut self) -> io::Result<()> {
        loop {
            self.write()?;
            let errors =
                self.cargo(&["check", "--lib"])?.into_iter().filter(|message| message["message"]["level"] == "error");
            let errors: Vec<_> = errors.map(|message| message["message"].clone()).collect();
            if errors.is_empty() {
                return Ok(());
            }
            let before = self.left_out.len();
            let (mut switched, mut blamed) = (BTreeMap::new(), self.left_out.clone());
            for error in &errors {
                let (mut around, mut inside, mut between) = (Vec::new(), Vec::new(), Vec::new());
                let spans = spans(error);
                for (file, range) in spans.clone() {
                    let others = || spans.iter().filter(|(of, _)| *of == file).map(|(_, range)| range);
                    let all = others().map(|r| r.start).fold(usize::MAX, usize::min)
                        ..others().map(|r| r.end).fold(0, usize::max);
                    let Some((source, switches)) = self.sources.get(&file) else { continue };
                    let text = switched.entry(file).or_insert_with(|| Switched::new(source, switches, &self.left_out));
                    around.push(text.mutants_at(range.start));
                    inside.push(text.mutants_in(range));
                    between.push(text.mutants_in(all));
                }
                let fewest = |found: Vec<Vec<usize>>| found.into_iter().filter(|f| !f.is_empty()).min_by_key(Vec::len);
                let is_new = |found: &Vec<usize>| found.iter().any(|mutant| !blamed.contains(mutant));
                // An `else` that must not be left is blamed as a whole, and a borrow on all up to its end.
                let found = fewest(around).filter(is_new);
                let found = found.or_else(|| fewest(inside)).or_else(|| fewest(between)).unwrap_or_default();
                blamed.extend(found);
            }
            drop(switched);
            self.left_out = blamed;
            eprintln!("{} errors: {} mutants do not compile", errors.len(), self.left_out.len());
            if self.left_out.len() == before {
                return Err(io::Error::other(format!("what does not compile is no mutant: {}", errors[0]["rendered"])));
            }
        }
    }

    /// Compiles the tests; returns their programs.
    pub fn build_tests(&self, with_unit_tests_only: bool) -> io::Result<Vec<PathBuf>> {
        let messages =
            self.cargo(if with_unit_tests_only { &["test", "--no-run", "--lib"] } else { &["test", "--no-run"] })?;
        if let Some(error) = messages.iter().find(|message| message["message"]["level"] == "error") {
            return Err(io::Error::other(format!("the tests do not compile: {}", error["message"]["rendered"])));
        }
        let tests = messages.iter().filter(|message| message["profile"]["test"] == true);
        Ok(tests.filter_map(|message| message["executable"].as_str().map(PathBuf::from)).collect())
    }

    fn cargo(&self, arguments: &[&str]) -> io::Result<Vec<Value>> {
        let mut command = Command::new("cargo");
        command.args(arguments).args(["--quiet", "--message-format=json"]).current_dir(&self.folder);
        let output = command.env("CARGO_TARGET_DIR", &self.target).stderr(std::process::Stdio::inherit()).output()?;
        Ok(String::from_utf8_lossy(&output.stdout).lines().filter_map(|line| serde_json::from_str(line).ok()).collect())
    }
}

/// Places that a message of the compiler names, as files and ranges of bytes.
fn spans(message: &Value) -> Vec<(PathBuf, Range<usize>)> {
    let messages = std::iter::once(message).chain(message["children"].as_array().into_iter().flatten());
    let spans = messages.flat_map(|message| message["spans"].as_array().into_iter().flatten());
    let offset = |span: &Value, name: &str| Some(span[name].as_u64()? as usize);
    let place = |span: &Value| {
        Some((PathBuf::from(span["file_name"].as_str()?), offset(span, "byte_start")?..offset(span, "byte_end")?))
    };
    let mut found: Vec<_> = spans.filter_map(place).collect();
    // Line 1 of lib.rs is ours.
    found.retain(|(file, _)| file != Path::new("src/lib.rs"));
    found
}

fn write_if_other(path: &Path, content: &[u8]) -> io::Result<()> {
    if fs::read(path).is_ok_and(|there| there == content) {
        return Ok(());
    }
    fs::create_dir_all(path.parent().unwrap_or(path))?;
    fs::write(path, content)
}

/// Removes files of an older copy that the project no longer has.
fn remove_others(root: &Path, folder: &Path, names: &BTreeSet<&Path>) -> io::Result<()> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(()) };
    for path in entries.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()? {
        if path.is_dir() && !path.is_symlink() {
            remove_others(root, &path, names)?;
        } else if path.strip_prefix(root).is_ok_and(|name| !names.contains(name) && name != Path::new("src/mutant.rs"))
        {
            fs::remove_file(path)?;
        }
    }
    Ok(())
}
