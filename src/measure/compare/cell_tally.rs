//! Counts one cell: what only it has is counted at once, what it shares becomes records.
//!
//! # Memory
//! 90 bytes a face of the cell.

use glam::DVec3;
use xxhash_rust::xxh3::xxh3_64;

use super::super::forest::DisjointSets;
use super::seams::{EdgeTexture, SeamEdge};
use super::tally_counts::{BorderEnd, Chart, NO_CHART, ON_BORDER, SharedEdges, SharedSide, TallyCounts};
use crate::base::id::TiVec;
use crate::geometry::triangle::{is_flat, regularity};
use crate::measure::figures::SLIVER_REGULARITY;
use crate::mesh::ClusterMesh;
use crate::mesh::fold::across;
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::model::Catalogue;
use crate::partition::ClusterSource;

/// Counts of one cell, and the records that leave it.
#[derive(Debug, Default)]
pub struct CellTally {
    pub(super) counts: TallyCounts,
    pub(super) sides: Vec<SharedSide>,
    /// Number of components that leave the cell; sides refer to them from 0.
    pub(super) pieces: u32,
    /// Charts that leave the cell.
    pub(super) charts: Vec<Chart>,
    /// Number of borders that leave the cell.
    pub(super) borders: u32,
    pub(super) border_ends: Vec<BorderEnd>,
    pub(super) shared_vertices: Vec<SharedEdges>,
    pub(super) border_edges: Vec<[DVec3; 2]>,
    pub(super) seams: Vec<SeamEdge>,
}

/// A side of a face: its vertices, the lower one first, the wedges there, and the face.
type FaceSide = ([LocalVertex; 2], [Wedge; 2], FaceId);

/// Counts a cell; `images` has the texture image of each part.
pub fn tally(source: &ClusterSource, catalogue: &Catalogue, images: &[u32]) -> CellTally {
    let mesh = &source.mesh;
    let mut found = CellTally::default();
    found.counts.topology.faces = mesh.corners.len() as u64;
    found.counts.topology.degenerate_faces = source.degenerate;
    for face in mesh.face_ids() {
        // The regularity is NaN if the sides are too long to be squared.
        let regularity = regularity(mesh.triangle(face)).max(0.0);
        found.counts.regularity_sum += regularity;
        found.counts.slivers += u64::from(regularity < SLIVER_REGULARITY);
    }
    let sides = sorted_sides(mesh);
    let is_shared = |vertices: [LocalVertex; 2]| vertices.iter().all(|&vertex| mesh.is_shared(vertex));
    let is_textured = |face: FaceId| mesh.uv_triangle(face).iter().all(|uv| uv.is_finite());
    let mut pieces = DisjointSets::new(mesh.corners.len());
    let mut charts = DisjointSets::new(mesh.corners.len());
    let mut border = DisjointSets::new(mesh.positions.len());
    let mut on_border = Vec::new();
    let mut edges_at = mesh.per_vertex(0);
    let length = |vertices: [LocalVertex; 2]| {
        let [from, to] = vertices.map(|vertex| mesh.positions[vertex]);
        from.distance(to)
    };
    let texture = |(_, wedges, face): FaceSide| EdgeTexture::of(mesh, wedges, images[mesh.parts[face].index()]);
    for edge in sides.chunk_by(|a, b| a.0 == b.0) {
        let (vertices, wedges, face) = edge[0];
        edge[1..].iter().for_each(|side| pieces.join(face.number(), side.2.number()));
        if is_shared(vertices) {
            continue;
        }
        let is_seam = edge[1..].iter().any(|side| side.1 != wedges);
        found.counts.add_edge(edge.len(), is_seam);
        if let [a, b] = edge {
            found.counts.add_fold([*a, *b].map(|side| across_side(mesh, side)));
        }
        vertices.iter().for_each(|&vertex| edges_at[vertex] += 1);
        match edge {
            [_] => {
                border.join(vertices[0].number(), vertices[1].number());
                vertices.iter().for_each(|&vertex| edges_at[vertex] |= ON_BORDER);
                on_border.extend(vertices);
                found.border_edges.push(vertices.map(|vertex| mesh.positions[vertex] + source.origin));
            }
            [a, b] if !is_seam && is_textured(a.2) && is_textured(b.2) => charts.join(a.2.number(), b.2.number()),
            [a, b] if is_seam => found.seams.extend(SeamEdge::between(length(vertices), [*a, *b].map(texture))),
            _ => {}
        }
    }
    found.count_borders(source, &mut border, on_border);
    let piece_of = found.count_pieces(mesh, &sides, &mut pieces);
    let chart_of = found.count_charts(mesh, &sides, &mut charts);
    let keys = shared_keys(source, catalogue);
    for &side in sides.iter().filter(|side| is_shared(side.0)) {
        let (vertices, wedges, face) = side;
        let chart = if is_textured(face) { chart_of[charts.root(face.number()) as usize] } else { NO_CHART };
        let side = SharedSide {
            vertices: vertices.map(|vertex| source.vertex_id(vertex)),
            keys: wedges.map(|wedge| keys[wedge]),
            across: across_side(mesh, side).to_array(),
            piece: piece_of[pieces.root(face.number()) as usize],
            chart,
            texture: texture(side),
            length: length(vertices) as f32,
        };
        found.sides.push(side.lower_first());
    }
    for (vertex, &edges) in edges_at.iter_enumerated() {
        match mesh.is_shared(vertex) {
            true => found.shared_vertices.push(SharedEdges { vertex: source.vertex_id(vertex), edges }),
            false => found.counts.add_vertex(edges),
        }
    }
    found
}

