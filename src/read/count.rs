//! Counts the elements of mesh files without storing them.
//!
//! In: mesh files. Out: [`Counts`], including the triangles that a scan would find. Invariant: writes nothing; the
//! counts equal those of the scan if the scan succeeds.
//!
//! # Memory
//! `threads` × 512 KiB of text; records longer than that take up to [`COUNT_BYTES`] together, or are counted alone.

use std::path::PathBuf;

use super::arrays::ArraySource;
use super::flow::{ORDINARY_BYTES, PermittedCut};
use super::obj::ObjSource;
use super::ply::PlySource;
use super::source::{CHUNK_BYTES, Counts, Cutter, MeshFormat, MeshSource, TEXT_BYTES_KEPT};
use super::texture_sample::{ChunkTexture, TextureSample};
use crate::base::bytes::MIB;
use crate::base::ordered::map_in_order;
use crate::base::recycled::Recycled;
use crate::base::{Error, Permits, Progress, Result};
use crate::file::packed::RecordBounds;

/// Memory of chunks in flight; one that takes more is counted alone.
const COUNT_BYTES: u64 = 32 * MIB;

/// Counts the contents of mesh files in one streaming pass, and takes a sample of their textures if one is given. Given
/// several files, also returns the bounding box of each.
///
/// # Errors
/// [`Error::Input`] if a file has another format or a line that is too long, or if no file has a face; [`Error::Io`] if
/// a file cannot be read; [`Error::Budget`] if the materials of the sample take too much memory.
pub fn count(
    inputs: &[PathBuf],
    threads: usize,
    mut sample: Option<&mut TextureSample>,
    progress: &dyn Progress,
) -> Result<(Counts, Vec<RecordBounds>)> {
    let mut length = 0;
    for path in inputs {
        length += path.metadata().map_err(|e| Error::io(path, "open", e))?.len();
    }
    progress.begin("count", length, "B");
    let (mut counts, mut boxes) = (Counts::default(), Vec::new());
    for (format, range) in MeshFormat::runs(inputs)? {
        let inputs = &inputs[range];
        let (own, of_files) = match format {
            MeshFormat::Obj => count_files::<ObjSource>(inputs, threads, sample.as_deref_mut(), progress)?,
            MeshFormat::Ply => count_files::<PlySource>(inputs, threads, sample.as_deref_mut(), progress)?,
            MeshFormat::Arrays => count_files::<ArraySource>(inputs, threads, sample.as_deref_mut(), progress)?,
        };
        counts.add(&own);
        boxes.extend(of_files);
    }
    if counts.triangles == 0 {
        let path = inputs.first().map_or(std::path::Path::new(""), PathBuf::as_path);
        return Err(Error::input(path, 0, "no faces; expected OBJ text with 'f' statements"));
    }
    if inputs.len() == 1 {
        boxes.clear();
    }
    Ok((counts, boxes))
}

/// Counts the contents of files of one format, and returns the bounding box of each.
fn count_files<S: MeshSource>(
    inputs: &[PathBuf],
    threads: usize,
    mut sample: Option<&mut TextureSample>,
    progress: &dyn Progress,
) -> Result<(Counts, Vec<RecordBounds>)> {
    let is_sampled = sample.is_some();
    let mut current = None;
    let (mut counts, mut boxes) = (Counts::default(), vec![RecordBounds::default(); inputs.len()]);
    let texts = Recycled::<Vec<u8>>::default();
    let permits = Permits::new(COUNT_BYTES.max(2 * threads as u64 * ORDINARY_BYTES));
    map_in_order(
        Cutter::<S>::new(inputs, CHUNK_BYTES).map(|cut| PermittedCut::<S>::new(cut, &permits)),
        threads,
        threads * 2,
        |PermittedCut { file_index: file, cut, permit }| {
            let (mut cut, mut bounds, mut text) = (cut?, RecordBounds::default(), texts.take());
            // The boxes of a single file are not asked for.
            let asked = Some(&mut bounds).filter(|_| inputs.len() > 1);
            let mut texture = is_sampled.then(ChunkTexture::default);
            let own = S::count(&inputs[file], &mut cut.chunk, asked, texture.as_mut(), &mut text)?;
            if text.capacity() <= TEXT_BYTES_KEPT {
                texts.give_back(text);
            }
            Ok((file, cut.bytes, own, bounds, texture, permit))
        },
        |(file, bytes, own, bounds, texture, _permit)| {
            counts.add(&own);
            boxes[file].merge(&bounds);
            progress.advance(bytes);
            let Some((sample, texture)) = sample.as_deref_mut().zip(texture) else { return Ok(()) };
            if current != Some(file) {
                if current.is_some() {
                    S::define_counted(sample)?;
                }
                sample.begin_file(&inputs[file]);
                current = Some(file);
            }
            sample.take(texture)
        },
    )?;
    if let Some(sample) = sample.filter(|_| current.is_some()) {
        S::define_counted(sample)?;
    }
    Ok((counts, boxes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    fn counts_of(text: &str) -> Result<Counts> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        std::fs::write(&path, text).unwrap();
        count(&[path], 2, None, &Silent).map(|(counts, _)| counts)
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
            let options = crate::read::ScanOptions::default();
            let inputs = [path];
            let scan = crate::read::scan(&inputs, folder.path(), &options, &Silent).unwrap();
            let (counts, _) = count(&inputs, 2, None, &Silent).unwrap();
            assert_eq!(counts.triangles, scan.triangles, "{inputs:?}");
            assert_eq!(counts.vertices, scan.mesh.vertex_count(), "{inputs:?}");
            files += 1;
        }
        assert!(files > 5);
    }
}
