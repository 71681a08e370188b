//! Inspects an input: counts, bounds, materials, seams, borders and faults, within a memory budget.
//!
//! In: mesh files. Out: an [`Inspection`]. Invariant: the counts are those of the whole mesh, at any budget and number
//! of threads; edges that cells share are matched across them.
//!
//! ```text
//! scan ──▶ columns ──▶ bounds, polygons
//!             └── partition ──▶ clusters ──▶ edges with an end of their own: counted
//!                                       └──▶ edges between two shared vertices ──▶ matched ──▶ counted
//! ```
//!
//! # Memory
//! Clusters in work take 200 bytes a face, the buffers of [`topology::shared`](crate::topology::shared) and of the faces
//! of clusters that are too heavy to load 24 MiB.
//!
//! # Files
//! Those of the scan and of one partition, in a work folder that is removed at the end.

mod face_triples;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::Serialize;

use self::face_triples::FaceTriples;
use crate::base::bytes::MIB;
use crate::base::id::TiVec;
use crate::base::ordered::map_in_order;
use crate::base::{Error, Findings, Permits, Progress, Result, bytes, counted, grouped};
use crate::job::{InputFile, Manifest, Resume, WorkFolder};
use crate::mesh::doubles::doubles;
use crate::model::id::{ImageId, PartId};
use crate::model::texture_file::{TextureReach, Unusable};
use crate::model::{Catalogue, StoredMesh};
use crate::os::durable::temporary_folder;
use crate::partition::{self, ClusterId, Partition, PartitionOptions, TextureScale, cluster, heavy};
use crate::plan::{memory, scratch};
use crate::read::InputChoice;
use crate::read::{self, Scan};
use crate::report::warning_lines;
use crate::topology::{Counter, TopologyCounts, count_cluster};

/// Memory of a face of a cluster while it is counted, and of its edges that wait to be matched, in bytes.
const FACE_BYTES: u64 = 200;
/// Memory of a face for each thread, larger cells included, from which the size of cells is chosen.
const FACE_BYTES_ALLOWED: u64 = 400;
/// Approximate minimum and maximum number of faces of a cluster, at any budget.
const CLUSTER_FACES_MIN: u64 = 5_000;
const CLUSTER_FACES_MAX: u64 = 250_000;
/// Memory of the buffers of two bucketed files, in bytes.
const BUFFERS_BYTES: u64 = 24 * MIB;
/// Advice for a texture outside the folder of its MTL.
const TAKEN_ON_REQUEST: &str = "`simplify` takes it with --textures-outside copy";
/// Width of the column of names, in characters.
const NAME_WIDTH: usize = 20;

/// Options of `drystone inspect`; none changes the counts.
#[derive(Debug, Clone, Default)]
pub struct InspectOptions {
    /// Memory in bytes; half of the machine's by default.
    pub memory: Option<u64>,
    /// Threads; one for each processor by default.
    pub threads: Option<usize>,
    /// Work folder; one in the system's temporary folder by default.
    pub work: Option<PathBuf>,
}

/// Result of an inspection.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// Mesh files.
    pub files: u64,
    /// Bytes of the mesh files.
    pub bytes: u64,
    /// Vertices as written.
    pub vertices: u64,
    /// Texture coordinates as written.
    pub texcoords: u64,
    /// Polygons of three or more corners.
    pub polygons: u64,
    /// Polygons of more than three corners.
    pub larger_polygons: u64,
    /// Triangles, after triangulation.
    pub triangles: u64,
    /// Whether there are vertex normals.
    pub has_normals: bool,
    /// Whether there are vertex colours.
    pub has_colours: bool,
    /// Least and greatest coordinates.
    pub bounds: [[f64; 3]; 2],
    /// Extent along each axis, in the mesh's unit of length.
    pub size: [f64; 3],
    /// Largest number of decimals of a position, and of a texture coordinate.
    pub decimals: [u32; 2],
    /// Combinations of file, object, group and material.
    pub parts: u64,
    /// Materials that faces use.
    pub materials: u64,
    /// Of these, materials that no MTL file defines.
    pub undefined_materials: u64,
    /// Texture images that the materials refer to.
    pub textures: u64,
    /// Of these, images that are missing.
    pub missing_textures: u64,
    /// Of these, images outside of the folder of their MTL, which are copied only where the user allows it.
    pub outside_textures: u64,
    /// Vertices at the position of an earlier one.
    pub welded_vertices: u64,
    /// Vertices that no face uses, after welding.
    pub unused_vertices: u64,
    /// Edges, borders, seams, components and charts after welding.
    pub topology: TopologyCounts,
    /// Number of repaired, dropped or ignored elements of the scan, by kind.
    pub faults: BTreeMap<String, u64>,
    /// Messages about them, where there are any.
    pub warnings: Vec<String>,
}

