//! Reads material libraries: the definitions of the materials that faces use.
//!
//! In: the `mtllib` statements of an OBJ file. Out: a [`MaterialDefinition`] for each used material that a library
//! defines. Statements are kept as written, so that the output repeats the input. `tobj` would parse them into numbers,
//! drop unknown ones and leave options in texture names, so the lines are read here.
//!
//! # Memory
//! One library at a time, at most [`LIBRARY_BYTES_MAX`], and the definitions of the used materials.

use std::borrow::Cow;
use std::collections::HashSet;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use memchr::{memchr, memmem};

use super::statements::BYTE_ORDER_MARK;
use crate::base::error::{escape, escape_path};
use crate::base::id::TiSlice;
use crate::base::{Allowance, Error, Findings, Result};
use crate::model::Material;
use crate::model::catalogue::{MaterialDefinition, TextureStatement, statement_bytes};
use crate::model::id::MaterialId;
use crate::model::texture_file::relative_path;
use crate::os::durable::folder_of;
use crate::os::path::path_of_name;
use crate::os::system::is_file;
use crate::read::file::open_regular;
use crate::read::line::{LogicalLine, is_blank, logical_line, split_keyword, trim, words};
use crate::read::number::number;
use crate::read::parts::FileMaterials;

/// Larger libraries are ignored, in bytes.
pub const LIBRARY_BYTES_MAX: u64 = 64 << 20;
/// Longest possible path, in bytes.
const NAME_BYTES_MAX: usize = 4096;
/// Further names in one statement are ignored.
const NAMES_MAX: usize = 10_000;
/// Bytes that the paths of a library take in addition to its name.
const LIBRARY_BYTES: u64 = 500;
/// Further statements of one material are ignored; the format has fewer than half as many.
const STATEMENTS_MAX: usize = 256;

/// Keywords of statements that name a texture, besides all that begin with `map_`; in lower case.
const TEXTURE_KEYS: &[&str] = &["bump", "norm", "disp", "decal", "refl"];
/// Begins with `map_` but is a switch: `map_aat on`.
const TEXTURE_SWITCH: &[u8] = b"map_aat";

/// Options of texture statements: name, largest number of values, whether the values are numbers.
const TEXTURE_OPTIONS: &[(&str, usize, bool)] = &[
    ("-blendu", 1, false),
    ("-blendv", 1, false),
    ("-cc", 1, false),
    ("-clamp", 1, false),
    ("-imfchan", 1, false),
    ("-type", 1, false),
    ("-colorspace", 1, false),
    ("-texres", 1, true),
    ("-boost", 1, true),
    ("-bm", 1, true),
    ("-mm", 2, true),
    ("-o", 3, true),
    ("-s", 3, true),
    ("-t", 3, true),
];

/// Defines the materials of an OBJ file from its libraries. `libraries` are the lines and texts of its `mtllib`
/// statements, `materials` those of the whole catalogue. Returns the files that the statements name or may be meant to
/// name, whether they exist or not.
///
/// # Errors
/// [`Error::Io`] if a library exists but cannot be read, [`Error::Budget`] if its definitions take too much memory.
pub fn define_materials(
    obj: &Path,
    libraries: &[(u64, Vec<u8>)],
    materials: &mut TiSlice<MaterialId, Material>,
    used: &FileMaterials,
    allowance: &mut Allowance,
    findings: &mut Findings,
) -> Result<Vec<PathBuf>> {
    let (mut named, mut read) = (Vec::new(), HashSet::new());
    let mut known = HashSet::new();
    for (line, text) in libraries {
        let plain = without_comment(obj, text)?;
        let found = find_libraries(obj, plain)?;
        // A file named like the whole text would take precedence, if it existed.
        let whole = [&text[..], plain].into_iter().filter(|text| !text.is_empty() && text.len() <= NAME_BYTES_MAX);
        for name in whole.chain(found.iter().map(|(name, _)| &name[..])) {
            let relative = path_of_name(name);
            let path = obj.with_file_name(&relative);
            if !relative.has_root() && !known.contains(&path) {
                allowance.take(LIBRARY_BYTES + 4 * path.as_os_str().len() as u64, obj)?;
                known.insert(path.clone());
                named.push(path);
            }
        }
        for (name, is_there) in found {
            let path = obj.with_file_name(path_of_name(&name));
            if is_there {
                // The same file may already have been read by another name.
                if read.insert(fs::canonicalize(&path).unwrap_or_else(|_| path.clone())) {
                    read_library(&path, materials, used, allowance, findings)?;
                }
            } else {
                findings.note("missing_mtl", || {
                    format!("{}:{line}: material library '{}' is not there", escape_path(obj), escape(&name))
                });
            }
        }
    }
    for material in &materials[used.first()..] {
        if material.definition.is_none() {
            findings.note("undefined_material", || {
                format!("{}: material '{}' is used and not defined", escape_path(obj), escape(&material.name))
            });
        }
    }
    Ok(named)
}

