//! The mesh of a tile: its triangles, joined at their corners.

use std::collections::{HashMap, HashSet};

use foldhash::fast::FixedState;
use glam::{DVec3, IVec3};

use super::cut::{CutLevel, TileTriangle};
use super::lattice::{FLOAT_PLACES_MAX, Lattice};
use super::settings::FACES_OF_STRIP;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::id::ImageId;

/// The mesh of a tile.
#[derive(Debug, Default)]
pub struct TileMesh {
    /// Places of its vertices on the lattice of the level.
    pub places: TiVec<LocalVertex, IVec3>,
    /// Positions of its vertices, relative to the place [`middle`](TileMesh::middle).
    pub positions: TiVec<LocalVertex, DVec3>,
    /// Vertices of each face.
    pub faces: TiVec<FaceId, [LocalVertex; 3]>,
    /// What each face shows.
    pub shown: TiVec<FaceId, FaceTexture>,
    /// Edges along the border of the tile, each in the direction of its face.
    pub border: Vec<BorderEdge>,
    /// The place in the middle of the tile.
    pub middle: IVec3,
}

/// What a face shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceTexture {
    /// The image; none in a level that does not keep its texels.
    pub image: ImageId,
    /// Texture coordinates of its corners.
    pub texcoords: [[f32; 2]; 3],
}

/// An edge along the border of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BorderEdge {
    /// Its face.
    pub face: FaceId,
    /// Its first corner in the face.
    pub corner: usize,
    /// Axis that is normal to the border.
    pub axis: usize,
}

/// A line where the border lies.
struct BorderLine {
    ends: [[i32; 3]; 2],
    axis: usize,
    /// What is shown from the first end to the second and back.
    shown: FaceTexture,
}

impl BorderLine {
    /// That of a triangle which is a line; `Some(None)` if the border lies on both of its sides or on none.
    fn of(triangle: &TileTriangle) -> Option<Option<Self>> {
        let [a, b, c] = triangle.corners;
        if a != b && b != c && c != a {
            return None;
        }
        let sides = (0..3).filter_map(|corner| {
            let ends = [triangle.corners[corner], triangle.corners[(corner + 1) % 3]];
            let axis = (triangle.border >> (2 * corner) & 3).checked_sub(1)? as usize;
            let [mut from, mut to] = [corner, (corner + 1) % 3].map(|corner| triangle.texcoords[corner]);
            if ends[1] < ends[0] {
                (from, to) = (to, from);
            }
            let shown = FaceTexture { image: triangle.image, texcoords: [from, to, from] };
            (ends[0] != ends[1]).then(|| Self { ends: sorted(ends), axis, shown })
        });
        let mut sides: Vec<Self> = sides.collect();
        Some(if sides.len() == 1 { sides.pop() } else { None })
    }
}

/// Without lines that two sides of the border share: nothing of the tile is between them.
fn without_pairs(mut lines: Vec<BorderLine>) -> Vec<BorderLine> {
    lines.sort_by_key(|line| (line.ends, line.axis));
    let mut single: Vec<BorderLine> = Vec::new();
    for line in lines {
        match single.last() {
            Some(last) if last.ends == line.ends => _ = single.pop(),
            _ => single.push(line),
        }
    }
    single
}

fn sorted([a, b]: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
    [a.min(b), a.max(b)]
}

