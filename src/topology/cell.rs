//! Counts one cell: what only it has is counted at once; what it shares with other cells is left open.
//!
//! ```text
//!      own ────── own        every face at an own vertex is in this cell: its edges are counted
//!       │  ╲       │
//!       │    ╲     │
//!   shared ═══ shared        the face on the other side may be in another cell: this edge is left out, and so are the
//!                            components, charts and borders that reach it
//! ```
//! A mesh that shares nothing is a cell, too: then everything is counted.
//!
//! # Memory
//! 100 bytes a face.

use std::ops::Range;

use glam::{DVec2, DVec3};
use xxhash_rust::xxh3::xxh3_64;

use super::atlas::Chart;
use super::counts::{AtVertex, EdgeSide, Joint, MeshCounts};
use super::edges::{EdgeTable, HalfEdge};
use super::id::{OpenBorder, OpenChart, OpenComponent};
use crate::base::Result;
use crate::base::id::{Id, TiSlice, TiVec};
use crate::base::pool::{blocks_until_stopped, check_stopped};
use crate::geometry::triangle::regularity;
use crate::mesh::fold::across;
use crate::mesh::forest::DisjointSets;
use crate::mesh::id::FaceId;
use crate::model::face::repeats_vertex;
use crate::model::id::MaterialId;

/// A mesh, or a part of one, as it is counted. Faces that repeat a vertex are left out.
pub trait Countable {
    /// What numbers its vertices.
    type Vertex: Id;

    /// Position of each vertex, relative to any origin.
    fn positions(&self) -> &TiSlice<Self::Vertex, DVec3>;

    /// Vertices of each face, counter-clockwise.
    fn faces(&self) -> &TiSlice<FaceId, [Self::Vertex; 3]>;

    /// Texture coordinates of a face, NaN where a corner has none.
    fn texcoords(&self, face: FaceId) -> [DVec2; 3];

    /// What a face shows at a corner (0, 1, 2): a [`shown_key`].
    fn shown(&self, face: FaceId, corner: usize) -> u64;

    /// Whether faces of other cells may use a vertex.
    fn is_shared(&self, vertex: Self::Vertex) -> bool;

    /// Position of a vertex.
    fn position(&self, vertex: Self::Vertex) -> DVec3 {
        self.positions().raw[vertex.index()]
    }

    /// The face of a half-edge, seen from its edge.
    fn side(&self, half: HalfEdge<Self::Vertex>) -> EdgeSide {
        let (faces, face) = (self.faces(), half.face());
        let [low, high] = half.ends().map(|end| self.position(end));
        EdgeSide {
            shown: half.corners(faces).map(|corner| self.shown(face, corner)),
            is_textured: is_textured(&self.texcoords(face)),
            runs_up: half.runs_up(faces),
            across: across(high - low, self.position(half.opposite(faces)) - low),
        }
    }

    /// Whether both ends of a half-edge are shared.
    fn is_open(&self, half: HalfEdge<Self::Vertex>) -> bool {
        half.ends().iter().all(|&end| self.is_shared(end))
    }
}

/// Key of a texture coordinate, by value, and of a material; never 0.
pub fn shown_key(texcoord: DVec2, material: MaterialId) -> u64 {
    // 0 and -0 are one value, and so are all that are no number.
    let bits = |x: f64| if x.is_nan() { f64::NAN.to_bits() } else { (x + 0.0).to_bits() };
    let [u, v] = texcoord.to_array().map(bits);
    xxh3_64(bytemuck::cast_slice(&[u, v, material.number().into()])).max(1)
}

/// Whether a face of these texture coordinates is in a chart.
fn is_textured(texcoords: &[DVec2; 3]) -> bool {
    texcoords.iter().all(|uv| uv.is_finite())
}

/// Sets of `I`, of which those that leave the cell have an id `S`.
#[derive(Debug)]
pub struct OpenSets<I, S> {
    sets: DisjointSets<I>,
    /// By root; none for a set that stays in the cell.
    ids: Vec<S>,
    /// How many leave the cell.
    pub count: usize,
}

impl<I: Id, S: Id> OpenSets<I, S> {
    /// Numbers the sets with a leaving member, in the order of these.
    fn new(mut sets: DisjointSets<I>, len: usize, leaving: impl Iterator<Item = I>) -> Self {
        let (mut ids, mut count) = (vec![S::NONE; len], 0);
        for member in leaving {
            let id: &mut S = &mut ids[sets.root(member).index()];
            if *id == S::NONE {
                *id = S::from(count);
                count += 1;
            }
        }
        Self { sets, ids, count }
    }

    /// The set of a member, if it leaves the cell.
    pub fn open(&mut self, member: I) -> Option<S> {
        let root = self.sets.root(member);
        Some(self.id_of_root(root)).filter(|&id| id != S::NONE)
    }

    /// How many of some members are the root of a set that stays in the cell.
    fn count_closed(&self, members: impl Iterator<Item = I>) -> u64 {
        members.filter(|&member| self.sets.is_root(member) && self.id_of_root(member) == S::NONE).count() as u64
    }

    fn id_of_root(&self, root: I) -> S {
        self.ids[root.index()]
    }
}