/// Returns the names in an `mtllib` statement, and whether each exists. The whole text is the name if there is such a
/// file; otherwise each word is one, and a blank after a backslash belongs to the word.
///
/// # Errors
/// [`Error::Io`] on an I/O error that leaves unknown whether a file exists.
fn find_libraries<'a>(obj: &Path, text: &'a [u8]) -> Result<Vec<(Cow<'a, [u8]>, bool)>> {
    let find = |name: &[u8]| is_there(obj, name);
    if find(text)? {
        return Ok(vec![(Cow::Borrowed(text), true)]);
    }
    let names: Vec<Cow<'_, [u8]>> = if memmem::find(text, b"\\ ").is_some() {
        split_escaped(text).into_iter().take(NAMES_MAX).map(Cow::Owned).collect()
    } else {
        words(text).take(NAMES_MAX).map(Cow::Borrowed).collect()
    };
    names.into_iter().map(|name| find(&name).map(|there| (name, there))).collect()
}

/// Returns the text of an `mtllib` statement up to a comment. A comment is a word that begins with `#`, unless a file
/// is named like the whole text or like this word.
///
/// # Errors
/// Those of [`find_libraries`].
fn without_comment<'a>(obj: &Path, text: &'a [u8]) -> Result<&'a [u8]> {
    let is_start = |&at: &usize| text[at] == b'#' && (at == 0 || is_blank(text[at - 1]));
    let Some(start) = (0..text.len()).find(is_start) else { return Ok(text) };
    let word = words(&text[start..]).next().unwrap_or_default();
    if is_there(obj, text)? || is_there(obj, word)? { Ok(text) } else { Ok(trim(&text[..start])) }
}

/// Reports whether a library of this name exists in the folder of an OBJ.
///
/// # Errors
/// [`Error::Io`] on an I/O error that leaves this unknown.
fn is_there(obj: &Path, name: &[u8]) -> Result<bool> {
    let Some(relative) = relative_path(name) else { return Ok(false) };
    let path = obj.parent().unwrap_or(Path::new("")).join(&relative);
    is_file(&path).map_err(|error| Error::io(&path, "open", error))
}

fn split_escaped(text: &[u8]) -> Vec<Vec<u8>> {
    let (mut names, mut name) = (Vec::new(), Vec::new());
    let mut bytes = text.iter().copied().peekable();
    while let Some(byte) = bytes.next() {
        if byte == b'\\' && bytes.peek() == Some(&b' ') {
            bytes.next();
            name.push(b' ');
        } else if !is_blank(byte) {
            name.push(byte);
        } else if !name.is_empty() {
            names.push(std::mem::take(&mut name));
        }
    }
    if !name.is_empty() {
        names.push(name);
    }
    names
}

