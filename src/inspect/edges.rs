//! Counts edges and seams of clusters, and of the edges and vertices that clusters share.
//!
//! ```text
//!      own ────── own        every face at an own vertex is in this cluster: exact at once
//!       │  ╲       │
//!       │    ╲     │
//!   shared ═══ shared        the face on the other side may be in another cluster: matched at the end
//! ```
//! In: loaded clusters. Out: a [`Tally`]. Invariant: each edge and vertex of the mesh is counted once.
//!
//! # Memory
//! 48 bytes a face while a cluster is counted; the buffers of two files; one bucket of shared edges at a time.
//!
//! # Files
//! `pass-0-edges.buckets` and `pass-0-wedges.buckets`, removed on drop.

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use serde::Serialize;
use xxhash_rust::xxh3::xxh3_64;

use crate::base::Result;
use crate::base::id::TiVec;
use crate::file::buckets::{BucketWriter, Verbatim};
use crate::mesh::id::{LocalVertex, Wedge};
use crate::model::Catalogue;
use crate::partition::ClusterSource;

/// Maximum number of buckets of shared edges.
const BUCKETS_MAX: u64 = 256;

/// Counts of a mesh after welding.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    /// Vertices that faces use.
    pub vertices: u64,
    /// Vertices with several wedges, which differ in texture coordinate or material.
    pub seam_vertices: u64,
    /// Edges.
    pub edges: u64,
    /// Edges of several faces whose texture coordinates or materials differ at an end.
    pub seam_edges: u64,
    /// Edges of one face.
    pub boundary_edges: u64,
    /// Edges of three or more faces.
    pub non_manifold_edges: u64,
}

impl Tally {
    /// Adds the counts of another tally.
    pub fn add(&mut self, other: &Tally) {
        self.vertices += other.vertices;
        self.seam_vertices += other.seam_vertices;
        self.edges += other.edges;
        self.seam_edges += other.seam_edges;
        self.boundary_edges += other.boundary_edges;
        self.non_manifold_edges += other.non_manifold_edges;
    }

    fn add_edge(&mut self, faces: u64, is_seam: bool) {
        self.edges += 1;
        self.seam_edges += u64::from(is_seam);
        self.boundary_edges += u64::from(faces == 1);
        self.non_manifold_edges += u64::from(faces > 2);
    }
}

/// Counts of one cluster.
#[derive(Debug)]
pub struct ClusterTally {
    /// Counts of edges and vertices that only this cluster has.
    pub own: Tally,
    edges: Vec<SharedEdge>,
    wedges: Vec<SharedWedge>,
}

/// The faces of one cluster at an edge between two shared vertices.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SharedEdge {
    /// Ids in the partition, the lower one first.
    vertices: [u32; 2],
    /// Wedges of the first face.
    wedges: [u64; 2],
    faces: u32,
    is_seam: u32,
}

/// A wedge at a shared vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct SharedWedge {
    vertex: u32,
    zero: u32,
    wedge: u64,
}

impl Verbatim for SharedEdge {}
impl Verbatim for SharedWedge {}

/// Counts a cluster.
pub fn tally(source: &ClusterSource, catalogue: &Catalogue) -> ClusterTally {
    let mesh = &source.mesh;
    let mut found = ClusterTally { own: Tally::default(), edges: Vec::new(), wedges: Vec::new() };
    let mut wedge_count = mesh.per_vertex(0u8);
    for &vertex in &mesh.wedge_vertex {
        wedge_count[vertex] = wedge_count[vertex].saturating_add(1);
    }
    for (vertex, &count) in wedge_count.iter_enumerated() {
        if !mesh.is_shared(vertex) {
            found.own.vertices += u64::from(count > 0);
            found.own.seam_vertices += u64::from(count > 1);
        }
    }
    let keys = shared_keys(source, catalogue);
    for (wedge, &key) in keys.iter_enumerated().filter(|(_, key)| **key != 0) {
        let vertex = source.vertex_id(mesh.wedge_vertex[wedge]).number();
        found.wedges.push(SharedWedge { vertex, zero: 0, wedge: key });
    }
    // vertices of the edge, the lower one first, and the wedges there
    let mut edges: Vec<([LocalVertex; 2], [Wedge; 2])> = Vec::with_capacity(3 * mesh.corners.len());
    for corners in &mesh.corners {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = (corners[from], corners[to]);
            let (va, vb) = (mesh.wedge_vertex[a], mesh.wedge_vertex[b]);
            edges.push(if va < vb { ([va, vb], [a, b]) } else { ([vb, va], [b, a]) });
        }
    }
    edges.sort_unstable();
    for faces in edges.chunk_by(|a, b| a.0 == b.0) {
        let (vertices, wedges) = faces[0];
        let is_seam = faces.iter().any(|face| face.1 != wedges);
        if vertices.iter().all(|&vertex| mesh.is_shared(vertex)) {
            found.edges.push(SharedEdge {
                vertices: vertices.map(|vertex| source.vertex_id(vertex).number()),
                wedges: wedges.map(|wedge| keys[wedge]),
                faces: faces.len() as u32,
                is_seam: u32::from(is_seam),
            });
        } else {
            found.own.add_edge(faces.len() as u64, is_seam);
        }
    }
    found
}