/// What was counted of a cell, and what leaves it.
pub struct Counted<V> {
    /// What only the cell has.
    pub counts: MeshCounts,
    /// What is known of each vertex; those that are not shared are counted.
    pub vertices: TiVec<V, AtVertex>,
    /// Components.
    pub components: OpenSets<FaceId, OpenComponent>,
    /// Charts.
    pub charts: OpenSets<FaceId, OpenChart>,
    /// What the cell has of the charts that leave it.
    pub(super) open_charts: TiVec<OpenChart, Chart>,
    /// Borders.
    pub borders: OpenSets<V, OpenBorder>,
    /// Vertices of the borders, ascending.
    pub on_border: Vec<V>,
}

/// Counts a cell; `on_edge` hears of each edge that is counted.
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
pub fn count<C: Countable>(
    cell: &C,
    edges: &EdgeTable<C::Vertex>,
    mut on_edge: impl FnMut(&[HalfEdge<C::Vertex>], Joint),
) -> Result<Counted<C::Vertex>> {
    let (faces, vertex_count) = (cell.faces(), cell.positions().len());
    let mut counts = MeshCounts::default();
    let mut vertices: TiVec<C::Vertex, AtVertex> = vec![AtVertex::default(); vertex_count].into();
    for block in blocks_until_stopped(faces.len()) {
        for (face, corners) in sound_faces_in(cell, block?) {
            counts.add_face(regularity(corners.map(|vertex| cell.position(vertex))));
            for (corner, &vertex) in corners.iter().enumerate() {
                vertices.raw[vertex.index()].add_shown(cell.shown(face, corner));
            }
        }
    }
    let mut components = DisjointSets::new(faces.len());
    let mut charts = DisjointSets::new(faces.len());
    let mut borders = DisjointSets::new(vertex_count);
    let mut on_border = Vec::new();
    edges.try_for_each(|edge| {
        edge[1..].iter().for_each(|half| components.join(edge[0].face(), half.face()));
        if cell.is_open(edge[0]) {
            return;
        }
        let ends = edge[0].ends();
        let joint = counts.add_edge(edge.len(), |at| cell.side(edge[at]));
        ends.iter().for_each(|&end| vertices.raw[end.index()].add_edge(edge.len() == 1));
        if edge.len() == 1 {
            borders.join(ends[0], ends[1]);
            on_border.extend(ends);
        }
        if joint == Joint::Chart {
            charts.join(edge[0].face(), edge[1].face());
        }
        on_edge(edge, joint);
    })?;
    vertices.iter_enumerated().filter(|&(vertex, _)| !cell.is_shared(vertex)).for_each(|(_, at)| counts.add_vertex(at));

    check_stopped()?;
    let open_faces = || edges.iter().flatten().filter(|&&half| cell.is_open(half)).map(|half| half.face());
    let textured = |face: &FaceId| is_textured(&cell.texcoords(*face));
    let components = OpenSets::new(components, faces.len(), open_faces());
    let mut charts = OpenSets::new(charts, faces.len(), open_faces().filter(textured));
    check_stopped()?;
    on_border.sort_unstable();
    on_border.dedup();
    let open_ends = on_border.iter().copied().filter(|&vertex| cell.is_shared(vertex));
    let borders = OpenSets::new(borders, vertex_count, open_ends);

    counts.topology.components = components.count_closed(sound_faces(cell).map(|(face, _)| face));
    counts.topology.boundary_loops = borders.count_closed(on_border.iter().copied());
    let open_charts = count_charts(cell, &mut charts, &mut counts)?;
    Ok(Counted { counts, vertices, components, charts, open_charts, borders, on_border })
}

/// Counts the charts that stay in the cell, and returns the parts of the others.
fn count_charts<C: Countable>(
    cell: &C,
    charts: &mut OpenSets<FaceId, OpenChart>,
    counts: &mut MeshCounts,
) -> Result<TiVec<OpenChart, Chart>> {
    let face_count = cell.faces().len();
    let texcoords = |range| sound_faces_in(cell, range).map(|(face, _)| (face, cell.texcoords(face)));
    let mut largest = 0.0f64;
    for block in blocks_until_stopped(face_count) {
        let finite = texcoords(block?).flat_map(|(_, uv)| uv).filter(|uv| uv.is_finite());
        largest = finite.fold(largest, |largest, uv| largest.max(uv.abs().max_element()));
    }
    let textured = |range| texcoords(range).filter(|(_, uv)| is_textured(uv));
    let mut parts: TiVec<FaceId, Chart> = vec![Chart::default(); face_count].into();
    for block in blocks_until_stopped(face_count) {
        textured(block?).for_each(|(face, uv)| parts[charts.sets.root(face)].add_face(uv, largest));
    }
    let mut open = TiVec::from(vec![Chart::default(); charts.count]);
    check_stopped()?;
    for (face, _) in textured(0..face_count).filter(|&(face, _)| charts.sets.is_root(face)) {
        match charts.id_of_root(face).some() {
            Some(chart) => open[chart] = parts[face],
            None => counts.add_chart(&parts[face]),
        }
    }
    Ok(open)
}

fn sound_faces<C: Countable>(cell: &C) -> impl Iterator<Item = (FaceId, [C::Vertex; 3])> {
    sound_faces_in(cell, 0..cell.faces().len())
}

fn sound_faces_in<C: Countable>(cell: &C, range: Range<usize>) -> impl Iterator<Item = (FaceId, [C::Vertex; 3])> {
    let faces = range.clone().zip(&cell.faces().raw[range]).filter(|(_, vertices)| !repeats_vertex(**vertices));
    faces.map(|(face, &vertices)| (FaceId::from(face), vertices))
}
