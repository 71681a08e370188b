//! Counts a cluster of a partition, and makes records of what leaves it.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3};

use super::atlas::Chart;
use super::cell::{Countable, Counted, count, shown_key};
use super::counts::{AtVertex, EdgeSide, Joint, MeshCounts};
use super::edges::{EdgeTable, HalfEdge};
use super::id::{OpenBorder, OpenChart, OpenComponent};
use super::seam_edge::{EdgeTexture, SeamEdge};
use crate::base::Result;
use crate::base::id::{TiSlice, TiVec};
use crate::file::record::Verbatim;
use crate::mesh::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::model::Catalogue;
use crate::model::id::{ImageId, MaterialId, PartId};
use crate::partition::ClusterSource;
use crate::partition::id::PartitionVertex;

/// Counts of one cluster, and the records that leave it.
#[derive(Debug)]
pub struct ClusterCounts {
    pub(super) counts: MeshCounts,
    pub(super) sides: Vec<SharedSide>,
    /// Number of components that leave the cluster; sides refer to them from 0.
    pub(super) components: usize,
    /// What the cluster has of charts that leave it.
    pub(super) charts: TiVec<OpenChart, Chart>,
    /// Number of borders that leave the cluster.
    pub(super) borders: usize,
    pub(super) border_ends: Vec<BorderEnd>,
    pub(super) shared_vertices: Vec<(PartitionVertex, AtVertex)>,
    pub(super) border_edges: Vec<[DVec3; 2]>,
    pub(super) seams: Vec<SeamEdge>,
}

/// A side of a face between two shared vertices.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SharedSide {
    /// The lower one first.
    pub(super) vertices: [PartitionVertex; 2],
    /// As in [`EdgeSide`].
    shown: [u64; 2],
    across: [f64; 3],
    pub(super) component: OpenComponent,
    /// Its chart; none for a face without texture.
    pub(super) chart: OpenChart,
    pub(super) texture: EdgeTexture,
    pub(super) length: f32,
    runs_up: u32,
    zero: u32,
}

impl Verbatim for SharedSide {}

impl SharedSide {
    /// The same with the lower id first.
    fn lower_first(self) -> Self {
        let ([a, b], [shown_a, shown_b]) = (self.vertices, self.shown);
        if a < b {
            return self;
        }
        let runs_up = 1 - self.runs_up;
        Self { vertices: [b, a], shown: [shown_b, shown_a], texture: self.texture.reversed(), runs_up, ..self }
    }

    pub(super) fn side(&self) -> EdgeSide {
        EdgeSide {
            shown: self.shown,
            is_textured: self.chart != OpenChart::NONE,
            runs_up: self.runs_up != 0,
            across: self.across.into(),
        }
    }
}

/// A border that leaves its cluster, at a shared vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct BorderEnd {
    /// The vertex.
    pub(super) vertex: PartitionVertex,
    /// The border.
    pub(super) border: OpenBorder,
}

/// A cluster as it is counted.
struct ClusterCell<'a> {
    mesh: &'a ClusterMesh,
    keys: TiVec<Wedge, u64>,
}

impl<'a> ClusterCell<'a> {
    fn new(mesh: &'a ClusterMesh, catalogue: &Catalogue) -> Self {
        let mut keys = mesh.per_wedge(0);
        for (corners, &part) in mesh.corners.iter().zip(&mesh.parts) {
            let material: MaterialId = catalogue.material_of(part);
            for &wedge in corners {
                keys[wedge] = shown_key(mesh.wedge_uv[wedge], material);
            }
        }
        Self { mesh, keys }
    }

    fn wedges(&self, half: HalfEdge<LocalVertex>) -> [Wedge; 2] {
        half.corners(self.faces()).map(|corner| self.mesh.corners[half.face()][corner])
    }
}

impl Countable for ClusterCell<'_> {
    type Vertex = LocalVertex;

    fn positions(&self) -> &TiSlice<LocalVertex, DVec3> {
        &self.mesh.positions
    }

    fn faces(&self) -> &TiSlice<FaceId, [LocalVertex; 3]> {
        &self.mesh.corner_vertices
    }

    fn texcoords(&self, face: FaceId) -> [DVec2; 3] {
        self.mesh.uv_triangle(face)
    }

    fn shown(&self, face: FaceId, corner: usize) -> u64 {
        self.keys[self.mesh.corners[face][corner]]
    }

    fn is_shared(&self, vertex: LocalVertex) -> bool {
        self.mesh.is_shared(vertex)
    }
}

/// Counts a cluster; `images` has the texture image of each part.
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
pub fn count_cluster(
    source: &ClusterSource,
    catalogue: &Catalogue,
    images: &TiSlice<PartId, ImageId>,
) -> Result<ClusterCounts> {
    let mesh = &source.mesh;
    let cell = ClusterCell::new(mesh, catalogue);
    let edges = EdgeTable::new(cell.faces());
    let (mut border_edges, mut seams) = (Vec::new(), Vec::new());
    let length = |half: HalfEdge<LocalVertex>| {
        let [from, to] = half.ends().map(|vertex| mesh.positions[vertex]);
        from.distance(to)
    };
    let texture = |half| EdgeTexture::of(mesh, cell.wedges(half), images[mesh.parts[half.face()]]);
    let counted = count(&cell, &edges, |edge, joint| match (edge, joint) {
        (&[half], _) => border_edges.push(half.ends().map(|vertex| mesh.positions[vertex] + source.origin)),
        (&[a, b], Joint::Seam) => seams.extend(SeamEdge::between(length(a), [a, b].map(texture))),
        _ => {}
    })?;
    let Counted { mut counts, vertices, mut components, mut charts, open_charts, mut borders, on_border } = counted;
    counts.topology.degenerate_faces += source.degenerate;
    let sides = edges.iter().flatten().filter(|&&half| cell.is_open(half)).filter_map(|&half| {
        let side = cell.side(half);
        let shared = SharedSide {
            vertices: half.ends().map(|vertex| source.vertex_id(vertex)),
            shown: side.shown,
            across: side.across.to_array(),
            component: components.open(half.face())?,
            chart: charts.open(half.face()).filter(|_| side.is_textured).unwrap_or(OpenChart::NONE),
            texture: texture(half),
            length: length(half) as f32,
            runs_up: u32::from(side.runs_up),
            zero: 0,
        };
        Some(shared.lower_first())
    });
    let sides = sides.collect();
    let border_end = |&vertex: &LocalVertex| {
        let end = |border| BorderEnd { vertex: source.vertex_id(vertex), border };
        borders.open(vertex).filter(|_| mesh.is_shared(vertex)).map(end)
    };
    let border_ends = on_border.iter().filter_map(border_end).collect();
    let shared = vertices.iter_enumerated().filter(|&(vertex, _)| mesh.is_shared(vertex));
    Ok(ClusterCounts {
        counts,
        sides,
        components: components.count,
        charts: open_charts,
        borders: borders.count,
        border_ends,
        shared_vertices: shared.map(|(vertex, &at)| (source.vertex_id(vertex), at)).collect(),
        border_edges,
        seams,
    })
}