/// Inspects a mesh file, or all below a folder.
///
/// # Errors
/// [`Error::Budget`] and [`Error::NoSpace`] before anything is read; else those of the scan and the partition.
pub fn inspect(input: impl Into<InputChoice>, options: &InspectOptions, progress: &dyn Progress) -> Result<Inspection> {
    inspect_in_clusters(&input.into(), options, CLUSTER_FACES_MAX, progress)
}

/// Inspects a mesh in clusters of at most about `cluster_faces` faces.
fn inspect_in_clusters(
    input: &InputChoice,
    options: &InspectOptions,
    cluster_faces: u64,
    progress: &dyn Progress,
) -> Result<Inspection> {
    if options.threads == Some(0) {
        return Err(Error::Usage("`threads: 0`: expected at least 1".into()));
    }
    let (inputs, idle) = read::find_inputs_and_idle(input)?;
    let budget = memory::budget_of(options.memory)?;
    let threads = memory::choose_threads(options.threads, budget);
    let work_path = options.work.clone().unwrap_or_else(|| temporary_folder("inspect"));
    let files = inputs.iter().map(|path| InputFile::of(path)).collect::<Result<Vec<_>>>()?;
    scratch::refuse_small_disk(files.iter().map(|file| file.bytes).sum(), 0, &work_path)?;
    let manifest = Manifest {
        program: env!("CARGO_PKG_VERSION").to_owned(),
        options: "inspect".to_owned(),
        inputs: files,
        passes: 1,
        owns_folder: options.work.is_none(),
        ..Manifest::default()
    };
    let work = WorkFolder::open_watched(&work_path, &manifest, Resume::Again, progress)?;

    let scan_options = memory::scan_options(budget, threads);
    let Scan { mesh, catalogue, triangles, mut findings, input_bytes, .. } =
        read::scan(&inputs, work.path(), &scan_options, progress)?;
    let (low, high) = mesh.bounds();
    let (polygons, larger_polygons) = polygons(&mesh, threads)?;
    let polygons = polygons + findings.get("degenerate_faces");

    let work_bytes = budget.for_work();
    let allowed = work_bytes.saturating_sub(BUFFERS_BYTES) / (FACE_BYTES_ALLOWED * (threads as u64 + 1));
    let cluster_faces = allowed.max(CLUSTER_FACES_MIN).min(cluster_faces);
    let partition_options = PartitionOptions {
        cluster_faces,
        pass: 0,
        weld: true,
        drop_doubles: false,
        drop_texcoords: false,
        threads,
        work_bytes,
    };
    progress.begin("partition", 0, "");
    let mut partition = partition::partition(&mesh, &catalogue, work.path(), "pass-0", &partition_options)?;
    findings.merge(std::mem::take(&mut partition.findings));
    let counting = Counting { mesh: &mesh, partition: &partition, catalogue: &catalogue, threads, work_bytes };
    let mut topology = counting.count(work.path(), &mut findings, progress)?;
    // With those that the scan and the partition dropped.
    topology.degenerate_faces = findings.get("degenerate_faces");

    let [textures, missing_textures, outside_textures] = textures(&catalogue, &mut findings);
    let welded_vertices = findings.get("welded_vertices");
    Ok(Inspection {
        files: inputs.len() as u64,
        bytes: input_bytes,
        vertices: mesh.vertex_count(),
        texcoords: mesh.texcoord_count(),
        polygons,
        larger_polygons,
        triangles,
        has_normals: catalogue.has_normals,
        has_colours: mesh.has_colours(),
        bounds: [low.to_array(), high.to_array()],
        size: (high - low).to_array(),
        decimals: [catalogue.position_decimals, catalogue.texcoord_decimals],
        parts: catalogue.parts.len() as u64,
        materials: catalogue.materials.len() as u64,
        undefined_materials: catalogue.materials.iter().filter(|material| material.definition.is_none()).count() as u64,
        textures,
        missing_textures,
        outside_textures,
        welded_vertices,
        unused_vertices: (mesh.vertex_count() - welded_vertices).saturating_sub(topology.vertices),
        topology,
        faults: faults(&findings),
        warnings: [findings, idle].iter().flat_map(Findings::warnings).collect(),
    })
}