/// Key of texture coordinate and material for each wedge at a shared vertex, never 0; 0 for other wedges.
fn shared_keys(source: &ClusterSource, catalogue: &Catalogue) -> TiVec<Wedge, u64> {
    let mesh = &source.mesh;
    let mut keys = mesh.per_wedge(0);
    for (corners, &part) in mesh.corners.iter().zip(&mesh.parts) {
        for &wedge in corners {
            let key = &mut keys[wedge];
            if *key == 0 && mesh.is_shared(mesh.wedge_vertex[wedge]) {
                let [u, v] = mesh.wedge_uv[wedge].to_array().map(f64::to_bits);
                let words = [u, v, catalogue.material_of(part).number().into()];
                *key = xxh3_64(bytemuck::cast_slice(&words)).max(1);
            }
        }
    }
    keys
}

/// Collects shared edges and wedges of clusters, and counts them at the end.
pub struct SharedTallies {
    edges: BucketWriter<SharedEdge>,
    wedges: BucketWriter<SharedWedge>,
    buckets: u64,
}

impl SharedTallies {
    /// Creates the files for a mesh of `faces` faces; a bucket should fit `bucket_bytes`, even if all edges are shared.
    ///
    /// # Errors
    /// If the files cannot be created.
    pub fn create(folder: &Path, faces: u64, bucket_bytes: u64) -> Result<Self> {
        let most_bytes = 3 * faces * size_of::<SharedEdge>() as u64;
        let buckets = most_bytes.div_ceil(bucket_bytes.max(1)).clamp(1, BUCKETS_MAX);
        Ok(Self {
            edges: BucketWriter::create(&folder.join("pass-0-edges.buckets"), buckets as usize)?,
            wedges: BucketWriter::create(&folder.join("pass-0-wedges.buckets"), buckets as usize)?,
            buckets,
        })
    }

    /// Adds the shared edges and wedges of a cluster.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn push(&mut self, cluster: &ClusterTally) -> Result<()> {
        let bucket = |low: u32, high: u32| {
            let mixed = (u64::from(low) << 32 | u64::from(high)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            ((mixed >> 40) % self.buckets) as usize
        };
        for edge in &cluster.edges {
            self.edges.push(bucket(edge.vertices[0], edge.vertices[1]), *edge)?;
        }
        for wedge in &cluster.wedges {
            self.wedges.push(bucket(wedge.vertex, 0), *wedge)?;
        }
        Ok(())
    }

    /// Matches edges and wedges across clusters and counts them.
    ///
    /// # Errors
    /// On failed reads and writes.
    pub fn finish(self) -> Result<Tally> {
        let (edges, wedges) = (self.edges.finish()?, self.wedges.finish()?);
        let mut tally = Tally::default();
        for bucket in 0..self.buckets as usize {
            let mut records: Vec<SharedEdge> = Vec::with_capacity(edges.len(bucket) as usize);
            edges.read(bucket, |read| {
                records.extend_from_slice(read);
                Ok(())
            })?;
            records.sort_unstable_by_key(|edge| edge.vertices);
            for same in records.chunk_by(|a, b| a.vertices == b.vertices) {
                let faces = same.iter().map(|edge| u64::from(edge.faces)).sum();
                let is_seam = same.iter().any(|edge| edge.is_seam != 0 || edge.wedges != same[0].wedges);
                tally.add_edge(faces, is_seam);
            }
        }
        for bucket in 0..self.buckets as usize {
            let mut records: Vec<SharedWedge> = Vec::with_capacity(wedges.len(bucket) as usize);
            wedges.read(bucket, |read| {
                records.extend_from_slice(read);
                Ok(())
            })?;
            records.sort_unstable();
            records.dedup();
            for same in records.chunk_by(|a, b| a.vertex == b.vertex) {
                tally.vertices += 1;
                tally.seam_vertices += u64::from(same.len() > 1);
            }
        }
        Ok(tally)
    }
}
