//! Colour differences between points of images.
//!
//! In: pairs of points. Out: a distribution for each set of pairs. Invariant: an image is decoded once for as many
//! pairs, of all sets together, as the budget holds. Pairs are summed in their order, so only images that do not fit
//! the budget make the result depend on it.
//!
//! # Memory
//! 120 bytes for each pair in work, at most a quarter of the budget; the images in work.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use super::distribution::Distribution;
use super::filter::FilteredColour;
use super::options::Resources;
use super::texture_pair::{OriginalSide, TexturePair};
use crate::base::error::escape_path;
use crate::base::id::{TiSlice, TiVec};
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Permits, Progress, Result};
use crate::file::Column;
use crate::image::decode;
use crate::image::textures::TextureImages;
use crate::model::id::ImageId;
use crate::os::content::Content;

/// Largest colour difference.
const COLOUR_MAX: f64 = 255.0;
/// Memory of a pair in work, in bytes.
const PAIR_BYTES: u64 = 120;
/// Minimum and maximum number of pairs in work; their indices have 32 bits.
const ROUND_PAIRS: Range<u64> = 1 << 10..1 << 30;

/// The texture images of a mesh, and their contents.
pub type KnownImages<'a> = (&'a TextureImages, &'a TiSlice<ImageId, Option<Content>>);

/// Pairs of points, and the texture images that they show.
#[derive(Debug, Clone, Copy)]
pub struct Pairs<'a> {
    /// The pairs.
    pub column: &'a Column<TexturePair>,
    /// Texture images of the point's mesh, and their contents.
    pub own: KnownImages<'a>,
    /// Texture images of the other point's mesh, and their contents.
    pub other: KnownImages<'a>,
    /// Colours that are known already, not numbers where there is none: those of one side of each pair.
    pub known: Option<(&'a Column<FilteredColour>, OriginalSide)>,
}

/// Colour differences, and the number of images read for them.
#[derive(Debug)]
pub struct Contrasts {
    /// Distribution of the difference, mean over the channels, for each set of pairs.
    pub differences: Vec<Distribution>,
    /// Number of images read.
    pub images: u64,
    /// Number of images read at a lower resolution.
    pub reduced: u64,
}

/// A query for a colour.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
struct ColourQuery {
    image: u32,
    /// Index of the answer.
    place: u32,
    texcoord: [f32; 2],
}

/// Compares the colours of pairs, set by set.
///
/// # Errors
/// On failed reads; images that cannot be decoded are noted.
pub fn compare_colours(
    sets: &[Pairs],
    resources: &Resources,
    findings: &mut Findings,
    progress: &dyn Progress,
) -> Result<Contrasts> {
    let images = Images::of(sets);
    let allowed = resources.work_bytes / 4 * 3;
    let permits = Permits::new(allowed);
    let most = (resources.work_bytes / 4 / PAIR_BYTES).clamp(ROUND_PAIRS.start, ROUND_PAIRS.end);
    let mut found = Contrasts { differences: vec![Distribution::new(COLOUR_MAX); sets.len()], images: 0, reduced: 0 };
    let mut is_known = vec![false; images.paths.len()];
    for round in rounds(sets, most) {
        let pairs: u64 = round.iter().map(|(_, range)| range.end - range.start).sum();
        let mut colours = vec![[f32::NAN; 3]; 2 * pairs as usize];
        let questions = questions(&round, sets, &images, &mut colours)?;
        let groups: Vec<&[ColourQuery]> = questions.chunk_by(|a, b| a.image == b.image).collect();
        progress.begin("colours", groups.len() as u64, "images");
        map_in_order(
            groups.iter(),
            resources.threads,
            resources.threads + 1,
            |group| {
                let path = images.paths[group[0].image as usize];
                let decoded = decode::plan(path, allowed).and_then(|plan| {
                    let _permit = permits.take(plan.bytes);
                    let image = decode::decode(path, &plan)?;
                    Ok((plan.reduction, group.iter().map(|asked| image.colour(asked.texcoord)).collect::<Vec<_>>()))
                });
                Ok((*group, decoded))
            },
            |(group, decoded)| {
                progress.advance(1);
                progress.check_stopped()?;
                let image = group[0].image as usize;
                let is_first = !std::mem::replace(&mut is_known[image], true);
                match decoded {
                    Ok((reduction, answers)) => {
                        if is_first {
                            found.note_image(images.paths[image], reduction, findings);
                        }
                        group.iter().zip(answers).for_each(|(asked, colour)| colours[asked.place as usize] = colour);
                    }
                    Err(why) if is_first => {
                        findings.note("unreadable_image", || format!("{}: {why}", escape_path(images.paths[image])))
                    }
                    Err(_) => {}
                }
                Ok(())
            },
        )?;
        let mut colours = colours.chunks_exact(2);
        for (set, range) in round {
            for pair in colours.by_ref().take((range.end - range.start) as usize) {
                let difference = (0..3).map(|c| f64::from((pair[0][c] - pair[1][c]).abs())).sum::<f64>() / 3.0;
                if difference.is_finite() {
                    found.differences[set].add(difference);
                }
            }
        }
    }
    Ok(found)
}