fn read_library(
    path: &Path,
    materials: &mut TiSlice<MaterialId, Material>,
    used: &FileMaterials,
    allowance: &mut Allowance,
    findings: &mut Findings,
) -> Result<()> {
    let (file, length) = open_regular(path)?;
    let mut text = Vec::new();
    if length <= LIBRARY_BYTES_MAX {
        allowance.take(length, path)?;
        file.take(length).read_to_end(&mut text).map_err(|e| Error::io(path, "read", e))?;
    } else {
        findings.note("oversized_mtl", || {
            format!("{}: ignored, since it has {length} bytes; at most {LIBRARY_BYTES_MAX}", escape_path(path))
        });
    }
    parse_library(path, &text, materials, used, allowance, findings)?;
    allowance.give_back(text.len() as u64);
    Ok(())
}

enum Current {
    BeforeFirst,
    Unused,
    Defining(MaterialId, MaterialDefinition),
}

fn parse_library(
    path: &Path,
    text: &[u8],
    materials: &mut TiSlice<MaterialId, Material>,
    used: &FileMaterials,
    allowance: &mut Allowance,
    findings: &mut Findings,
) -> Result<()> {
    let folder = folder_of(path);
    // A job may be resumed from another working directory.
    let folder = &fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
    let (mut at, mut line) = (0, 0);
    let mut current = Current::BeforeFirst;
    let mut named = HashSet::new();
    while at < text.len() {
        let LogicalLine { text: whole, next, line_count } = logical_line(text, at);
        let first_line = line + 1;
        at = next;
        line += line_count;
        let statement = trim(&whole);
        if statement.is_empty() || statement[0] == b'#' {
            continue;
        }
        let place = || format!("{}:{first_line}", escape_path(path));
        if memchr(0, statement).is_some() {
            findings.note("damaged_mtl", || format!("{}: a line with NUL bytes is ignored", place()));
            continue;
        }
        let (key, rest) = split_keyword(statement);
        if key.eq_ignore_ascii_case(b"newmtl") {
            keep(current, materials);
            current = match used.find(rest) {
                None => Current::Unused,
                Some(material) if materials[material].definition.is_some() => {
                    findings.note("repeated_material_definition", || {
                        format!("{}: material '{}' is defined twice; the first one counts", place(), escape(rest))
                    });
                    Current::Unused
                }
                Some(material) => {
                    Current::Defining(material, MaterialDefinition { folder: folder.to_owned(), ..Default::default() })
                }
            };
            continue;
        }
        match &mut current {
            Current::BeforeFirst => findings.note("mtl_statement_before_newmtl", || {
                // NOTE: the OBJ chose this file, which may not be an MTL at all; do not echo its contents.
                format!("{}: a statement before the first newmtl is ignored", place())
            }),
            Current::Unused => {}
            Current::Defining(_, definition)
                if definition.statements.len() + definition.textures.len() >= STATEMENTS_MAX =>
            {
                findings.note("too_many_statements", || {
                    format!("{}: more than {STATEMENTS_MAX} statements of one material; the rest is ignored", place())
                });
            }
            Current::Defining(_, definition) if is_texture_key(key) => match split_texture(statement) {
                Some(texture) => {
                    // Count a file name once, even if several statements or materials name it.
                    let is_new = named.insert(texture.name.clone());
                    allowance.take(if is_new { texture.bytes() } else { texture.own_bytes() }, path)?;
                    definition.textures.push(texture);
                }
                None => findings.note("texture_without_name", || {
                    format!("{}: a statement of a texture names no file and is ignored", place())
                }),
            },
            Current::Defining(_, definition) => {
                allowance.take(statement_bytes(statement), path)?;
                definition.statements.push(statement.to_vec());
            }
        }
    }
    keep(current, materials);
    Ok(())
}

fn keep(current: Current, materials: &mut TiSlice<MaterialId, Material>) {
    if let Current::Defining(material, definition) = current {
        materials[material].definition = Some(definition);
    }
}

fn is_texture_key(key: &[u8]) -> bool {
    let is_map = key.get(..4).is_some_and(|start| start.eq_ignore_ascii_case(b"map_"));
    is_map && !key.eq_ignore_ascii_case(TEXTURE_SWITCH)
        || TEXTURE_KEYS.iter().any(|texture| key.eq_ignore_ascii_case(texture.as_bytes()))
}

