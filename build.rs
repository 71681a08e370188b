//! Tells the program its commit, its date and its target, for `--version`. Works without git and outside a repository.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let target = std::env::var("TARGET").unwrap_or_default();
    let is_release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let of_git = is_release.then(commit).flatten();
    // A packaged crate does not know the date: it is no part of what tells builds apart.
    let date = of_git.as_ref().and_then(|_| git(&["show", "--no-patch", "--format=%cs", "HEAD"]));
    let (build, dated) = match of_git.or_else(|| is_release.then(packaged_commit).flatten()) {
        Some(commit) => {
            let words = date.map_or_else(|| commit.clone(), |date| format!("{commit}, {date}"));
            (format!("commit {commit}, {target}"), format!("commit {words}, {target}"))
        }
        None => (target.clone(), target),
    };
    println!("cargo:rustc-env=DRYSTONE_BUILD={build}");
    println!("cargo:rustc-env=DRYSTONE_DATED_BUILD={dated}");
}

/// The commit of the repository whose top is this package; `None` in a packaged crate, or inside another repository.
fn commit() -> Option<String> {
    let package = std::env::var("CARGO_MANIFEST_DIR").ok()?;
    let top = git(&["rev-parse", "--show-toplevel"])?;
    if Path::new(&top).canonicalize().ok()? != Path::new(&package).canonicalize().ok()? {
        return None;
    }
    for file in ["HEAD", "packed-refs", &git(&["symbolic-ref", "-q", "HEAD"]).unwrap_or_default()] {
        let path = git(&["rev-parse", "--git-path", file]).filter(|path| !file.is_empty() && Path::new(path).exists());
        path.iter().for_each(|path| println!("cargo:rerun-if-changed={path}"));
    }
    println!("cargo:rerun-if-changed=src");
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let is_changed = git(&["status", "--porcelain", "--untracked-files=no", "--", "src", "Cargo.toml", "Cargo.lock"])?;
    Some(if is_changed.is_empty() { commit } else { commit + " with changes" })
}

/// The commit that `cargo package` noted in the crate; `None` in a checkout.
fn packaged_commit() -> Option<String> {
    let note = std::fs::read_to_string(".cargo_vcs_info.json").ok()?;
    let commit = note.split_once("\"sha1\": \"")?.1.get(..12)?;
    Some(if note.contains("\"dirty\": true") { format!("{commit} with changes") } else { commit.to_owned() })
}

/// What git prints, without the line feed; `None` if there is no git or it fails.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim_end().to_owned())
}
