//! A mesh prepared for measuring: cells of neighbouring triangles in one file, each with its search tree.
//!
//! ```text
//! mesh files ── read ──▶ columns ── partition ──▶ clusters ── tree, counts ──▶ measure-cells.bin, topology
//!
//! | header 64 B | cell 0: positions 24 B, pairs 64 B, tilted boxes 64 B, faces 40 B each, padded to 8 | cell 1 … |
//! ```
//! Invariant: cells depend on the mesh alone, so numbers that are measured on them do not depend on the budget or the
//! number of threads.
//!
//! # Memory
//! While the mesh is prepared, 400 bytes a face for each cell in work; afterwards about 150 bytes a cell. A cell that
//! is being read takes the pages that are touched, at most 75 bytes a face, or 83 with tilted boxes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::options::Resources;
use super::seams::{SeamEdges, SeamWriter};
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Permits, Progress, Result};
use crate::file::RecordFile;
use crate::file::Segment;
use crate::geometry::boxtree::Bounds;
use crate::geometry::tilted::TiltedBox;
use crate::geometry::triangle::{area, perimeter, texture_area};
use crate::geometry::triangle_tree::{self, Answer, Pair, Question, Tree, TreeView};
use crate::image::textures::TextureImages;
use crate::job::{InputFile, Manifest, Resume, WorkFolder};
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::id::ImageId;
use crate::model::{Catalogue, StoredMesh};
use crate::os::mmap::MappedRecords;
use crate::partition::id::PartitionVertex;
use crate::partition::{self, ClusterSource, Partition, PartitionOptions, TextureScale};
use crate::partition::{cluster, heavy};
use crate::read::InputChoice;
use crate::read::{self, Scan};
use crate::topology::cluster::ClusterCounts;
use crate::topology::{Counter, MeshCounts, Topology, count_cluster};

/// Memory of a face of a cell while the cell is built, in bytes.
const FACE_BYTES: u64 = 400;
/// Memory of a border edge while borders are compared, in bytes.
const BORDER_EDGE_BYTES: u64 = 600;

/// A triangle of a cell.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct CellFace {
    /// Indices of three vertices of the cell.
    pub vertices: [u32; 3],
    /// Texture image of the mesh, or none.
    pub image: ImageId,
    /// Texture coordinates, shifted by whole numbers so that the least lie between 0 and 1; zeros without a texture
    /// image.
    pub texcoords: [[f32; 2]; 3],
}

/// A cell: neighbouring triangles.
#[derive(Debug)]
pub struct Cell {
    /// Positions are relative to this.
    pub origin: DVec3,
    /// The smallest box around its triangles.
    pub bounds: Bounds,
    /// Sum of the areas of its faces, in their order.
    pub area: f64,
    /// Sum of the lengths of their sides, in their order.
    pub side_length: f64,
    /// The texture images that its triangles show, ascending, each with the sum of the areas in texture space.
    pub images: Vec<(ImageId, f64)>,
    positions: Segment<DVec3>,
    pairs: Segment<Pair>,
    tilted: Segment<TiltedBox>,
    faces: Segment<CellFace>,
}

/// A cell that is being read.
#[derive(Debug)]
pub struct CellView {
    /// Its origin.
    pub origin: DVec3,
    /// Positions of its vertices, relative to the origin.
    pub positions: MappedRecords<DVec3>,
    /// Its triangles, in the order of the tree.
    pub faces: MappedRecords<CellFace>,
    pairs: MappedRecords<Pair>,
    tilted: MappedRecords<TiltedBox>,
}

/// A mesh prepared for measuring.
#[derive(Debug)]
pub struct MeasuredMesh {
    /// The cells.
    pub cells: Vec<Cell>,
    /// The smallest box around its triangles.
    pub bounds: Bounds,
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

impl Cell {
    /// Number of vertices.
    pub fn vertex_count(&self) -> u64 {
        self.positions.len()
    }