impl Contrasts {
    fn note_image(&mut self, path: &Path, reduction: u32, findings: &mut Findings) {
        self.images += 1;
        if reduction > 1 {
            self.reduced += 1;
            findings.note("reduced_image", || format!("{}: read at 1/{reduction} of its size", escape_path(path)));
        }
    }
}

/// Rounds of at most `most` pairs, each as ranges of the sets.
fn rounds(sets: &[Pairs], most: u64) -> Vec<Vec<(usize, Range<u64>)>> {
    let mut rounds: Vec<Vec<(usize, Range<u64>)>> = vec![Vec::new()];
    let mut room = most;
    for (set, pairs) in sets.iter().enumerate() {
        let mut start = 0;
        while start < pairs.column.len() {
            if room == 0 {
                rounds.push(Vec::new());
                room = most;
            }
            let end = (start + room).min(pairs.column.len());
            if let Some(round) = rounds.last_mut() {
                round.push((set, start..end));
            }
            room -= end - start;
            start = end;
        }
    }
    rounds
}

/// The colour queries of a round, image by image; colours that are known already are put in their places.
fn questions(
    round: &[(usize, Range<u64>)],
    sets: &[Pairs],
    images: &Images,
    colours: &mut [[f32; 3]],
) -> Result<Vec<ColourQuery>> {
    let mut questions = Vec::new();
    let mut first = 0;
    for (set, range) in round {
        let [of_own, of_other] = &images.of_sets[*set];
        let known_side = sets[*set].known.map(|(_, side)| side);
        for (pair, place) in sets[*set].column.window(range.clone())?.iter().zip((first..).step_by(2)) {
            if pair.image != ImageId::NONE && pair.other_image != ImageId::NONE {
                let (image, other) = (of_own[pair.image], of_other[pair.other_image]);
                if known_side != Some(OriginalSide::Own) {
                    questions.push(ColourQuery { image, place, texcoord: pair.texcoord });
                }
                if known_side != Some(OriginalSide::Other) {
                    questions.push(ColourQuery { image: other, place: place + 1, texcoord: pair.other_texcoord });
                }
            }
        }
        if let Some((known, side)) = sets[*set].known {
            let places = colours[first as usize..].iter_mut().skip(usize::from(side == OriginalSide::Other)).step_by(2);
            places.zip(known.window(range.clone())?.iter()).for_each(|(place, colour)| *place = *colour);
        }
        first += 2 * (range.end - range.start) as u32;
    }
    questions.sort_unstable_by_key(|question| (question.image, question.place));
    Ok(questions)
}

/// The images of several meshes; images of equal content are held once.
struct Images<'a> {
    paths: Vec<&'a Path>,
    /// For each set, the image of each texture image of the points and of the other points.
    of_sets: Vec<[TiVec<ImageId, u32>; 2]>,
}

impl<'a> Images<'a> {
    fn of(sets: &[Pairs<'a>]) -> Self {
        let mut by_content: BTreeMap<Content, u32> = BTreeMap::new();
        let mut by_path: BTreeMap<&'a Path, u32> = BTreeMap::new();
        let mut paths: Vec<&'a Path> = Vec::new();
        let mut numbers = |(images, contents): KnownImages<'a>| -> TiVec<ImageId, u32> {
            let mut number = |path: &'a Path, content: &Option<Content>| {
                let next = paths.len() as u32;
                let number = match content {
                    Some(content) => *by_content.entry(*content).or_insert(next),
                    None => *by_path.entry(path).or_insert(next),
                };
                if number == next {
                    paths.push(path);
                }
                number
            };
            images.files.iter().zip(contents).map(|(file, content)| number(&file.path, content)).collect()
        };
        let of_sets = sets.iter().map(|pairs| [numbers(pairs.own), numbers(pairs.other)]).collect();
        Self { paths, of_sets }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::ColumnWriter;

    #[test]
    fn rounds_hold_all_pairs_and_no_more_than_fit() {
        let folder = tempfile::tempdir().unwrap();
        let images = TextureImages::default();
        let column = |name: &str, count: usize| {
            let mut writer = ColumnWriter::create(&folder.path().join(name), *b"samples ").unwrap();
            writer.append(&vec![bytemuck::Zeroable::zeroed(); count]).unwrap();
            writer.finish().unwrap()
        };
        let columns = [column("a", 5), column("b", 0), column("c", 4)];
        let none = (&images, TiSlice::from_ref(&[]));
        let sets = columns.each_ref().map(|column| Pairs { column, own: none, other: none, known: None });
        assert_eq!(rounds(&sets, 4), [vec![(0, 0..4)], vec![(0, 4..5), (2, 0..3)], vec![(2, 3..4)]]);
        assert_eq!(rounds(&sets, 100), [vec![(0, 0..5), (2, 0..4)]]);
    }
}
