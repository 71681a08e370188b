//! Colours of the original as texels of a given length would show them.
//!
//! ```text
//!     ┌───┬───┬───┬───┐      a texel of the given length lies on the surface, its middle at the point;
//!     │ . │ . │ . │ . │      places in it are as dense as the texels of the original, 64 at most;
//!     ├───┼───┼───┼───┤      each shows the colour of the point of the original that is closest to it;
//!     │ . │ . p . │ . │      the mean of these colours is what the texel shows
//!     └───┴───┴───┴───┘
//! ```
//! In: points of the original. Out: a colour for each. Invariant: a colour depends on the original, the point and the
//! length alone.
//!
//! # Memory
//! While images are decoded, those that fit the budget; afterwards 4 MiB and a search in each thread.
//!
//! # Files
//! `measure-image-<number>.texels`, 3 bytes a pixel.

use glam::{DVec3, Vec3};

use super::cells::MeasuredMesh;
use super::options::Resources;
use super::search::{Closest, Search, density};
use crate::base::id::TiVec;
use crate::base::{Findings, Progress, Result};
use crate::geometry::triangle::unit_normal;
use crate::image::stored::{Beyond, StoredImage, TexelReader, decode_within};
use crate::model::id::ImageId;
use crate::surface::cell::CellView;

/// Maximum number of places along each side of a texel.
const PLACES_MAX: f64 = 8.0;
/// A texel may cover this share of one of the original's more than a whole number of them, through rounding.
const ROUNDING: f64 = 0.01;
/// Points whose places are searched together.
const POINTS: usize = 64;

/// Mean of the colours that a texel covers, red, green and blue, from 0 to 255; not numbers if it covers none.
pub type FilteredColour = [f32; 3];

/// A point of the original, and the texture of the triangle that it lies on.
#[derive(Debug, Clone, Copy)]
pub struct TexelMiddle {
    /// The point.
    pub position: DVec3,
    /// Normal of its triangle.
    pub normal: DVec3,
    /// Image of its triangle, or none.
    pub image: ImageId,
    /// Length in texture space per length in space.
    pub density: f32,
}

impl TexelMiddle {
    /// A point of a triangle of the original.
    pub fn of_face(position: DVec3, view: &CellView, face: u32) -> Self {
        let triangle = view.triangle(face);
        let face = view.faces[face as usize];
        Self { position, normal: unit_normal(triangle), image: face.image, density: density(triangle, &face) }
    }
}

impl From<&Closest> for TexelMiddle {
    fn from(closest: &Closest) -> Self {
        let Closest { position, normal, image, density, .. } = *closest;
        Self { position, normal, image, density }
    }
}

/// The original with its images, as texels of a given length show it.
#[derive(Debug)]
pub struct TexelFilter<'a> {
    mesh: &'a MeasuredMesh,
    images: TiVec<ImageId, Option<StoredImage>>,
    /// Length of a texel's side.
    texel: f64,
}

impl<'a> TexelFilter<'a> {
    /// Decodes the images of the original; one that cannot be decoded is noted.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes.
    pub fn prepare(
        mesh: &'a MeasuredMesh,
        texel: f64,
        resources: &Resources,
        findings: &mut Findings,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let files = &mesh.images.files;
        progress.begin("decode", files.len() as u64, "images");
        let mut images: TiVec<ImageId, Option<StoredImage>> = vec![None; files.len()].into();
        let decode = |image: ImageId, plan| {
            let path = mesh.folder().join(format!("measure-image-{:06}.texels", image.number()));
            let mut findings = Findings::default();
            Ok((StoredImage::decode(&files[image].path, plan, &path, &mut findings)?, findings))
        };
        let all = files.iter_enumerated().map(|(image, file)| (image, &*file.path));
        decode_within(resources.work_bytes, all, decode, |image, (stored, found)| {
            progress.advance(1);
            progress.check_stopped()?;
            images[image] = stored;
            findings.merge(found);
            Ok(())
        })?;
        Ok(Self { mesh, images, texel })
    }

    /// The colours that texels with these middles show.
    ///
    /// # Errors
    /// On failed reads.
    pub fn colours(&self, middles: &[TexelMiddle]) -> Result<Vec<FilteredColour>> {
        let mut search = Search::new(&self.mesh.surface);
        let mut reader = TexelReader::new(&self.images);
        let mut colours = Vec::with_capacity(middles.len());
        let (mut places, mut ends) = (Vec::new(), Vec::new());
        for group in middles.chunks(POINTS) {
            places.clear();
            ends.clear();
            for middle in group {
                self.spread(middle, &mut places);
                ends.push(places.len());
            }
            let found = self.look(&mut search, &mut reader, &places)?;
            let mut start = 0;
            for &end in &ends {
                colours.push(mean(&found[start..end]));
                start = end;
            }
        }
        Ok(colours)
    }

    /// Adds the places in a texel, in the plane of its middle's triangle.
    fn spread(&self, middle: &TexelMiddle, places: &mut Vec<DVec3>) {
        let count = self.places_along(middle);
        let (across, along) = match middle.normal.try_normalize() {
            Some(normal) => normal.any_orthonormal_pair(),
            None => (DVec3::X, DVec3::Y),
        };
        let offset = |place: usize| ((place as f64 + 0.5) / count as f64 - 0.5) * self.texel;
        for row in 0..count {
            places.extend((0..count).map(|column| middle.position + across * offset(column) + along * offset(row)));
        }
    }

    /// Number of places along each side of a texel: as many as the original has texels there.
    fn places_along(&self, middle: &TexelMiddle) -> usize {
        let Some(Some(image)) = self.images.get(middle.image) else { return 1 };
        let [width, height] = image.size().map(f64::from);
        let texels = self.texel * f64::from(middle.density) * (width * height).sqrt();
        (texels - ROUNDING).ceil().clamp(1.0, PLACES_MAX) as usize
    }

    /// The colour of the original at the point closest to each place.
    fn look(
        &self,
        search: &mut Search<'_>,
        reader: &mut TexelReader<'_>,
        places: &[DVec3],
    ) -> Result<Vec<Option<Vec3>>> {
        let (spoken, _) = search.nearest(places, 1)?;
        let mut colours = Vec::with_capacity(places.len());
        for (number, found) in spoken {
            colours.push(if found.distance_sq.is_finite() {
                let closest = search.closest(places[number], &found)?;
                reader.colour(closest.image, closest.texcoord, Beyond::Edge)?
            } else {
                None
            });
        }
        Ok(colours)
    }
}

fn mean(colours: &[Option<Vec3>]) -> FilteredColour {
    let known = colours.iter().flatten();
    let count = known.clone().count();
    if count == 0 { [f32::NAN; 3] } else { (known.sum::<Vec3>() / count as f32).to_array() }
}