    /// Opens the cell for reading.
    ///
    /// # Errors
    /// On failed reads.
    pub fn view(&self) -> Result<CellView> {
        Ok(CellView {
            origin: self.origin,
            positions: self.positions.window(0..self.positions.len())?,
            faces: self.faces.window(0..self.faces.len())?,
            pairs: self.pairs.window(0..self.pairs.len())?,
            tilted: self.tilted.window(0..self.tilted.len())?,
        })
    }
}

impl CellView {
    /// Corners of a triangle, relative to the origin.
    #[inline]
    pub fn triangle(&self, face: u32) -> [DVec3; 3] {
        self.faces[face as usize].vertices.map(|vertex| self.positions[vertex as usize])
    }

    /// Answer of the cell's tree to a question, whose point is relative to the origin.
    pub fn ask(&self, question: &Question) -> Answer {
        let tree = TreeView { pairs: &self.pairs, tilted: &self.tilted, count: self.faces.len() };
        tree.ask(question, |face| self.triangle(face))
    }
}

/// A cell before it is written to the file.
struct Draft {
    origin: DVec3,
    bounds: Bounds,
    area: f64,
    side_length: f64,
    volume: f64,
    /// Area in texture space by texture image.
    shown: BTreeMap<ImageId, f64>,
    positions: Vec<DVec3>,
    pairs: Vec<Pair>,
    tilted: Vec<TiltedBox>,
    faces: Vec<CellFace>,
    counts: ClusterCounts,
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
        let work = WorkFolder::open(folder, &manifest, Resume::Again)?;
        let Scan { mesh, catalogue, findings, .. } = read::scan(&inputs, work.path(), &resources.scan, progress)?;
        let options = PartitionOptions {
            cluster_faces: cell_faces,
            pass: 0,
            weld: true,
            drop_doubles: false,
            threads: resources.threads,
            work_bytes: resources.work_bytes,
        };
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
        let Resources { threads, work_bytes, .. } = *resources;
        let ReadMesh { work, mesh, catalogue, mut findings, mut partition } =
            ReadMesh::make(input, folder, cell_faces, resources, progress)?;
        let images = TextureImages::find(&catalogue, &mut findings);
        let dropped = std::mem::take(&mut partition.findings);
        let first = usize::from(!partition.numbering.positions.is_empty());
        let reference = partition.numbering.positions.gather(&PartitionVertex::first(first).collect::<Vec<_>>())?;
        let making = Making {
            catalogue: &catalogue,
            images: &images,
            scale: TextureScale::none(&catalogue),
            reference: reference.first().copied().unwrap_or(DVec3::ZERO),
        };
        let border_limit = (work_bytes / 4 / BORDER_EDGE_BYTES) as usize;
        let mut seams = SeamWriter::create(work.path())?;
        let (shared, faces) = (&partition.faces.shared, partition.total_faces());
        let mut counter = Counter::create(work.path(), shared, faces, border_limit, |edges| seams.push(edges))?;
        counter.add_degenerate(dropped.get("degenerate_faces"));
        let mut writer = CellWriter::create(&work.path().join("measure-cells.bin"))?;
        let permits = Permits::new(work_bytes);
        progress.begin("prepare", partition.total_faces(), "faces");
        map_in_order(
            partition.clusters().filter(|&cluster| partition.weight(cluster).is_some()),
            threads,
            threads + 1,
            |cluster| {
                let faces = partition.face_count(cluster);
                let _permit = permits.take(faces * FACE_BYTES);
                making.draft(&cluster::load(&partition, &mesh, &catalogue, &making.scale, cluster)?)
            },
            |draft| {
                progress.advance(draft.faces.len() as u64);
                progress.check_stopped()?;
                counter.push(writer.append(draft)?)
            },
        )?;
        for cluster in partition.clusters().filter(|&cluster| partition.weight(cluster).is_none()) {
            heavy::load_in_blocks(&partition, &mesh, &catalogue, &making.scale, cluster, |source| {
                progress.advance(source.mesh.corners.len() as u64);
                progress.check_stopped()?;
                counter.push(writer.append(making.draft(&source)?)?)
            })?;
        }
        let (cells, volume) = writer.finish()?;
        let gather = |ids: &[PartitionVertex]| partition.numbering.positions.gather(ids);
        let Topology { counts, border } = counter.finish(gather)?;
        partition.files().for_each(|path| _ = std::fs::remove_file(path));
        remove_columns(&mesh);
        Ok(Self {
            bounds: cells.iter().fold(Bounds::EMPTY, |all, cell| all.with(cell.bounds)),
            area: cells.iter().map(|cell| cell.area).sum(),
            volume,
            counts,
            border,
            seams: seams.finish()?,
            images,
            findings,
            cells,
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

/// Builds cells from clusters.
struct Making<'a> {
    catalogue: &'a Catalogue,
    images: &'a TextureImages,
    scale: TextureScale,
    /// Common apex of the tetrahedra that volumes are summed over.
    reference: DVec3,
}

impl Making<'_> {
    fn draft(&self, source: &ClusterSource) -> Result<Draft> {
        let mesh = &source.mesh;
        let Tree { pairs, tilted, order } =
            triangle_tree::build(mesh.corners.len(), |face| mesh.triangle(FaceId::new(face)));
        let mut draft = Draft {
            origin: source.origin,
            bounds: Bounds::EMPTY,
            area: 0.0,
            side_length: 0.0,
            volume: 0.0,
            shown: BTreeMap::new(),
            positions: mesh.positions.raw.clone(),
            pairs,
            tilted,
            faces: Vec::with_capacity(order.len()),
            counts: count_cluster(source, self.catalogue, &self.images.of_part),
        };
        let mut bounds = Bounds::EMPTY;
        for face in order.into_iter().map(FaceId::new) {
            let triangle = mesh.triangle(face);
            bounds = bounds.with(Bounds::around(triangle));
            draft.area += area(triangle);
            draft.side_length += perimeter(triangle);
            let corners = triangle.map(|corner| corner + source.origin - self.reference);
            draft.volume += corners[0].dot(corners[1].cross(corners[2])) / 6.0;
            let (image, texcoords) = self.texture(source, face);
            *draft.shown.entry(image).or_default() += texture_area(texcoords);
            draft.faces.push(CellFace { vertices: mesh.vertices(face).map(LocalVertex::number), image, texcoords });
        }
        draft.bounds = Bounds { low: bounds.low + source.origin, high: bounds.high + source.origin };
        Ok(draft)
    }

    /// Texture image and texture coordinates of a face.
    fn texture(&self, source: &ClusterSource, face: FaceId) -> (ImageId, [[f32; 2]; 3]) {
        let image = self.images.of_part[source.mesh.parts[face]];
        let [a, b, c] = source.mesh.uv_triangle(face);
        let low = a.min(b).min(c).floor();
        if image == ImageId::NONE || !(a + b + c).is_finite() {
            return (ImageId::NONE, [[0.0; 2]; 3]);
        }
        (image, [a, b, c].map(|uv| (uv - low).as_vec2().to_array()))
    }
}

/// Writes cells one after the other.
struct CellWriter {
    path: PathBuf,
    file: RecordFile,
    cells: Vec<Cell>,
    volume: f64,
}

impl CellWriter {
    fn create(path: &Path) -> Result<Self> {
        Ok(Self { path: path.to_owned(), file: RecordFile::create(path)?, cells: Vec::new(), volume: 0.0 })
    }

