//! Numbers the vertices of a GLB: one for each vertex, texture coordinate and primitive that meet at a corner.
//!
//! In: the faces of a stored mesh, in windows. Out: vertices and faces, numbered within their primitive, in order.
//! Invariant: a vertex is numbered once, but one on the border of two windows of a piece in each of them.
//!
//! # Memory
//! 100 bytes for each face of a window, of [`WINDOW_FACES`]; 28 bytes for each shared vertex.

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::primitives::{PrimitiveId, Primitives};
use crate::base::Result;
use crate::base::id::{Id, TiVec};
use crate::file::PackedColumn;
use crate::file::column::Segment;
use crate::model::corners::FaceReader;
use crate::model::face::Face;
use crate::model::id::{PieceTexcoord, PieceVertex, SharedVertex};
use crate::model::{StoredMesh, StoredPiece};
use crate::write::vertex_normals::{own_normals, shared_normals};

/// Faces whose corners are numbered together.
const WINDOW_FACES: usize = 1 << 16;

/// A vertex of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct GlbVertex {
    /// Position relative to the origin of the file.
    pub position: Vec3,
    /// Unit normal, or zero if there are none.
    pub normal: Vec3,
    /// Texture coordinate, with (0, 0) at the upper left of the image.
    pub texcoord: Vec2,
    /// Colour as the input has it, if there is one.
    pub colour: Option<[f32; 3]>,
}

/// Receives vertices and faces, numbered within their primitive.
pub(super) trait TakeCorners {
    /// The next vertex of a primitive.
    ///
    /// # Errors
    /// If it cannot be stored.
    fn vertex(&mut self, primitive: PrimitiveId, vertex: &GlbVertex) -> Result<()>;

    /// The next face of a primitive.
    ///
    /// # Errors
    /// As [`vertex`](TakeCorners::vertex).
    fn face(&mut self, primitive: PrimitiveId, vertices: [u32; 3]) -> Result<()>;
}

/// A sweep over all corners.
pub(super) struct CornerSweep<'a> {
    mesh: &'a StoredMesh,
    primitives: &'a Primitives,
    origin: DVec3,
    has_normals: bool,
    /// Number of vertices of each primitive so far.
    counts: TiVec<PrimitiveId, u32>,
    /// Numbers of the shared vertices.
    shared: CornerNumbers,
    shared_normals: Vec<DVec3>,
    /// Count of numbers that are written as 0.
    pub non_finite: u64,
}

impl<'a> CornerSweep<'a> {
    /// Prepares a sweep; positions are relative to `origin`.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn new(mesh: &'a StoredMesh, primitives: &'a Primitives, origin: DVec3, has_normals: bool) -> Result<Self> {
        Ok(Self {
            mesh,
            primitives,
            origin,
            has_normals,
            counts: vec![0; primitives.list.len()].into(),
            shared: CornerNumbers::new(mesh.shared_count() as usize),
            shared_normals: if has_normals { shared_normals(mesh)? } else { Vec::new() },
            non_finite: 0,
        })
    }

    /// Passes all vertices and faces on.
    ///
    /// # Errors
    /// If a file cannot be read, and those of `take`.
    pub fn run(&mut self, take: &mut dyn TakeCorners) -> Result<()> {
        let mut reader = FaceReader::default();
        let mut faces = Vec::new();
        for piece in &self.mesh.pieces {
            let normals = if self.has_normals { own_normals(self.mesh, piece)? } else { Vec::new() };
            reader.each_block(piece, |block| {
                faces.extend_from_slice(block);
                if faces.len() < WINDOW_FACES {
                    return Ok(());
                }
                self.number(&Window::load(self.mesh, piece, &faces, &normals)?, take)?;
                faces.clear();
                Ok(())
            })?;
            self.number(&Window::load(self.mesh, piece, &faces, &normals)?, take)?;
            faces.clear();
        }
        Ok(())
    }

    /// Numbers the corners of a window.
    fn number(&mut self, window: &Window<'_>, take: &mut dyn TakeCorners) -> Result<()> {
        let mut own = CornerNumbers::new(window.own.ids.len());
        for face in window.faces {
            let has_texcoords = face.texcoords.iter().all(|&texcoord| texcoord != PieceTexcoord::NONE);
            let id = self.primitives.find(face.part, has_texcoords);
            let primitive = self.primitives.list[id];
            let mut numbers = [0; 3];
            for (number, (vertex, texcoord)) in numbers.iter_mut().zip(face.vertices.into_iter().zip(face.texcoords)) {
                let mut at = Vec2::ZERO;
                if primitive.image.is_some() {
                    let uv = window.texcoord(texcoord);
                    let uv = primitive.placement.map_or(uv, |placement| placement.place(uv));
                    at = self.finite(DVec2::new(uv.x, 1.0 - uv.y).as_vec2().extend(0.0)).truncate();
                }
                let shared = vertex.shared(window.own_count);
                let (known, place) = match shared {
                    Some(shared) => (&mut self.shared, shared.index()),
                    None => (&mut own, window.own.place(vertex)),
                };
                let corner = (id, [at.x.to_bits(), at.y.to_bits()]);
                *number = match known.find(place, corner) {
                    Some(number) => number,
                    None => {
                        let next = self.counts[id];
                        known.add(place, corner, next);
                        self.counts[id] += 1;
                        let vertex = self.vertex(window, vertex, at);
                        take.vertex(id, &vertex)?;
                        next
                    }
                };
            }
            take.face(id, numbers)?;
        }
        Ok(())
    }

    fn vertex(&mut self, window: &Window<'_>, vertex: PieceVertex, texcoord: Vec2) -> GlbVertex {
        let (position, colour, normal) = match vertex.shared(window.own_count) {
            Some(shared) => {
                let place = window.shared.place(shared);
                (
                    window.shared.positions[place],
                    window.shared.colour(place),
                    self.shared_normals.get(shared.index()).copied(),
                )
            }
            None => {
                let place = window.own.place(vertex);
                (window.own.positions[place], window.own.colour(place), window.normals.get(vertex.index()).copied())
            }
        };
        let position = self.finite((position - self.origin).as_vec3());
        GlbVertex { position, normal: normal.map_or(Vec3::ZERO, |normal| normal.as_vec3()), texcoord, colour }
    }

    /// Numbers that a float cannot hold become 0.
    fn finite(&mut self, numbers: Vec3) -> Vec3 {
        if numbers.is_finite() {
            return numbers;
        }
        let is_finite = numbers.is_finite_mask();
        self.non_finite += u64::from((!is_finite).bitmask().count_ones());
        Vec3::select(is_finite, numbers, Vec3::ZERO)
    }
}

