//! Counts the statements of OBJ text without parsing them.
//!
//! In: OBJ files. Out: [`Counts`], including the triangles that a scan would find. Invariant: writes nothing; the
//! counts equal those of the scan if the scan succeeds. Faults inside statements are not noticed here.
//!
//! # Memory
//! `threads` × 512 KiB of text, plus the length of a line longer than that.

use std::path::PathBuf;
use std::sync::Mutex;

use super::chunk::{CHUNK_BYTES, Chunk, Cutter, LINE_BYTES_MAX};
use super::line::{logical_line, split_keyword, trim, words};
use super::number::number;
use super::{foreign_format, obj};
use crate::base::threads::start;
use crate::base::{Error, Progress, Result};
use crate::file::packed::RecordBounds;

/// Counts of the statements of an input.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes of OBJ text.
    pub bytes: u64,
    /// `v` statements.
    pub vertices: u64,
    /// `vt` statements.
    pub texcoords: u64,
    /// `vn` statements.
    pub normals: u64,
    /// Faces of three or more corners.
    pub polygons: u64,
    /// Triangles: n - 2 for each polygon of n corners.
    pub triangles: u64,
    /// Whether the first vertex of any chunk has a colour.
    pub has_colours: bool,
    /// Most decimals of a coordinate among the first vertices of chunks; `u32::MAX` if one has an exponent.
    pub decimals: u32,
}

impl Counts {
    fn add(&mut self, other: &Counts) {
        self.bytes += other.bytes;
        self.vertices += other.vertices;
        self.texcoords += other.texcoords;
        self.normals += other.normals;
        self.polygons += other.polygons;
        self.triangles += other.triangles;
        self.has_colours |= other.has_colours;
        self.decimals = self.decimals.max(other.decimals);
    }

    fn see(&mut self, statement: &[u8], bounds: Option<&mut RecordBounds>) {
        let statement = match statement.strip_prefix(obj::BYTE_ORDER_MARK) {
            Some(rest) => trim(rest),
            None => statement,
        };
        let (keyword, rest) = split_keyword(statement);
        match keyword {
            b"v" => {
                if self.vertices == 0 {
                    self.has_colours = words(rest).take_while(|word| word[0] != b'#').count() >= 6;
                    self.decimals = words(rest).take(3).map(decimals).max().unwrap_or(0);
                }
                self.vertices += 1;
                if let Some(bounds) = bounds
                    && let Some(position) = position(rest)
                {
                    bounds.merge(&RecordBounds { low: position, high: position });
                }
            }
            b"vt" => self.texcoords += 1,
            b"vn" => self.normals += 1,
            b"f" | b"fo" => {
                let corners = words(rest).take_while(|word| word[0] != b'#').count() as u64;
                if corners >= 3 {
                    self.polygons += 1;
                    self.triangles += corners - 2;
                }
            }
            _ => {}
        }
    }
}

/// Returns the first three numbers of a `v` statement; `None` if one is missing or not finite.
fn position(text: &[u8]) -> Option<[f64; 3]> {
    let mut numbers = words(text).map(|word| number(word).map(|number| number.value).filter(|x| x.is_finite()));
    Some([numbers.next()??, numbers.next()??, numbers.next()??])
}

/// Number of decimals of a number as written; `u32::MAX` if it has an exponent.
fn decimals(word: &[u8]) -> u32 {
    if word.iter().any(|byte| matches!(byte, b'e' | b'E')) {
        return u32::MAX;
    }
    let point = word.iter().position(|&byte| byte == b'.');
    point.map_or(0, |point| (word.len() - point - 1) as u32)
}

