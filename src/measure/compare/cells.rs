//! A mesh prepared for measuring: cells of neighbouring triangles in one file, each with its search tree.
//!
//! ```text
//! mesh files ── read ──▶ columns ── partition ──▶ clusters ── tree, counts ──▶ measure-cells.bin, topology
//! ```
//! Invariant: cells depend on the mesh alone, so numbers that are measured on them do not depend on the budget or the
//! number of threads.
//!
//! # Memory
//! That of [cells](crate::surface::cell).

use std::path::Path;

use glam::DVec3;

use super::options::Resources;
use super::seams::{SeamEdges, SeamWriter};
use crate::base::{Findings, Progress, Result};
use crate::image::textures::TextureImages;
use crate::job::{InputFile, Manifest, Resume, WorkFolder};
use crate::model::texture_file::TextureReach;
use crate::model::{Catalogue, StoredMesh};
use crate::partition::id::PartitionVertex;
use crate::partition::{self, ClusterSource, Partition, PartitionOptions, VisitOptions, visit};
use crate::read::InputChoice;
use crate::read::{self, Scan};
use crate::surface::cell::{CellDraft, CellMaker, CellWriter, FACE_BYTES};
use crate::surface::cells::SurfaceCells;
use crate::topology::cluster::ClusterCounts;
use crate::topology::{Counter, MeshCounts, Topology, count_cluster};

/// Memory of a border edge while borders are compared, in bytes.
const BORDER_EDGE_BYTES: u64 = 600;

/// A mesh prepared for measuring.
#[derive(Debug)]
pub struct MeasuredMesh {
    /// Its cells.
    pub surface: SurfaceCells,
    /// Sum of the cells' areas.
    pub area: f64,
    /// Enclosed volume, if the mesh is closed.
    pub volume: f64,
    /// Counts.
    pub counts: MeshCounts,
    /// Edges of the border; `None` if there are too many for the budget.
    pub border: Option<Vec<[DVec3; 2]>>,
    /// Edges between faces that show different places of images.
    pub seams: SeamEdges,
    /// The images that it shows.
    pub images: TextureImages,
    /// Findings of the scan: elements ignored, dropped or repaired.
    pub findings: Findings,
    work: WorkFolder,
}

/// A mesh that was read and partitioned into cells.
struct ReadMesh {
    work: WorkFolder,
    mesh: StoredMesh,
    catalogue: Catalogue,
    findings: Findings,
    partition: Partition,
}

impl ReadMesh {
    fn make(
        input: &InputChoice,
        folder: &Path,
        cell_faces: u64,
        resources: &Resources,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let inputs = read::find_inputs(input)?;
        let manifest = Manifest {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            options: "compare".to_owned(),
            inputs: inputs.iter().map(|path| InputFile::of(path)).collect::<Result<_>>()?,
            passes: 1,
            owns_folder: true,
            ..Manifest::default()
        };
        let work = WorkFolder::open_watched(folder, &manifest, Resume::Again, progress)?;
        let Scan { mesh, catalogue, findings, .. } = read::scan(&inputs, work.path(), &resources.scan, progress)?;
        let options = PartitionOptions::as_read(cell_faces, resources.limits());
        progress.begin("partition", 0, "");
        let partition = partition::partition(&mesh, &catalogue, work.path(), "pass-0", &options)?;
        Ok(Self { work, mesh, catalogue, findings, partition })
    }
}

impl MeasuredMesh {
    /// Reads a mesh file, or all below a folder, and prepares them in the work folder `folder`, in cells of about
    /// `cell_faces` triangles.
    ///
    /// # Errors
    /// Those of the scan and the partition.
    pub fn prepare(
        input: &InputChoice,
        folder: &Path,
        cell_faces: u64,
        resources: &Resources,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let ReadMesh { work, mesh, catalogue, mut findings, mut partition } =
            ReadMesh::make(input, folder, cell_faces, resources, progress)?;
        let images = TextureImages::find(&catalogue, &TextureReach::Anywhere, &mut findings);
        let dropped = std::mem::take(&mut partition.findings);
        let first = usize::from(!partition.numbering.positions.is_empty());
        let reference = partition.numbering.positions.gather(&PartitionVertex::first(first).collect::<Vec<_>>())?;
        let reference = reference.first().copied().unwrap_or(DVec3::ZERO);
        let maker = CellMaker { images: &images };
        let border_limit = (resources.work_bytes / 4 / BORDER_EDGE_BYTES) as usize;
        let mut seams = SeamWriter::create(work.path())?;
        let (shared, faces) = (&partition.faces.shared, partition.total_faces());
        let mut counter = Counter::create(work.path(), shared, faces, border_limit, |edges| seams.push(edges))?;
        counter.add_degenerate(findings.get("degenerate_faces") + dropped.get("degenerate_faces"));
        let mut writer = CellWriter::create(&work.path().join("measure-cells.bin"), reference)?;
        progress.begin("prepare", partition.total_faces(), "faces");
        let options = VisitOptions { work_bytes: resources.limits().work_bytes, face_bytes: FACE_BYTES, progress };
        let work_on = |source: &ClusterSource| {
            Ok((maker.draft(source, Vec::new()), count_cluster(source, &catalogue, &images.of_part)?))
        };
        visit(&partition, &mesh, &catalogue, &options, work_on, |(draft, counts): (CellDraft, ClusterCounts)| {
            writer.append(draft)?;
            counter.push(counts)
        })?;
        let (cells, volume) = writer.finish()?;
        let gather = |ids: &[PartitionVertex]| partition.numbering.positions.gather(ids);
        let Topology { counts, border } = counter.finish(gather)?;
        partition.files().for_each(|path| _ = std::fs::remove_file(path));
        remove_columns(&mesh);
        let surface = SurfaceCells::from(cells);
        Ok(Self {
            area: surface.area(),
            surface,
            volume,
            counts,
            border,
            seams: seams.finish()?,
            images,
            findings,
            work,
        })
    }

    /// The folder for files of the comparison.
    pub fn folder(&self) -> &Path {
        self.work.path()
    }
}

/// Removes the columns of the scan, which the cells replace.
fn remove_columns(mesh: &StoredMesh) {
    for piece in &mesh.pieces {
        for path in [piece.positions.path(), piece.texcoords.path(), piece.faces.path()] {
            let _ = std::fs::remove_file(path);
        }
        if let Some(colours) = &piece.colours {
            let _ = std::fs::remove_file(colours.path());
        }
    }
}