/// Faces of a piece that are numbered together, and what their corners have.
struct Window<'a> {
    faces: &'a [Face<PieceVertex>],
    /// Number of own vertices of the piece.
    own_count: u32,
    own: WindowVertices<PieceVertex>,
    shared: WindowVertices<SharedVertex>,
    texcoord_ids: Vec<PieceTexcoord>,
    texcoords: Vec<DVec2>,
    /// Normals of all own vertices of the piece.
    normals: &'a [DVec3],
}

/// Vertices of a window, ascending.
struct WindowVertices<V> {
    ids: Vec<V>,
    positions: Vec<DVec3>,
    /// Colours, NaN where there is none; empty if the mesh has none.
    colours: Vec<[f32; 3]>,
}

impl<V: Id> WindowVertices<V> {
    fn load(
        mut ids: Vec<V>,
        positions: Option<&PackedColumn<DVec3>>,
        colours: Option<&Segment<[f32; 3]>>,
    ) -> Result<Self> {
        ids.sort_unstable();
        ids.dedup();
        let positions = positions.map_or(Ok(Vec::new()), |column| column.gather(&ids))?;
        let (Some(first), Some(last), Some(colours)) = (ids.first(), ids.last(), colours) else {
            return Ok(Self { ids, positions, colours: Vec::new() });
        };
        let colours = colours.window(u64::from(first.number())..u64::from(last.number()) + 1)?;
        let colours = ids.iter().map(|id| colours[id.index() - first.index()]).collect();
        Ok(Self { ids, positions, colours })
    }

    /// Place of a vertex that occurs.
    #[inline]
    fn place(&self, vertex: V) -> usize {
        self.ids.partition_point(|&other| other < vertex)
    }

    fn colour(&self, place: usize) -> Option<[f32; 3]> {
        self.colours.get(place).copied().filter(|colour| !colour.iter().any(|channel| channel.is_nan()))
    }
}

impl<'a> Window<'a> {
    fn load(
        mesh: &StoredMesh,
        piece: &StoredPiece,
        faces: &'a [Face<PieceVertex>],
        normals: &'a [DVec3],
    ) -> Result<Self> {
        let own_count = piece.positions.len() as u32;
        let vertices = || faces.iter().flat_map(|face| face.vertices);
        let own = vertices().filter(|vertex| vertex.shared(own_count).is_none()).collect();
        let shared = vertices().filter_map(|vertex| vertex.shared(own_count)).collect();
        let mut texcoord_ids: Vec<PieceTexcoord> = faces.iter().flat_map(|face| face.named_texcoords()).collect();
        texcoord_ids.sort_unstable();
        texcoord_ids.dedup();
        Ok(Self {
            faces,
            own_count,
            own: WindowVertices::load(own, Some(&piece.positions), piece.colours.as_ref())?,
            shared: WindowVertices::load(shared, mesh.shared_positions.as_ref(), mesh.shared_colours.as_ref())?,
            texcoords: piece.texcoords.gather(&texcoord_ids)?,
            texcoord_ids,
            normals,
        })
    }

    /// A texture coordinate that occurs.
    fn texcoord(&self, id: PieceTexcoord) -> DVec2 {
        self.texcoords[self.texcoord_ids.partition_point(|&other| other < id)]
    }
}

/// A primitive and the bits of a texture coordinate.
type GlbCorner = (PrimitiveId, [u32; 2]);

/// Numbers that the corners at some vertices have.
struct CornerNumbers {
    /// Index of the newest entry of each vertex, or [`NO_ENTRY`].
    newest: Vec<u32>,
    /// A corner, its number, and the index of the entry of the same vertex before it.
    entries: Vec<(GlbCorner, u32, u32)>,
}

/// Index of no entry.
const NO_ENTRY: u32 = u32::MAX;

impl CornerNumbers {
    fn new(vertices: usize) -> Self {
        Self { newest: vec![NO_ENTRY; vertices], entries: Vec::new() }
    }

    #[inline]
    fn find(&self, vertex: usize, corner: GlbCorner) -> Option<u32> {
        let mut at = self.newest[vertex];
        while at != NO_ENTRY {
            let (known, number, before) = self.entries[at as usize];
            if known == corner {
                return Some(number);
            }
            at = before;
        }
        None
    }

    fn add(&mut self, vertex: usize, corner: GlbCorner, number: u32) {
        let at = self.entries.len() as u32;
        self.entries.push((corner, number, std::mem::replace(&mut self.newest[vertex], at)));
    }
}