    /// Writes a cell and returns what was counted of it.
    fn append(&mut self, draft: Draft) -> Result<ClusterCounts> {
        let positions = self.put(&draft.positions)?;
        let pairs = self.put(&draft.pairs)?;
        let tilted = self.put(&draft.tilted)?;
        let faces = self.put(&draft.faces)?;
        self.volume += draft.volume;
        if !draft.faces.is_empty() {
            self.cells.push(Cell {
                origin: draft.origin,
                bounds: draft.bounds,
                area: draft.area,
                side_length: draft.side_length,
                images: draft.shown.into_iter().collect(),
                positions,
                pairs,
                tilted,
                faces,
            });
        }
        Ok(draft.counts)
    }

    fn put<T: Pod>(&mut self, records: &[T]) -> Result<Segment<T>> {
        let bytes: &[u8] = bytemuck::cast_slice(records);
        let padding = bytes.len().next_multiple_of(8) - bytes.len();
        let begin = self.file.put(bytes)?;
        self.file.put(&[0; 8][..padding])?;
        Ok(Segment::new(self.path.clone(), begin, records.len() as u64))
    }

    fn finish(self) -> Result<(Vec<Cell>, f64)> {
        self.file.finish(*b"cells   ", 0, self.cells.len() as u64)?;
        Ok((self.cells, self.volume))
    }
}