/// Findings of the scan that are faults.
fn faults(findings: &Findings) -> BTreeMap<String, u64> {
    let found = findings.iter().filter(|(kind, _)| *kind != "welded_vertices");
    found.map(|(kind, finding)| (kind.to_owned(), finding.count)).collect()
}

/// Number of stored polygons, and of those with more than three corners.
fn polygons(mesh: &StoredMesh, threads: usize) -> Result<(u64, u64)> {
    let blocks = mesh.pieces.iter().flat_map(|piece| piece.faces.blocks().iter().map(move |block| (piece, block)));
    let (mut all, mut larger) = (0, 0);
    map_in_order(
        blocks,
        threads,
        threads * 2,
        |(piece, block)| {
            let mut faces = Vec::new();
            piece.faces.read_block(&piece.faces.open()?, block, &mut Vec::new(), &mut faces)?;
            let all = faces.iter().filter(|face| !face.continues_polygon).count();
            // A block never ends with the first triangle of a larger polygon, so both stand in one block.
            let larger = faces.windows(2).filter(|pair| !pair[0].continues_polygon && pair[1].continues_polygon);
            Ok((all as u64, larger.count() as u64))
        },
        |counts: (u64, u64)| {
            all += counts.0;
            larger += counts.1;
            Ok(())
        },
    )?;
    Ok((all, larger))
}

/// Numbers of images that MTL files refer to, of those that are missing, and of those outside of the files' folders; the
/// latter two are noted.
fn textures(catalogue: &Catalogue, findings: &mut Findings) -> [u64; 3] {
    let definitions = catalogue.materials.iter().filter_map(|material| material.definition.as_ref());
    let names = definitions.flat_map(|definition| {
        definition.textures.iter().map(move |texture| (definition.folder.as_path(), texture.name.as_slice()))
    });
    let (names, reach): (BTreeSet<_>, _) = (names.collect(), TextureReach::of(catalogue, false));
    let (mut missing, mut outside) = (0, 0);
    for (folder, name) in &names {
        let Err(why) = reach.find(folder, name) else { continue };
        why.note(folder, name, TAKEN_ON_REQUEST, findings);
        match why {
            Unusable::Refused(_) => outside += 1,
            Unusable::Missing(..) | Unusable::NoFile(_) => missing += 1,
        }
    }
    [names.len() as u64, missing, outside]
}

/// State while the clusters of a partition are counted.
struct Counting<'a> {
    mesh: &'a StoredMesh,
    partition: &'a Partition,
    catalogue: &'a Catalogue,
    threads: usize,
    work_bytes: u64,
}

impl Counting<'_> {
    fn count(&self, folder: &Path, findings: &mut Findings, progress: &dyn Progress) -> Result<TopologyCounts> {
        let faces = self.partition.total_faces();
        progress.begin("count", faces, "faces");
        let scale = TextureScale::none(self.catalogue);
        let partition = self.partition;
        let images: TiVec<PartId, _> = vec![ImageId::NONE; self.catalogue.parts.len()].into();
        let mut counter = Counter::create(folder, &self.partition.faces.shared, faces, 0, |_| Ok(()))?;
        let mut doubled = 0;
        let permits = Permits::new(self.work_bytes.saturating_sub(BUFFERS_BYTES));
        let is_light = |&cluster: &ClusterId| partition.weight(cluster).is_some();
        let permitted = partition.clusters().filter(is_light).map(|cluster| {
            let own = partition.weight(cluster).map_or(0, |weight| weight.bytes());
            (permits.take(own.max(partition.face_count(cluster) * FACE_BYTES)), cluster)
        });
        map_in_order(
            permitted,
            self.threads,
            self.threads + 1,
            |(permit, cluster)| {
                let source = cluster::load(partition, self.mesh, self.catalogue, &scale, cluster)?;
                let doubled = doubles(source.mesh.corner_vertices.iter().copied()).len() as u64;
                let counts = count_cluster(&source, self.catalogue, &images)?;
                Ok((permit, counts, doubled, partition.face_count(cluster)))
            },
            |(_permit, cluster, doubles, faces)| {
                doubled += doubles;
                progress.advance(faces);
                progress.check_stopped()?;
                counter.push(cluster)
            },
        )?;
        for cluster in partition.clusters().filter(|cluster| !is_light(cluster)) {
            let mut triples = FaceTriples::create(folder, partition.face_count(cluster))?;
            heavy::load_in_blocks(partition, self.mesh, self.catalogue, &scale, cluster, |source| {
                triples.add(&source)?;
                progress.advance(source.mesh.corners.len() as u64);
                progress.check_stopped()?;
                counter.push(count_cluster(&source, self.catalogue, &images)?)
            })?;
            doubled += triples.doubled()?;
        }
        let topology = counter.finish(|ids| self.partition.numbering.positions.gather(ids))?.counts.topology;
        findings.count("degenerate_faces", topology.degenerate_faces);
        findings.count("doubled_faces", doubled);
        Ok(topology)
    }
}