/// Direction in which the face of a side leads away from it.
fn across_side(mesh: &ClusterMesh, (ends, _, face): FaceSide) -> DVec3 {
    let [low, high] = ends.map(|vertex| mesh.positions[vertex]);
    let third = mesh.vertices(face).into_iter().find(|vertex| !ends.contains(vertex));
    third.map_or(DVec3::ZERO, |third| across(high - low, mesh.positions[third] - low))
}

fn sorted_sides(mesh: &ClusterMesh) -> Vec<FaceSide> {
    let mut sides = Vec::with_capacity(3 * mesh.corners.len());
    for (face, (corners, vertices)) in mesh.face_ids().zip(mesh.corners.iter().zip(&mesh.corner_vertices)) {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = if vertices[from] < vertices[to] { (from, to) } else { (to, from) };
            sides.push(([vertices[from], vertices[to]], [corners[from], corners[to]], face));
        }
    }
    let number = |vertex: LocalVertex| u64::from(vertex.number());
    sides.sort_unstable_by_key(|&([low, high], _, face)| (number(low) << 32 | number(high), face));
    sides
}

/// Key of texture coordinate and material for each wedge at a shared vertex; 0 for other wedges.
fn shared_keys(source: &ClusterSource, catalogue: &Catalogue) -> TiVec<Wedge, u64> {
    let mesh = &source.mesh;
    let mut keys = mesh.per_wedge(0);
    for (corners, &part) in mesh.corners.iter().zip(&mesh.parts) {
        for &wedge in corners.iter().filter(|&&wedge| mesh.is_shared(mesh.wedge_vertex[wedge])) {
            let [u, v] = mesh.wedge_uv[wedge].to_array().map(|x| (x + 0.0).to_bits());
            keys[wedge] = xxh3_64(bytemuck::cast_slice(&[u, v, catalogue.material_of(part).number().into()]));
        }
    }
    keys
}

impl CellTally {
    /// Counts borders that stay in the cell, and numbers those that reach a shared vertex.
    fn count_borders(&mut self, source: &ClusterSource, border: &mut DisjointSets, mut vertices: Vec<LocalVertex>) {
        vertices.sort_unstable();
        vertices.dedup();
        let mut number = vec![u32::MAX; source.mesh.positions.len()];
        for &vertex in vertices.iter().filter(|&&vertex| source.mesh.is_shared(vertex)) {
            let number = &mut number[border.root(vertex.number()) as usize];
            if *number == u32::MAX {
                *number = self.borders;
                self.borders += 1;
            }
            self.border_ends.push(BorderEnd { vertex: source.vertex_id(vertex), border: *number });
        }
        let closed = vertices.iter().filter(|v| border.is_root(v.number()) && number[v.index()] == u32::MAX);
        self.counts.topology.boundary_loops = closed.count() as u64;
    }

    /// Counts components that stay in the cell, and numbers those with a side between shared vertices, by root.
    fn count_pieces(&mut self, mesh: &ClusterMesh, sides: &[FaceSide], pieces: &mut DisjointSets) -> Vec<u32> {
        let mut number = vec![u32::MAX; mesh.corners.len()];
        for (vertices, _, face) in sides {
            let number = &mut number[pieces.root(face.number()) as usize];
            if *number == u32::MAX && vertices.iter().all(|&vertex| mesh.is_shared(vertex)) {
                *number = self.pieces;
                self.pieces += 1;
            }
        }
        let closed = (0..mesh.corners.len()).filter(|&face| pieces.is_root(face as u32) && number[face] == u32::MAX);
        self.counts.topology.components = closed.count() as u64;
        number
    }

    /// Counts charts that stay in the cell, and numbers those with a side between shared vertices, by root.
    fn count_charts(&mut self, mesh: &ClusterMesh, sides: &[FaceSide], charts: &mut DisjointSets) -> Vec<u32> {
        let mut sums = vec![Chart::default(); mesh.corners.len()];
        let mut textured = mesh.per_face(false);
        let finite = mesh.wedge_uv.iter().filter(|uv| uv.is_finite());
        let largest = finite.fold(0.0f64, |largest, uv| largest.max(uv.abs().max_element()));
        for face in mesh.face_ids() {
            let [a, b, c] = mesh.uv_triangle(face);
            if !(a.is_finite() && b.is_finite() && c.is_finite()) {
                continue;
            }
            textured[face] = true;
            let area = (b - a).perp_dot(c - a);
            let longest_sq = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
            if !is_flat(area.abs(), longest_sq, largest) {
                let chart = &mut sums[charts.root(face.number()) as usize];
                chart.area += area;
                chart.positive += u64::from(area > 0.0);
                chart.negative += u64::from(area < 0.0);
            }
        }
        let mut number = vec![u32::MAX; mesh.corners.len()];
        for (vertices, _, face) in sides.iter().filter(|side| textured[side.2]) {
            let root = charts.root(face.number()) as usize;
            if number[root] == u32::MAX && vertices.iter().all(|&vertex| mesh.is_shared(vertex)) {
                number[root] = self.charts.len() as u32;
                self.charts.push(sums[root]);
            }
        }
        let is_closed = |f: &FaceId| textured[*f] && charts.is_root(f.number()) && number[f.index()] == u32::MAX;
        mesh.face_ids().filter(is_closed).for_each(|face| self.counts.add_chart(&sums[face.index()]));
        number
    }
}
