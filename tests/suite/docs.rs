//! The pages: their links lead somewhere, their lines fit a screen, their words are plain.

use std::collections::HashMap;
use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::source::Source;
use crate::words::PHRASES;

/// Columns of a line, at most.
const COLUMNS: usize = 100;
/// Pages at the root of the repository.
const ROOT_PAGES: [&str; 3] = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"];
/// The diary keeps the words and the commits of its days.
const DIARY: &str = "docs/notebook";
/// Pages that a program writes, with the tables or lines as wide as its figures.
const GENERATED: [&str; 5] = [
    "docs/reference/options.md",
    "docs/results/papers",
    "docs/results/promises.md",
    "docs/results/far-targets.md",
    "docs/results/peers.md",
];
/// Where the pages of the papers and their pictures are.
const PAPERS: &str = "docs/results/papers";
/// First columns of a table of claims; the verdict is the third.
const CLAIM_HEAD: &str = "| Claim | In the paper | Here |";
/// What a verdict begins with, in the order of the columns of the papers' README.
const VERDICTS: [&str; 4] = ["confirmed", "in part", "refuted", "not testable"];
/// Further phrases that pages avoid: acceptance bars, and places that a reader does not have.
const RETIRED: [&str; 12] = [
    "done again",
    "slide of the picture",
    "picture's slide",
    "as it were",
    "(must",
    "; must ",
    ", must ",
    "(aim",
    "../shared",
    "/work/",
    "/home/",
    "/root/",
];

/// A line of a page.
struct Line {
    text: String,
    /// Whether it stands in a fenced block.
    is_fenced: bool,
    /// Whether that block shows a command and what it printed.
    is_printed: bool,
}

/// A page: its path and its lines.
struct Page {
    path: PathBuf,
    lines: Vec<Line>,
}

impl Page {
    fn read(path: PathBuf) -> Self {
        let text = fs::read_to_string(&path).unwrap();
        let mut lines: Vec<Line> = Vec::new();
        let mut block = None;
        for text in text.lines() {
            let is_fence = text.trim_start().starts_with("```");
            lines.push(Line { text: text.to_owned(), is_fenced: is_fence || block.is_some(), is_printed: false });
            block = match block {
                None => is_fence.then_some(lines.len()),
                Some(begin) if is_fence => {
                    let is_printed = lines[begin..].iter().any(|line| line.text.starts_with("$ "));
                    lines[begin..].iter_mut().for_each(|line| line.is_printed = is_printed);
                    None
                }
                open => open,
            };
        }
        assert!(block.is_none(), "{}: a fenced block has no end", path.display());
        Self { path, lines }
    }

    fn is_below(&self, place: &str) -> bool {
        self.path.starts_with(place)
    }

    /// Lines outside of fenced blocks, with their numbers.
    fn prose(&self) -> impl Iterator<Item = (usize, &str)> {
        let lines = self.lines.iter().enumerate().filter(|(_, line)| !line.is_fenced);
        lines.map(|(at, line)| (at + 1, line.text.as_str()))
    }

    /// Names of its headings, as links use them.
    fn anchors(&self) -> Vec<String> {
        let mut seen: HashMap<String, usize> = HashMap::new();
        let headings = self.prose().filter(|(_, line)| line.starts_with('#'));
        let anchors = headings.map(|(_, line)| {
            let anchor = slug(line.trim_start_matches('#').trim());
            let count = seen.entry(anchor.clone()).or_insert(0);
            *count += 1;
            if *count > 1 { format!("{anchor}-{}", *count - 1) } else { anchor }
        });
        anchors.collect()
    }

    /// Targets of its links, without those in code.
    fn links(&self) -> Vec<(usize, String)> {
        let mut links = Vec::new();
        for (number, line) in self.prose() {
            let text = without_code(line);
            for (at, _) in text.match_indices("](") {
                let rest = &text[at + 2..];
                links.push((number, rest[..rest.find(')').unwrap_or(rest.len())].to_owned()));
            }
        }
        links
    }
}

/// As GitHub names a heading: lower case, blanks as hyphens, no other punctuation; of a link its words alone.
fn slug(heading: &str) -> String {
    let mut words = String::new();
    let mut rest = heading;
    while let Some((before, after)) = rest.split_once("](") {
        words.push_str(before);
        rest = after.split_once(')').map_or("", |(_, behind)| behind);
    }
    words.push_str(rest);
    let words = words.to_lowercase();
    let kept = words.chars().filter_map(|c| match c {
        ' ' => Some('-'),
        '-' | '_' => Some(c),
        _ => c.is_alphanumeric().then_some(c),
    });
    kept.collect()
}