impl Inspection {
    /// The inspection as a table for people.
    pub fn table(&self) -> String {
        let mut text = String::new();
        let mut row = |name: &str, words: String| {
            let _ = writeln!(text, "{name:NAME_WIDTH$}{words}");
        };
        row("input", format!("{}, {}", counted(self.files, "file"), bytes::display(self.bytes)));
        row("triangles", grouped(self.triangles));
        let larger = format!(" ({} with more than three corners)", grouped(self.larger_polygons));
        row("polygons", grouped(self.polygons) + if self.larger_polygons > 0 { &larger } else { "" });
        let extras = [(self.has_colours, "colours"), (self.has_normals, "normals")];
        let extras: Vec<_> = extras.iter().filter(|(has, _)| *has).map(|(_, word)| *word).collect();
        let with = if extras.is_empty() { String::new() } else { format!(", with {}", extras.join(" and ")) };
        row("vertices", grouped(self.vertices) + &with);
        row("  welded away", grouped(self.welded_vertices));
        row("  unused", grouped(self.unused_vertices));
        row("texcoords", grouped(self.texcoords));
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let [low, high] = self.bounds.map(|corner| corner[axis]);
            row(&format!("bounds {name}"), format!("{low} to {high}, size {}", rounded(self.size[axis])));
        }
        row("decimals", format!("{} in positions, {} in texcoords", self.decimals[0], self.decimals[1]));
        row("components", grouped(self.topology.components));
        row("charts", grouped(self.topology.charts));
        row("parts", grouped(self.parts));
        let undefined = format!(", {} without definition", grouped(self.undefined_materials));
        row("materials", grouped(self.materials) + if self.undefined_materials > 0 { &undefined } else { "" });
        let unusable = [(self.missing_textures, "missing"), (self.outside_textures, "outside the folder of the MTL")];
        let unusable = unusable.iter().filter(|(count, _)| *count > 0);
        let unusable: String = unusable.map(|(count, words)| format!(", {} {words}", grouped(*count))).collect();
        row("textures", grouped(self.textures) + &unusable);
        let topology = &self.topology;
        row("seam vertices", share(topology.seam_vertices, topology.vertices));
        row("seam edges", share(topology.seam_edges, topology.edges));
        row("boundary edges", share(topology.boundary_edges, topology.edges));
        row("non-manifold edges", grouped(topology.non_manifold_edges));
        if self.faults.is_empty() {
            row("faults", "none".to_owned());
        }
        for (kind, count) in &self.faults {
            let name = kind.replace('_', " ");
            // Names longer than the column are followed by a gap, too.
            let gap = if name.len() < NAME_WIDTH { "" } else { " " };
            row(&(name + gap), grouped(*count));
        }
        for line in warning_lines(&self.warnings, "--json lists them") {
            let _ = writeln!(text, "{line}");
        }
        text
    }
}

/// `12 345 (3.4 %)`.
fn share(count: u64, of: u64) -> String {
    format!("{} ({:.1} %)", grouped(count), 100.0 * count as f64 / of.max(1) as f64)
}