/// Counts the contents of OBJ files in one streaming pass. Given several files, also returns the bounding box of each.
///
/// # Errors
/// [`Error::Input`] if a file has another format or a line that is too long, or if no file has a face; [`Error::Io`] if
/// a file cannot be read.
pub fn count(inputs: &[PathBuf], threads: usize, progress: &dyn Progress) -> Result<(Counts, Vec<RecordBounds>)> {
    let mut length = 0;
    for path in inputs {
        length += path.metadata().map_err(|e| Error::io(path, "open", e))?.len();
    }
    progress.begin("count", length, "B");
    let cutter = Mutex::new(Cutter::new(inputs, CHUNK_BYTES));
    let outcomes: Vec<Result<(Counts, Vec<RecordBounds>)>> = std::thread::scope(|scope| {
        let counting = || work(inputs, &cutter, progress);
        let others: Vec<_> = (1..threads).filter_map(|_| start(scope, counting).ok()).collect();
        let own = counting();
        let others = others.into_iter().map(|worker| worker.join());
        let others = others.map(|outcome| outcome.unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        std::iter::once(own).chain(others).collect()
    });
    let (mut counts, mut boxes) = (Counts::default(), no_boxes(inputs));
    for outcome in outcomes {
        let (own, of_files) = outcome?;
        counts.add(&own);
        boxes.iter_mut().zip(&of_files).for_each(|(all, own)| all.merge(own));
    }
    if counts.triangles == 0 {
        let path = inputs.first().map_or(std::path::Path::new(""), PathBuf::as_path);
        return Err(Error::input(path, 0, "no faces; expected OBJ text with 'f' statements"));
    }
    Ok((counts, boxes))
}

/// Returns an empty box per file, or no boxes for a single file.
fn no_boxes(inputs: &[PathBuf]) -> Vec<RecordBounds> {
    vec![RecordBounds::default(); if inputs.len() > 1 { inputs.len() } else { 0 }]
}

fn work(inputs: &[PathBuf], cutter: &Mutex<Cutter>, progress: &dyn Progress) -> Result<(Counts, Vec<RecordBounds>)> {
    let (mut counts, mut boxes) = (Counts::default(), no_boxes(inputs));
    let mut text = Vec::new();
    loop {
        let next = cutter.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).next();
        let Some((_, chunk)) = next else { return Ok((counts, boxes)) };
        let chunk = chunk?;
        counts.add(&count_chunk(inputs, &chunk, boxes.get_mut(chunk.file_index), &mut text)?);
        progress.advance(chunk.end - chunk.start);
        if text.capacity() > 2 * CHUNK_BYTES as usize {
            text = Vec::new();
        }
    }
}

fn count_chunk(
    inputs: &[PathBuf],
    chunk: &Chunk,
    mut bounds: Option<&mut RecordBounds>,
    text: &mut Vec<u8>,
) -> Result<Counts> {
    let path = &inputs[chunk.file_index];
    chunk.read(path, text)?;
    if let Some(format) = foreign_format(text).filter(|_| chunk.start == 0) {
        return Err(Error::input(path, 1, format!("expected OBJ text, found {format}")));
    }
    if chunk.line_is_too_long {
        let message =
            format!("expected a line end within {} MiB; the file is damaged, or no OBJ", LINE_BYTES_MAX >> 20);
        return Err(Error::input(path, 0, message));
    }
    let mut counts = Counts { bytes: chunk.end - chunk.start, ..Counts::default() };
    let mut at = 0;
    while at < text.len() {
        let line = logical_line(text, at);
        counts.see(trim(&line.text), bounds.as_deref_mut());
        at = line.next;
    }
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    fn counts_of(text: &str) -> Result<Counts> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, text).unwrap();
        count(&[path], 2, &Silent).map(|(counts, _)| counts)
    }

    #[test]
    fn polygons_count_as_fans_and_short_faces_not_at_all() {
        let counts =
            counts_of("\u{feff}v 0 0 0 1 1 1\nvt 0 0\r\nf 1 2 3 4 5 # six\nf 1 2\nfo 1 2 \\\n3\n#f 1 2 3\n").unwrap();
        assert_eq!((counts.vertices, counts.texcoords, counts.polygons, counts.triangles), (1, 1, 2, 4));
        assert!(counts.has_colours);
        assert_eq!(counts_of("v 0.25 1 -.5000\nv 0.123456 1 1\nf 1 2 1\n").unwrap().decimals, 4);
        assert_eq!(counts_of("v 1E-7 0 0\nf 1 1 1\n").unwrap().decimals, u32::MAX);
    }

    #[test]
    fn a_file_without_faces_is_bad_input() {
        assert!(matches!(counts_of("v 0 0 0\n"), Err(Error::Input { .. })));
        assert!(matches!(counts_of("ply\nf 1 2 3\n"), Err(Error::Input { .. })));
    }

    #[test]
    fn the_triangles_are_those_of_the_scan() {
        let mut files = 0;
        for entry in std::fs::read_dir("fixtures/miniatures").unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "obj") {
                continue;
            }
            let folder = tempfile::tempdir().unwrap();
            let options = crate::scan::ScanOptions::default();
            let inputs = [path];
            let scan = crate::scan::scan(&inputs, folder.path(), &options, &Silent).unwrap();
            let (counts, _) = count(&inputs, 2, &Silent).unwrap();
            assert_eq!(counts.triangles, scan.triangles, "{inputs:?}");
            assert_eq!(counts.vertices, scan.mesh.vertex_count(), "{inputs:?}");
            files += 1;
        }
        assert!(files > 5);
    }
}
