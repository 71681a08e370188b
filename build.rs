//! Tells the program its commit, its date, its target and a checksum of its sources: for `--version`, and for jobs that
//! several processes work on. Works without git and outside a repository.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What decides about the program's bytes, but for the target: cargo runs this script again if any of it changes.
const SOURCES: [&str; 3] = ["src", "Cargo.lock", "build.rs"];

fn main() {
    let package = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    for source in SOURCES.into_iter().filter(|source| package.join(source).exists()) {
        println!("cargo:rerun-if-changed={source}");
    }
    let target = std::env::var("TARGET").unwrap_or_default();
    let is_release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let of_git = is_release.then(|| commit(&package)).flatten();
    // A packaged crate does not know the date: it is no part of what tells builds apart.
    let date = of_git.as_ref().and_then(|_| git(&["show", "--no-patch", "--format=%cs", "HEAD"]));
    let commit = of_git.or_else(|| is_release.then(packaged_commit).flatten());
    let sources = format!("{target}, sources {:016x}", checksum(&package, &compiler()));
    let words = |date: &str| commit.as_ref().map_or_else(String::new, |commit| format!("commit {commit}, {date}"));
    println!("cargo:rustc-env=DRYSTONE_BUILD={}{sources}", words(""));
    let dated = date.map_or_else(String::new, |date| format!("{date}, "));
    println!("cargo:rustc-env=DRYSTONE_DATED_BUILD={}{sources}", words(&dated));
}

/// Checksum of all sources in the folder of a package, by relative path, and of the compiler: FNV-1a of 64 bits. A commit
/// does not tell two checkouts with changes from each other, and not every build knows its commit.
pub fn checksum(package: &Path, compiler: &str) -> u64 {
    let mut parts = vec![("rustc".to_owned(), compiler.as_bytes().to_owned())];
    SOURCES.into_iter().for_each(|source| read_all(&package.join(source), source, &mut parts));
    parts.sort();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for (name, content) in &parts {
        let lengths = [name.len(), content.len()].map(|length| (length as u64).to_le_bytes()).concat();
        for byte in [&lengths, name.as_bytes(), content].concat() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
    hash
}

/// Adds a file, or all files of a folder, by names that do not depend on where the package lies.
fn read_all(path: &Path, name: &str, parts: &mut Vec<(String, Vec<u8>)>) {
    if let Ok(content) = fs::read(path) {
        parts.push((name.to_owned(), content));
    }
    for entry in fs::read_dir(path).into_iter().flatten().flatten() {
        read_all(&entry.path(), &format!("{name}/{}", entry.file_name().to_string_lossy()), parts);
    }
}

/// What the compiler says that it is: `rustc 1.95.0 (…)`.
fn compiler() -> String {
    let output = Command::new(std::env::var_os("RUSTC").unwrap_or("rustc".into())).arg("-V").output();
    output.map(|output| String::from_utf8_lossy(&output.stdout).trim_end().to_owned()).unwrap_or_default()
}

/// The commit of the repository whose top is this package; `None` in a packaged crate, or inside another repository.
fn commit(package: &Path) -> Option<String> {
    let top = git(&["rev-parse", "--show-toplevel"])?;
    if Path::new(&top).canonicalize().ok()? != package.canonicalize().ok()? {
        return None;
    }
    for file in ["HEAD", "packed-refs", &git(&["symbolic-ref", "-q", "HEAD"]).unwrap_or_default()] {
        let path = git(&["rev-parse", "--git-path", file]).filter(|path| !file.is_empty() && Path::new(path).exists());
        path.iter().for_each(|path| println!("cargo:rerun-if-changed={path}"));
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let is_changed = git(&["status", "--porcelain", "--untracked-files=no", "--", "src", "Cargo.toml", "Cargo.lock"])?;
    Some(if is_changed.is_empty() { commit } else { commit + " with changes" })
}

/// The commit that `cargo package` noted in the crate; `None` in a checkout.
fn packaged_commit() -> Option<String> {
    let note = fs::read_to_string(".cargo_vcs_info.json").ok()?;
    let commit = note.split_once("\"sha1\": \"")?.1.get(..12)?;
    Some(if note.contains("\"dirty\": true") { format!("{commit} with changes") } else { commit.to_owned() })
}

/// What git prints, without the line feed; `None` if there is no git or it fails.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim_end().to_owned())
}