/// Splits a trimmed texture statement into key with options, and file name; `None` if the name is missing.
///
/// `-o`, `-s` and `-t` take one to three numbers, and a file may be named `12`, so the last word is never a value.
fn split_texture(statement: &[u8]) -> Option<TextureStatement> {
    let start_of = |word: &[u8]| word.as_ptr() as usize - statement.as_ptr() as usize;
    let words: Vec<&[u8]> = words(statement).collect();
    let mut next = 1;
    while let Some((_, values, are_numbers)) = words
        .get(next)
        .and_then(|word| TEXTURE_OPTIONS.iter().find(|(option, _, _)| word.eq_ignore_ascii_case(option.as_bytes())))
    {
        next += 1;
        for _ in 0..*values {
            let is_value = next + 1 < words.len() && (!are_numbers || number(words[next]).is_some());
            next += usize::from(is_value);
            if !is_value {
                break;
            }
        }
    }
    let name_start = start_of(words.get(next)?);
    Some(TextureStatement {
        key_and_options: trim(&statement[..name_start]).to_vec(),
        name: statement[name_start..].to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(statement: &str) -> Option<(String, String)> {
        let texture = split_texture(statement.as_bytes())?;
        Some((String::from_utf8(texture.key_and_options).unwrap(), String::from_utf8(texture.name).unwrap()))
    }

    #[test]
    fn options_are_not_part_of_a_texture_name() {
        for (key, name) in [
            ("map_Kd -s 1 1 1 -o 0 0 0 -mm 0 1", "a.png"),
            ("map_Kd -clamp on -blendu off", "b file.png"),
            ("map_Bump -BM 0.5", "c_n.png"),
            ("map_Kd -s 2", "c.png"),
            ("bump -imfchan r -bm 1.5", "d.png"),
            ("map_Kd -texres 1024 -type sphere", "d k.png"),
            ("map_Kd -s 1 1 1", "1001.png"),
            ("map_Kd -o 1 2", "12"),
            ("map_Kd -s 1 1 1", "1 2.png"),
            ("map_Ks", "12"),
            ("refl -type", "sphere"),
            ("map_Kd", "-dash.png"),
            ("map_Kd", "textures\\red.png"),
        ] {
            assert_eq!(split(&format!("{key} \t{name}")), Some((key.into(), name.into())));
        }
        assert_eq!(split("map_Kd"), None);
        assert_eq!(split("map_Kd -clamp"), None);
    }

    #[test]
    fn every_map_names_a_texture_but_the_switch() {
        for key in ["map_Kd", "MAP_KD", "map_AO", "map_emissive", "map_", "norm", "Bump"] {
            assert!(is_texture_key(key.as_bytes()), "{key}");
        }
        for key in ["map_aat", "Kd", "map", "mapping", "illum", ""] {
            assert!(!is_texture_key(key.as_bytes()), "{key}");
        }
    }

    #[test]
    fn escaped_blanks_belong_to_a_library_name() {
        assert_eq!(split_escaped(b"my\\ mat.mtl b.mtl"), [&b"my mat.mtl"[..], b"b.mtl"]);
    }

    #[test]
    fn a_library_name_with_blanks_is_tried_whole_first() {
        let folder = tempfile::tempdir().unwrap();
        let obj = folder.path().join("a.obj");
        for name in ["a b.mtl", "b.mtl"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let found = |text: &str| -> Vec<bool> {
            find_libraries(&obj, text.as_bytes()).unwrap().into_iter().map(|(_, is_there)| is_there).collect()
        };
        assert_eq!(found("a b.mtl"), [true]);
        assert_eq!(found("b.mtl gone.mtl"), [true, false]);
        assert_eq!(found(".\\b.mtl"), [true]);
        assert_eq!(found("C:\\b.mtl"), [false]);
        assert_eq!(found("."), [false]);
        assert_eq!(found(obj.with_file_name("b.mtl").to_str().unwrap()), [false], "absolute");
    }
}