/// A length rounded to a millionth: the difference of two decimals is seldom a decimal itself.
fn rounded(length: f64) -> f64 {
    (length * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    fn inspected(name: &str) -> Inspection {
        let folder = tempfile::tempdir().unwrap();
        let work = folder.path().join("work");
        let options = InspectOptions { work: Some(work.clone()), threads: Some(2), ..InspectOptions::default() };
        let found = inspect(Path::new(name), &options, &Silent).unwrap();
        assert!(!work.exists());
        found
    }

    #[test]
    fn a_closed_sphere_has_no_border_and_twice_as_many_faces_as_vertices_less_four() {
        let found = inspected("fixtures/miniatures/closed_sphere.obj");
        let topology = found.topology;
        assert_eq!((topology.boundary_edges, topology.non_manifold_edges), (0, 0));
        assert_eq!(topology.edges, found.triangles * 3 / 2);
        assert_eq!(topology.vertices * 2 - 4, found.triangles);
    }

    #[test]
    fn a_cube_of_24_vertices_is_closed_after_welding() {
        let found = inspected("fixtures/miniatures/cube_24_vertices.obj");
        assert_eq!((found.vertices, found.welded_vertices, found.topology.boundary_edges), (24, 16, 0));
    }

    #[test]
    fn the_counts_do_not_depend_on_the_clusters() {
        for name in ["town/town.obj", "miniatures/non_manifold_fin.obj", "miniatures/two_materials_plane.obj"] {
            let input = Path::new("fixtures").join(name);
            let whole = inspected(&input.to_string_lossy());
            for cluster_faces in [20, 300] {
                let folder = tempfile::tempdir().unwrap();
                let options = InspectOptions { work: Some(folder.path().to_owned()), ..InspectOptions::default() };
                assert_eq!(inspect_in_clusters(&(&input).into(), &options, cluster_faces, &Silent).unwrap(), whole);
            }
        }
    }

    #[test]
    fn faces_at_one_place_are_counted_block_by_block() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let mut text = String::new();
        (0..100).for_each(|i| text += &format!("v {} {} 0\n", i % 10, i / 10));
        let squares = (0..81).map(|i| i / 9 * 10 + i % 9 + 1);
        squares.for_each(|a| text += &format!("f {a} {} {} {}\n", a + 1, a + 11, a + 10));
        text += &"f 34 35 45\nf 34 56 45\n".repeat(50_000);
        std::fs::write(path("a.obj"), text).unwrap();
        let found = |cluster_faces| {
            let options = InspectOptions { work: Some(path("work")), ..InspectOptions::default() };
            inspect_in_clusters(&path("a.obj").into(), &options, cluster_faces, &Silent).unwrap()
        };
        let whole = found(CLUSTER_FACES_MAX);
        assert_eq!(whole.faults["doubled_faces"], 99_999);
        assert_eq!(found(20), whole);
    }

    #[test]
    fn long_names_have_a_gap_and_long_warnings_are_clipped() {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("a.obj");
        let library = "m".repeat(1000);
        let text = format!("mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/2 3/3\n");
        std::fs::write(&input, text).unwrap();
        let table = inspected(&input.to_string_lossy()).table();
        assert!(table.contains("\ndangling texture coordinates 1\n"), "{table}");
        assert!(table.lines().all(|line| line.chars().count() <= 600), "{table}");
    }

    #[test]
    fn a_texture_outside_of_the_folder_is_not_missing() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir(path("in")).unwrap();
        std::fs::copy("fixtures/miniatures/checker.png", path("wall.png")).unwrap();
        std::fs::copy("fixtures/miniatures/checker.png", path("in/roof.png")).unwrap();
        let names = ["roof.png", "../wall.png", "../gone.png", "gone.png", "C:\\wall.png", "../in"];
        let (mut library, mut text) = (String::new(), "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned());
        for (number, name) in names.iter().enumerate() {
            library += &format!("newmtl m{number}\nmap_Kd {name}\n");
            text += &format!("usemtl m{number}\nf 1 2 3\n");
        }
        std::fs::write(path("in/a.mtl"), library).unwrap();
        std::fs::write(path("in/a.obj"), text).unwrap();
        let found = inspected(&path("in/a.obj").to_string_lossy());
        assert_eq!((found.textures, found.missing_textures, found.outside_textures), (6, 4, 1));
        let table = found.table();
        assert!(table.contains("textures            6, 4 missing, 1 outside the folder of the MTL\n"), "{table}");
        assert!(table.contains("\nmissing texture     4\nrefused texture     1\n"), "{table}");
        assert_eq!(found.warnings.len(), 5, "{:?}", found.warnings);
    }

    #[test]
    fn fins_and_polygons_are_counted() {
        assert_eq!(inspected("fixtures/miniatures/non_manifold_fin.obj").topology.non_manifold_edges, 6);
        let polygons = inspected("fixtures/miniatures/ngons_concave.obj");
        assert_eq!((polygons.larger_polygons, polygons.triangles), (12, 36));
    }
}
