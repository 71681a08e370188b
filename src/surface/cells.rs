//! A surface: the cells of a mesh.
//!
//! In: a stored mesh. Out: its cells in one file. Invariant: they depend on the mesh alone.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::cell::{Cell, CellMaker, CellWriter, FACE_BYTES};
use crate::base::{Progress, Result, WorkLimits};
use crate::geometry::boxtree::Bounds;
use crate::image::textures::TextureImages;
use crate::model::{Catalogue, ColourRange, StoredMesh};
use crate::partition::{self, ClusterSource, Partition, PartitionOptions, VisitOptions, reading, visit};

/// Approximate number of triangles of a cell: some fit the memory of each thread that searches them.
const CELL_FACES: u64 = 1 << 14;

/// The cells of a mesh.
#[derive(Debug, Serialize, Deserialize)]
pub struct SurfaceCells {
    /// The cells.
    pub cells: Vec<Cell>,
    /// The smallest box around its triangles.
    pub bounds: Bounds,
}

/// Where cells are made, and of what.
#[derive(Clone, Copy)]
pub struct SurfacePlace<'a> {
    /// Folder for the files.
    pub folder: &'a Path,
    /// What the names of the files begin with.
    pub name: &'a str,
    /// What making them may take of the machine.
    pub limits: WorkLimits,
    /// What hears of it.
    pub progress: &'a dyn Progress,
}

impl From<Vec<Cell>> for SurfaceCells {
    fn from(cells: Vec<Cell>) -> Self {
        Self { bounds: cells.iter().fold(Bounds::EMPTY, |all, cell| all.with(cell.bounds)), cells }
    }
}

impl SurfaceCells {
    /// Makes the cells of a mesh: `<name>-surface.cells`.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes, and damaged files.
    pub fn make(
        mesh: &StoredMesh,
        catalogue: &Catalogue,
        images: &TextureImages,
        place: &SurfacePlace<'_>,
    ) -> Result<Self> {
        let SurfacePlace { folder, name, limits, progress } = *place;
        let options = PartitionOptions::as_read(CELL_FACES, limits);
        progress.begin("partition", 0, "");
        let partition = partition::partition(mesh, catalogue, folder, name, &options)?;
        progress.begin("prepare", partition.total_faces(), "faces");
        // Of all colours, not of a cluster's: what a channel of 1 stands for holds for the whole mesh.
        let range = partition.numbering.colours.as_ref().map(ColourRange::of).transpose()?.unwrap_or_default();
        let maker = CellMaker { images };
        let mut writer = CellWriter::create(&folder.join(format!("{name}-surface.cells")), DVec3::ZERO)?;
        let options = VisitOptions { work_bytes: limits.work_bytes, face_bytes: FACE_BYTES, progress };
        let draft = |source: &ClusterSource| Ok(maker.draft(source, colours(source, &partition, range)?));
        visit(&partition, mesh, catalogue, &options, draft, |draft| writer.append(draft))?;
        let (cells, _) = writer.finish()?;
        partition.files().for_each(|path| _ = std::fs::remove_file(path));
        Ok(Self::from(cells))
    }

    /// Sum of the areas of the cells.
    pub fn area(&self) -> f64 {
        self.cells.iter().map(|cell| cell.area).sum()
    }

    /// Number of triangles.
    pub fn face_count(&self) -> u64 {
        self.cells.iter().map(Cell::face_count).sum()
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.cells.iter_mut().for_each(|cell| cell.locate(folder));
    }

    /// Reports whether a recalled and located value is consistent with its file.
    pub fn is_sound(&self) -> bool {
        self.cells.iter().all(Cell::is_sound)
    }

    /// Path of its file; `None` if it has no triangles.
    pub fn path(&self) -> Option<&Path> {
        self.cells.first().map(Cell::path)
    }
}

/// Colours of a cluster's vertices, the fourth byte 0 where there is none; empty if the mesh has none.
fn colours(source: &ClusterSource, partition: &Partition, range: ColourRange) -> Result<Vec<[u8; 4]>> {
    let Some(colours) = &partition.numbering.colours else { return Ok(Vec::new()) };
    let of_vertex = |colour: [f32; 3]| {
        if colour[0].is_nan() {
            return [0; 4];
        }
        let [red, green, blue] = range.bytes(colour);
        [red, green, blue, 255]
    };
    Ok(reading::gather(colours, source.loaded_vertices())?.into_iter().map(of_vertex).collect())
}