fn without_code(line: &str) -> String {
    line.split('`').enumerate().map(|(at, part)| if at % 2 == 0 { part } else { "" }).collect::<Vec<_>>().join("`")
}

fn pages_below(folder: &Path, pages: &mut Vec<Page>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            pages_below(&path, pages);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            pages.push(Page::read(path));
        }
    }
}

fn pages() -> Vec<Page> {
    let mut pages: Vec<Page> = ROOT_PAGES.iter().map(|path| Page::read(path.into())).collect();
    pages_below(Path::new("docs"), &mut pages);
    pages
}

/// A path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => assert!(plain.pop(), "{}: leaves the repository", path.display()),
            Component::CurDir => {}
            part => plain.push(part),
        }
    }
    plain
}

/// Fails with all faults, one a line.
fn expect_none(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}\n", faults.join("\n"));
}

#[test]
fn every_link_leads_to_a_file_and_a_heading_that_exist() {
    let pages = pages();
    let mut faults = Vec::new();
    for page in &pages {
        let folder = page.path.parent().unwrap();
        for (number, link) in page.links() {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if file.is_empty() { page.path.clone() } else { plain(&folder.join(file)) };
            let is_there = target.exists();
            let has_anchor = anchor.is_empty()
                || pages.iter().any(|page| page.path == target && page.anchors().iter().any(|name| name == anchor));
            if !is_there || !has_anchor {
                faults.push(format!("{}:{number}: {link}", page.path.display()));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn every_page_can_be_reached_from_the_readme() {
    let pages = pages();
    let mut reached = vec![PathBuf::from("README.md")];
    let mut at = 0;
    while at < reached.len() {
        let page = pages.iter().find(|page| page.path == reached[at]);
        let links = page.map(Page::links).unwrap_or_default();
        let folder = reached[at].parent().unwrap().to_owned();
        let files = links.iter().map(|(_, link)| link.split('#').next().unwrap_or_default());
        for file in files.filter(|file| file.ends_with(".md") && !file.contains("://")) {
            let target = plain(&folder.join(file));
            if !reached.contains(&target) {
                reached.push(target);
            }
        }
        at += 1;
    }
    let lost = pages.iter().filter(|page| !reached.contains(&page.path));
    expect_none(&lost.map(|page| page.path.display().to_string()).collect::<Vec<_>>());
}

/// A line as a reader sees it.
fn without_comments(line: &str) -> String {
    let shown = line.split("<!--").map(|part| part.rsplit("-->").next().unwrap_or(part));
    shown.collect()
}

#[test]
fn lines_fit_a_hundred_columns() {
    let mut faults = Vec::new();
    let pages = pages();
    for page in pages.iter().filter(|page| !GENERATED.iter().any(|place| page.is_below(place))) {
        for (at, Line { text, is_printed, .. }) in page.lines.iter().enumerate() {
            let is_excepted = *is_printed || text.starts_with('|') || text.contains("](") || text.contains("://");
            let columns = without_comments(text).chars().count();
            if columns > COLUMNS && !is_excepted {
                faults.push(format!("{}:{}: {columns} columns", page.path.display(), at + 1));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn commits_are_named_in_the_notebook_alone() {
    let is_commit = |word: &str| {
        (7..=40).contains(&word.len())
            && word.chars().all(|c| c.is_ascii_digit() || ('a'..='f').contains(&c))
            && word.contains(|c: char| c.is_ascii_digit())
            && word.contains(|c: char| c.is_ascii_alphabetic())
    };
    let mut faults = Vec::new();
    for page in pages().iter().filter(|page| !page.is_below(DIARY)) {
        for (at, line) in page.lines.iter().enumerate() {
            let words = line.text.split(|c: char| !c.is_alphanumeric());
            faults.extend(words.filter(|word| is_commit(word)).map(|word| {
                let path = page.path.display();
                format!("{path}:{}: {word}", at + 1)
            }));
        }
    }
    expect_none(&faults);
}

#[test]
fn retired_phrases_stand_in_the_notebook_alone() {
    let mut faults = Vec::new();
    for page in pages().iter().filter(|page| !page.is_below(DIARY)) {
        let lines: Vec<&str> = page.prose().map(|(_, line)| line.trim()).collect();
        let text = format!(" {} ", lines.join(" ").to_lowercase());
        for phrase in PHRASES.into_iter().chain(RETIRED) {
            let is_word = |at: usize| {
                let before = text[..at].chars().next_back();
                let after = text[at + phrase.len()..].chars().next();
                let joins = |c: Option<char>| c.is_some_and(char::is_alphanumeric);
                let begins = phrase.starts_with(char::is_alphanumeric);
                let ends = phrase.ends_with(char::is_alphanumeric);
                !(begins && joins(before) || ends && joins(after))
            };
            if text.match_indices(phrase).any(|(at, _)| is_word(at)) {
                faults.push(format!("{}: '{phrase}'", page.path.display()));
            }
        }
    }
    expect_none(&faults);
}

/// Cells of a row of a table.
fn cells(row: &str) -> Vec<&str> {
    row.trim_matches('|').split(" | ").map(str::trim).collect()
}

/// Of each table of claims on a page: how many claims have each verdict.
fn verdicts(page: &Page) -> Vec<[usize; 4]> {
    let mut tables = Vec::new();
    let mut is_claim = false;
    for (number, line) in page.prose() {
        if line.starts_with(CLAIM_HEAD) {
            is_claim = true;
            tables.push([0; 4]);
        } else if !line.starts_with('|') {
            is_claim = false;
        } else if is_claim && !line.starts_with("| ---") {
            let verdict = cells(line)[2];
            let at = VERDICTS.iter().position(|word| verdict.starts_with(word));
            let at = at.unwrap_or_else(|| panic!("{}:{number}: {verdict}", page.path.display()));
            tables.last_mut().unwrap()[at] += 1;
        }
    }
    tables
}

#[test]
fn counts_of_claims_are_those_of_the_papers_pages() {
    let readme = Page::read(Path::new(PAPERS).join("README.md"));
    let mut counted: HashMap<PathBuf, Vec<[usize; 4]>> = HashMap::new();
    for (_, row) in readme.prose().filter(|(_, line)| line.starts_with("| [")) {
        let cells = cells(row);
        let Some((_, rest)) = cells[0].split_once("](") else { continue };
        let page = Path::new(PAPERS).join(rest.split(')').next().unwrap());
        let counts: Vec<usize> = cells[1..].iter().map(|count| count.parse().unwrap()).collect();
        counted.entry(page).or_default().push(counts.try_into().unwrap());
    }
    let mut pages = Vec::new();
    pages_below(Path::new(PAPERS), &mut pages);
    let found: HashMap<PathBuf, Vec<[usize; 4]>> =
        pages.iter().map(|page| (page.path.clone(), verdicts(page))).filter(|(_, tables)| !tables.is_empty()).collect();
    assert_eq!(counted, found);
}

#[test]
fn every_picture_of_the_papers_stands_on_their_pages() {
    let mut pages = Vec::new();
    pages_below(Path::new(PAPERS), &mut pages);
    let shown: Vec<PathBuf> = pages
        .iter()
        .flat_map(|page| page.links().into_iter().map(|(_, link)| plain(&page.path.parent().unwrap().join(link))))
        .collect();
    let files = fs::read_dir(PAPERS).unwrap().map(|entry| entry.unwrap().path());
    let pictures = files.filter(|path| path.extension().is_some_and(|kind| kind == "png" || kind == "svg"));
    let lost = pictures.filter(|path| !shown.contains(path));
    expect_none(&lost.map(|path| path.display().to_string()).collect::<Vec<_>>());
}

/// The kinds of findings in a source file, without its tests.
fn kinds_of_findings(source: &str) -> Vec<&str> {
    let source = source.split("#[cfg(test)]").next().unwrap_or_default();
    let calls = ["indings.note(", "indings.count("].into_iter().flat_map(|call| source.split(call).skip(1));
    calls.filter_map(|rest| rest.trim_start().strip_prefix('"')?.split('"').next()).collect()
}

#[test]
fn every_kind_of_finding_is_explained() {
    let pages: String = ["input", "report", "comparison"]
        .map(|name| fs::read_to_string(format!("docs/reference/{name}.md")).unwrap())
        .concat();
    let mut found = 0;
    let mut faults = Vec::new();
    for file in Source::read().files.values() {
        for kind in kinds_of_findings(&file.text) {
            found += 1;
            if !pages.contains(&format!("`{kind}`")) {
                faults.push(format!("{}: no page of the reference explains `{kind}`", file.path.display()));
            }
        }
    }
    assert!(found > 30, "{found}");
    expect_none(&faults);
}