impl TileMesh {
    /// Reads the tile at an index from the triangles of its level, and joins them.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn read(triangles: &CutLevel, index: usize, lattice: Lattice) -> Result<Self> {
        let mut own = Vec::with_capacity(triangles.len(index) as usize);
        triangles.read(index, |block| {
            own.extend_from_slice(block);
            Ok(())
        })?;
        Ok(Self::join(&own, lattice))
    }

    /// Joins the triangles of a tile.
    pub fn join(triangles: &[TileTriangle], lattice: Lattice) -> Self {
        let mut mesh = Self::default();
        let mut known: HashMap<[i32; 3], LocalVertex, FixedState> =
            HashMap::with_capacity_and_hasher(triangles.len(), FixedState::default());
        let mut lines = Vec::new();
        for triangle in triangles {
            if let Some(line) = BorderLine::of(triangle) {
                lines.extend(line);
                continue;
            }
            let vertices = triangle.corners.map(|corner| {
                *known.entry(corner).or_insert_with(|| mesh.places.push_and_get_key(IVec3::from(corner)))
            });
            let face = mesh.faces.push_and_get_key(vertices);
            mesh.shown.push(FaceTexture { image: triangle.image, texcoords: triangle.texcoords });
            mesh.border.extend((0..3).filter_map(|corner| {
                let axis = (triangle.border >> (2 * corner) & 3).checked_sub(1)? as usize;
                Some(BorderEdge { face, corner, axis })
            }));
        }
        mesh.mark(&without_pairs(lines));
        let [low, high] = mesh.extent();
        mesh.middle = low + (high - low) / 2;
        let middle = mesh.middle;
        mesh.positions = mesh.places.iter().map(|&place| lattice.position(place - middle)).collect();
        mesh
    }

    /// Marks the edges where the border lies, because what was between them and the border is thinner than the lattice.
    fn mark(&mut self, lines: &[BorderLine]) {
        if lines.is_empty() {
            return;
        }
        // Edges that lie on a line: few, so those between other vertices are not looked up.
        let mut edges: HashMap<[[i32; 3]; 2], Vec<(FaceId, usize)>, FixedState> =
            lines.iter().map(|line| (line.ends, Vec::new())).collect();
        let places: HashSet<[i32; 3], FixedState> = lines.iter().flat_map(|line| line.ends).collect();
        let are_ends: TiVec<LocalVertex, bool> =
            self.places.iter().map(|place| places.contains(&place.to_array())).collect();
        for (face, vertices) in self.faces.iter_enumerated() {
            for corner in 0..3 {
                let ends = [vertices[corner], vertices[(corner + 1) % 3]];
                if ends.iter().all(|&end| are_ends[end]) {
                    let own = edges.get_mut(&sorted(ends.map(|vertex| self.places[vertex].to_array())));
                    own.into_iter().for_each(|edges| edges.push((face, corner)));
                }
            }
        }
        let mut are_marked: HashSet<(FaceId, usize), FixedState> =
            self.border.iter().map(|edge| (edge.face, edge.corner)).collect();
        for line in lines {
            let free = edges.get(&line.ends).and_then(|edges| edges.iter().find(|edge| !are_marked.contains(edge)));
            let (face, corner) = match free {
                Some(&edge) => edge,
                None => (self.add_line(line), 0),
            };
            are_marked.insert((face, corner));
            self.border.push(BorderEdge { face, corner, axis: line.axis });
        }
    }

    /// Triangles, those of its skirt included.
    pub fn faces_with_skirt(&self) -> u64 {
        self.faces.len() as u64 + FACES_OF_STRIP * self.border.len() as u64
    }

    /// Whether some vertices lie farther from the middle than floats can count.
    pub fn is_wide(&self) -> bool {
        let [low, high] = self.extent();
        (self.middle - low).max(high - self.middle).max_element() > FLOAT_PLACES_MAX
    }

    /// Adds a face without area whose first edge is a line.
    fn add_line(&mut self, line: &BorderLine) -> FaceId {
        let [start, end] = line.ends.map(IVec3::from);
        let vertices = [start, end, start].map(|place| self.places.push_and_get_key(place));
        self.shown.push(line.shown);
        self.faces.push_and_get_key(vertices)
    }

    /// The lowest and the highest places.
    pub fn extent(&self) -> [IVec3; 2] {
        let low = self.places.iter().copied().reduce(IVec3::min).unwrap_or_default();
        [low, self.places.iter().copied().reduce(IVec3::max).unwrap_or_default()]
    }

    /// Ends of an edge of the border.
    pub fn ends(&self, edge: BorderEdge) -> [LocalVertex; 2] {
        [edge.corner, (edge.corner + 1) % 3].map(|corner| self.faces[edge.face][corner])
    }

    /// Corners of a face.
    pub fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.faces[face].map(|vertex| self.positions[vertex])
    }
}
