//! Loads a cluster for simplification.
//!
//! # Memory
//! While loading: 32 bytes per face of the bucket and 8 to 12 bytes per texcoord, in addition to the mesh. Afterwards:
//! 4 bytes per vertex and 20 bytes per wedge, to map them back to the partition.

use glam::{DVec2, DVec3};

use super::Partition;
use super::id::{ClusterId, ClusterTexcoord, PartitionVertex};
use super::ranks::SortedIds;
use super::reading::{ClusterFaces, read};
use super::texture_scale::TextureScale;
use super::wedges::WedgeBuilder;
use crate::base::Result;
use crate::base::id::{TiSlice, TiVec};
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::mesh::split::EdgePoint;
use crate::model::id::Texcoord;
use crate::model::{Catalogue, Face, StoredMesh};

/// A loaded cluster, with the origin of its vertices and wedges in the partition.
#[derive(Debug)]
pub struct ClusterSource {
    /// The mesh, relative to `origin`.
    pub mesh: ClusterMesh,
    /// Position of the mesh's origin in space.
    pub origin: DVec3,
    /// Triangles of triangulated polygons that were dropped because they repeat a vertex.
    pub degenerate: u64,
    /// Faces dropped because an earlier face has the same vertices.
    pub doubles: u64,
    /// The loaded vertices in the partition.
    pub(super) vertex_ids: TiVec<LocalVertex, PartitionVertex>,
    /// Texture coordinate of each wedge, or none.
    pub(super) wedge_texcoord: TiVec<Wedge, ClusterTexcoord>,
    pub(super) texcoords: TiVec<ClusterTexcoord, DVec2>,
    /// Vertices inserted into edges; they follow the loaded ones.
    pub(super) points: Vec<EdgePoint>,
}

/// Loads a cluster.
///
/// # Errors
/// On failed reads and damaged files.
pub fn load(
    partition: &Partition,
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    scale: &TextureScale,
    cluster: ClusterId,
) -> Result<ClusterSource> {
    Ok(read(partition, mesh, cluster)?.into_source(partition, catalogue, scale))
}

impl ClusterFaces {
    /// Builds the mesh of the faces of a cluster; vertices that other clusters share are locked.
    pub fn into_source(self, partition: &Partition, catalogue: &Catalogue, scale: &TextureScale) -> ClusterSource {
        let are_shared: Vec<bool> = partition.faces.shared.contains_each(&self.vertex_ids.raw).collect();
        self.build(are_shared, catalogue, scale)
    }

    /// Builds the mesh of faces that are a whole mesh.
    pub fn into_whole(self, catalogue: &Catalogue, scale: &TextureScale) -> ClusterSource {
        let are_shared = vec![false; self.vertex_ids.len()];
        self.build(are_shared, catalogue, scale)
    }

    fn build(
        self,
        are_shared: impl IntoIterator<Item = bool>,
        catalogue: &Catalogue,
        scale: &TextureScale,
    ) -> ClusterSource {
        let Self { faces, positions, degenerate, doubles, vertex_ids, texcoord_ids, texcoords } = self;
        let origin = positions.first().copied().unwrap_or(DVec3::ZERO);
        let mesh = ClusterMesh::default();
        let wedge_texcoord = TiVec::new();
        let points = Vec::new();
        let mut source =
            ClusterSource { mesh, origin, degenerate, doubles, vertex_ids, wedge_texcoord, texcoords, points };
        source.mesh.positions.reserve_exact(positions.len());
        source.mesh.flags.reserve_exact(positions.len());
        for (&position, shared) in positions.iter().zip(are_shared) {
            source.mesh.push_vertex(position - origin, if shared { flag::SHARED | flag::LOCKED } else { 0 });
        }
        source.add_faces(&faces, &texcoord_ids, catalogue, scale);
        source
    }
}

impl ClusterSource {
    /// The vertices that were loaded, in the partition, ascending.
    pub fn loaded_vertices(&self) -> &[PartitionVertex] {
        &self.vertex_ids.raw
    }

    fn add_faces(
        &mut self,
        faces: &TiSlice<FaceId, Face<LocalVertex>>,
        texcoord_ids: &TiSlice<ClusterTexcoord, Texcoord>,
        catalogue: &Catalogue,
        scale: &TextureScale,
    ) {
        let ranks = SortedIds::new(texcoord_ids);
        let mut wedges = WedgeBuilder::new(&mut self.mesh, &self.texcoords);
        let mut corners = TiVec::with_capacity(faces.len());
        for faces in faces.raw.chunk_by(|a, b| a.part == b.part) {
            let part = faces[0].part;
            let (material, scale) = (catalogue.material_of(part), scale.of(catalogue, part));
            for face in faces {
                let mut of_face = [Wedge::NONE; 3];
                // By index: iterators over whole arrays would copy them.
                for (k, corner) in of_face.iter_mut().enumerate() {
                    let texcoord = face.texcoords[k].some().map_or(ClusterTexcoord::NONE, |id| ranks.of(id));
                    *corner = wedges.wedge(face.vertices[k], texcoord, material, scale);
                }
                corners.push(of_face);
            }
        }
        self.wedge_texcoord = wedges.texcoord_of;
        let mesh = &mut self.mesh;
        mesh.corners = corners;
        mesh.corner_vertices = faces.iter().map(|face| face.vertices).collect();
        mesh.parts = faces.iter().map(|face| face.part).collect();
        mesh.deviations = faces.iter().map(|face| face.deviation).collect();
        mesh.is_turned = vec![false; faces.len()].into();
        mesh.face_count = faces.len();
        mesh.link_wedges();
    }

    /// The loaded vertices in the partition.
    pub fn vertex_ids(&self) -> &TiSlice<LocalVertex, PartitionVertex> {
        &self.vertex_ids
    }

    /// Texture coordinate of each wedge, or none.
    pub fn wedge_texcoords(&self) -> &TiSlice<Wedge, ClusterTexcoord> {
        &self.wedge_texcoord
    }

    /// Registers vertices that were inserted into edges between loaded ones, in their order.
    pub fn adopt(&mut self, points: Vec<EdgePoint>) {
        self.points = points;
    }

    /// A loaded vertex in the partition.
    pub fn vertex_id(&self, vertex: LocalVertex) -> PartitionVertex {
        self.vertex_ids[vertex]
    }
}
