//! Vertex normals of the result, recomputed with a crease of 60°.
//!
//! ```text
//!        \  f2 |  /            the normal of the corner of f1 at v is the sum of the normals of those faces around
//!      f3 \    | /  f1         v that lie within 60° of the normal of f1, each times the angle of its corner at v
//!          \   |/
//! ----------- v ----------     corners of v with the same rounded normal share one `vn` line
//!          /   |\
//! ```
//! In: pieces with positions. Out: the number of the `vn` line of each corner, and the normals of these lines. The star
//! of a piece's own vertex lies within the piece. That of a shared vertex is gathered from all pieces in advance; the
//! result is stored by vertex and face normal, since it depends on nothing else.
//!
//! # Memory
//! A piece: [`piece_bytes`], about 64 bytes per face and 28 per own vertex. Shared vertices: 12 bytes each, the records
//! of the stars within the memory given to [`SharedNormals::gather`], and 50 bytes per face of the largest star.
//!
//! # Files
//! The normals at shared vertices, 16 bytes per distinct face normal at each of them.

use std::ops::Range;
use std::path::Path;

use bytemuck::Pod;
use glam::DVec3;

use super::grouping::{Group, Grouping};
use crate::base::id::TiVec;
use crate::base::{Error, Result};
use crate::file::{Column, ColumnWriter, Segment};
use crate::model::corners::{FaceReader, PieceCorners};
use crate::model::id::{PieceCorner, PieceVertex, SharedVertex};
use crate::model::{StoredMesh, StoredPiece};

/// Cosine of the crease angle of 60°.
///
/// NOTE: a millionth below 1/2, so that rounding does not separate faces that meet at exactly 60°.
const CREASE_COSINE: f64 = 0.499_999;
/// Cosine of half the crease angle: faces within it of a common direction are within the crease angle of each other.
const HALF_CREASE_COSINE: f64 = 0.866_026;
/// Largest number of faces around a vertex for which every pair is compared.
///
/// NOTE: above it (the centre of a huge fan) a corner across a crease gets the normal of its own face, since comparing
/// all pairs of a million faces would take forever.
const STAR_FACES_MAX: usize = 512;
/// Largest gap in records between two ranges that are mapped together.
const RUN_GAP: u64 = 128;
/// Largest number of records mapped together.
const RUN_RECORDS_MAX: u64 = 64 << 10;

/// A unit normal in units of 1/10 000, as written.
pub(super) type RoundedNormal = [i16; 3];

/// Normal of a corner without any other.
const UP: RoundedNormal = [0, 0, 10_000];

/// A face in the star of a vertex: its unit normal (zero if it has no area), and its angle at the vertex in radians.
#[derive(Debug, Clone, Copy)]
struct StarFace {
    normal: [f32; 3],
    angle: f32,
}

/// Unit normal (zero for a face without area) and the three angles of a face in radians.
fn face_normal(positions: [DVec3; 3]) -> ([f32; 3], [f32; 3]) {
    let [a, b, c] = positions;
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let cross = ab.cross(-ca);
    let length = cross.length();
    if !(length > 0.0 && length.is_finite()) {
        return ([0.0; 3], [0.0; 3]);
    }
    // NOTE: acos of libm, since that of the system differs between platforms in the last bit.
    let angle = |u: DVec3, v: DVec3| libm::acos((u.dot(v) / (u.length() * v.length())).clamp(-1.0, 1.0)) as f32;
    let normal = cross / length;
    ([normal.x as f32, normal.y as f32, normal.z as f32], [angle(ab, -ca), angle(bc, -ab), angle(ca, -bc)])
}

/// A normal as a vector.
pub(super) fn vector(normal: [f32; 3]) -> DVec3 {
    let [x, y, z] = normal.map(f64::from);
    DVec3::new(x, y, z)
}

fn rounded(sum: DVec3) -> Option<RoundedNormal> {
    let length = sum.length();
    let round = |x: f64| (x / length * 10_000.0).round() as i16;
    (length > 1e-12 && length.is_finite()).then(|| [round(sum.x), round(sum.y), round(sum.z)])
}

/// Replaces `out` with the normal of each face's corner at the centre of a star.
fn corner_normals(star: &[StarFace], out: &mut Vec<RoundedNormal>) {
    out.clear();
    let weighted = |face: &StarFace| vector(face.normal) * f64::from(face.angle);
    let sum: DVec3 = star.iter().map(weighted).sum();
    let whole = rounded(sum);
    let mean = sum / sum.length();
    let has_area = |face: &StarFace| face.normal != [0.0; 3];
    // NOTE: the comparison is false for a mean of NaN (opposite faces), which then takes the slow path.
    let near = |face: &StarFace| !has_area(face) || vector(face.normal).dot(mean) > HALF_CREASE_COSINE;
    if star.iter().all(near) {
        out.resize(star.len(), whole.unwrap_or(UP));
        return;
    }
    out.extend(star.iter().map(|face| {
        let normal = vector(face.normal);
        if !has_area(face) {
            return whole.unwrap_or(UP);
        }
        if star.len() > STAR_FACES_MAX {
            return rounded(normal).unwrap_or(UP);
        }
        let within = star.iter().filter(|other| vector(other.normal).dot(normal) >= CREASE_COSINE);
        rounded(within.map(weighted).sum()).or_else(|| rounded(normal)).unwrap_or(UP)
    }));
}

/// Appends the distinct normals of a star to `unique`, and replaces `numbers` with the index of each face's normal in
/// it.
fn number_normals(normals: &[RoundedNormal], unique: &mut Vec<RoundedNormal>, numbers: &mut Vec<u32>) {
    let first = unique.len();
    unique.extend_from_slice(normals);
    unique[first..].sort_unstable();
    let mut kept = first;
    for at in first..unique.len() {
        if at == first || unique[at] != unique[kept - 1] {
            unique[kept] = unique[at];
            kept += 1;
        }
    }
    unique.truncate(kept);
    numbers.clear();
    numbers.extend(normals.iter().map(|n| (first + unique[first..].partition_point(|other| other < n)) as u32));
}

/// Normal and angles of a face of a piece.
pub(super) fn normal_of(piece: &PieceCorners, face: [PieceVertex; 3]) -> ([f32; 3], [f32; 3]) {
    face_normal(face.map(|vertex| piece.position(vertex)))
}

/// Passes the records of ascending ranges to `visit`, range by range; maps nearby ranges together.
fn gather<T: Pod>(
    column: &Segment<T>,
    wanted: impl Iterator<Item = Range<u64>>,
    mut visit: impl FnMut(&[T]),
) -> Result<()> {
    let mut run: Vec<Range<u64>> = Vec::new();
    let mut show = |run: &mut Vec<Range<u64>>| {
        if let (Some(first), Some(last)) = (run.first(), run.last()) {
            let start = first.start;
            let window = column.window(start..last.end)?;
            run.drain(..)
                .for_each(|range| visit(&window[(range.start - start) as usize..(range.end - start) as usize]));
        }
        Ok::<(), Error>(())
    };
    for range in wanted {
        if let (Some(first), Some(last)) = (run.first(), run.last())
            && (range.start - last.end > RUN_GAP || range.end - first.start > RUN_RECORDS_MAX)
        {
            show(&mut run)?;
        }
        run.push(range);
    }
    show(&mut run)
}

/// Normals at the shared vertices.
#[derive(Debug)]
pub(super) struct SharedNormals {
    /// Index of the first answer of each shared vertex, then the number of answers; empty if there is no shared vertex.
    starts: TiVec<SharedVertex, u32>,
    /// Bits of a face normal and number of the `vn` line, sorted within a vertex.
    answers: Option<Column<[u32; 4]>>,
    /// Number of `vn` lines of shared vertices, which come first.
    pub(super) count: u32,
}

impl SharedNormals {
    /// Gathers the stars of all shared vertices, and passes their normals to `visit` in the order of their numbers.
    ///
    /// # Errors
    /// If a file cannot be read or written, and those of `visit`.
    pub(super) fn gather(
        mesh: &StoredMesh,
        corners_per_shared: TiVec<SharedVertex, u64>,
        memory_bytes: u64,
        work_folder: &Path,
        mut visit: impl FnMut(&[RoundedNormal]) -> Result<()>,
    ) -> Result<Self> {
        if corners_per_shared.is_empty() {
            return Ok(Self { starts: TiVec::new(), answers: None, count: 0 });
        }
        let mut starts: TiVec<SharedVertex, u32> = vec![0; corners_per_shared.len() + 1].into();
        // NOTE: a star must come in one part, so the largest one gets its memory even if it exceeds the share.
        let largest_bytes = 16 * corners_per_shared.iter().copied().max().unwrap_or(0);
        let memory_bytes = memory_bytes.max(largest_bytes);
        let mut stars = Grouping::new(corners_per_shared, 4, memory_bytes, &work_folder.join("write-stars.tmp"))?;
        for piece in mesh.pieces.iter().filter(|piece| touches_shared(piece)) {
            let corners = PieceCorners::read(mesh, piece, true)?;
            for &face in &corners.faces {
                let (normal, angles) = normal_of(&corners, face);
                let [x, y, z] = normal.map(f32::to_bits);
                for (vertex, angle) in face.into_iter().zip(angles) {
                    if let Some(shared) = vertex.shared(corners.own) {
                        stars.push(shared, &[x, y, z, angle.to_bits()])?;
                    }
                }
            }
        }
        let path = work_folder.join("write-normals.col");
        let mut answers = ColumnWriter::create(&path, *b"normals ")?;
        let mut count = 0u64;
        let mut scratch = StarScratch::default();
        stars.drain(|groups| {
            for &Group { key: vertex, words } in groups {
                scratch.star.clear();
                scratch.star.extend(words.chunks_exact(4).map(|record| StarFace {
                    normal: [record[0], record[1], record[2]].map(f32::from_bits),
                    angle: f32::from_bits(record[3]),
                }));
                scratch.unique.clear();
                scratch.solve();
                let of_vertex = scratch.star.iter().zip(&scratch.numbers).map(|(face, &number)| {
                    let [x, y, z] = face.normal.map(f32::to_bits);
                    [x, y, z, count as u32 + number]
                });
                scratch.answers.clear();
                scratch.answers.extend(of_vertex);
                scratch.answers.sort_unstable();
                scratch.answers.dedup();
                answers.append(&scratch.answers)?;
                visit(&scratch.unique)?;
                count += scratch.unique.len() as u64;
                if count.max(answers.len()) > u64::from(u32::MAX) {
                    return Err(Error::Limit("the result has more than 2³² normals; leave the normals out".into()));
                }
                starts[vertex.plus(1)] = answers.len() as u32;
            }
            Ok(())
        })?;
        let mut before = 0;
        for start in &mut starts {
            *start = before.max(*start);
            before = *start;
        }
        Ok(Self { starts, answers: Some(answers.finish()?), count: count as u32 })
    }

    /// Returns the answers of `shared` vertices (ascending), and the index of the first answer of each.
    fn of(&self, shared: &[SharedVertex]) -> Result<(Vec<usize>, Vec<[u32; 4]>)> {
        let (mut starts, mut found) = (vec![0], Vec::new());
        if let Some(answers) = &self.answers {
            let range = |&v: &SharedVertex| u64::from(self.starts[v])..u64::from(self.starts[v.plus(1)]);
            gather(answers, shared.iter().map(range), |of_vertex| {
                found.extend_from_slice(of_vertex);
                starts.push(found.len());
            })?;
        }
        Ok((starts, found))
    }
}

impl Drop for SharedNormals {
    fn drop(&mut self) {
        if let Some(answers) = &self.answers {
            let _ = std::fs::remove_file(answers.path());
        }
    }
}

/// Reports whether a face of a piece has a shared vertex.
pub(super) fn touches_shared(piece: &StoredPiece) -> bool {
    piece.faces.blocks().iter().any(|block| u64::from(block.vertices.end.number()) > piece.positions.len())
}

/// Scratch buffers for the star of a vertex.
#[derive(Default)]
struct StarScratch {
    star: Vec<StarFace>,
    normals: Vec<RoundedNormal>,
    unique: Vec<RoundedNormal>,
    numbers: Vec<u32>,
    answers: Vec<[u32; 4]>,
}

impl StarScratch {
    /// Appends the distinct normals of the star to `unique`; stores the index of each face's normal in `numbers`.
    fn solve(&mut self) {
        corner_normals(&self.star, &mut self.normals);
        number_normals(&self.normals, &mut self.unique, &mut self.numbers);
    }
}

/// Normals of a piece.
#[derive(Debug, Default)]
pub(super) struct PieceNormals {
    /// Normals at the own vertices of the piece.
    pub(super) unique: Vec<RoundedNormal>,
    /// Per corner: the number of a normal at a shared vertex, or the number of those plus an index in `unique`.
    pub(super) corners: TiVec<PieceCorner, u32>,
}

/// Memory of [`piece_normals`] in bytes, including its result.
pub(super) fn piece_bytes(piece: &StoredPiece) -> u64 {
    64 * piece.faces.len() + 48 * piece.positions.len() + FaceReader::MEMORY_BYTES
}

/// Computes the normals of a piece.
///
/// # Errors
/// If a file cannot be read.
pub(super) fn piece_normals(mesh: &StoredMesh, piece: &StoredPiece, shared: &SharedNormals) -> Result<PieceNormals> {
    let corners = PieceCorners::read(mesh, piece, false)?;
    let (answer_starts, answers) = shared.of(&corners.shared)?;

    let mut face_normals = Vec::with_capacity(corners.faces.len());
    // Holds the bits of each corner's angle, later the number of its normal.
    let mut numbers: TiVec<PieceCorner, u32> = TiVec::with_capacity(3 * corners.faces.len());
    for &face in &corners.faces {
        let (normal, angles) = normal_of(&corners, face);
        face_normals.push(normal);
        numbers.extend(angles.map(f32::to_bits));
    }

    let stars = OwnStars::new(&corners);
    let mut scratch = StarScratch::default();
    for vertex in PieceVertex::first(corners.own as usize) {
        let star = stars.of(vertex);
        if star.is_empty() {
            continue;
        }
        scratch.star.clear();
        scratch.star.extend(
            star.iter().map(|&corner| StarFace {
                normal: face_normals[corner.face()],
                angle: f32::from_bits(numbers[corner]),
            }),
        );
        scratch.solve();
        for (&corner, &number) in star.iter().zip(&scratch.numbers) {
            numbers[corner] = shared.count + number;
        }
    }
    for (corner, vertex) in vertices_of_corners(&corners) {
        let Some(vertex) = vertex.shared(corners.own) else { continue };
        let at = corners.place(vertex);
        let of_vertex = &answers[answer_starts[at]..answer_starts[at + 1]];
        let [x, y, z] = face_normals[corner.face()].map(f32::to_bits);
        let found = of_vertex.partition_point(|answer| answer[..3] < [x, y, z][..]);
        let Some(answer) = of_vertex.get(found).filter(|answer| answer[..3] == [x, y, z][..]) else {
            let message = "the faces changed while the normals were computed".into();
            return Err(Error::Damaged { path: piece.faces.path().to_owned(), message });
        };
        numbers[corner] = answer[3];
    }
    Ok(PieceNormals { unique: scratch.unique, corners: numbers })
}

/// All corners of a piece with their vertices.
fn vertices_of_corners(piece: &PieceCorners) -> impl Iterator<Item = (PieceCorner, PieceVertex)> {
    let vertices = piece.faces.as_flattened();
    PieceCorner::first(vertices.len()).zip(vertices.iter().copied())
}

/// Corners at each of the own vertices of a piece.
struct OwnStars {
    /// Index of the first corner of each vertex, then the number of corners.
    starts: TiVec<PieceVertex, u32>,
    corners: Vec<PieceCorner>,
}

impl OwnStars {
    fn new(piece: &PieceCorners) -> Self {
        let own_corners = || vertices_of_corners(piece).filter(|(_, vertex)| vertex.shared(piece.own).is_none());
        // The slot after a vertex counts its corners one further on, so that filling moves it to its place.
        let mut starts: TiVec<PieceVertex, u32> = vec![0u32; piece.own as usize + 2].into();
        own_corners().for_each(|(_, vertex)| starts[vertex.plus(2)] += 1);
        let mut end = 0;
        for start in &mut starts {
            end += *start;
            *start = end;
        }
        let mut corners = vec![PieceCorner::default(); end as usize];
        for (corner, vertex) in own_corners() {
            let slot = &mut starts[vertex.plus(1)];
            corners[*slot as usize] = corner;
            *slot += 1;
        }
        starts.pop();
        Self { starts, corners }
    }

    fn of(&self, vertex: PieceVertex) -> &[PieceCorner] {
        &self.corners[self.starts[vertex] as usize..self.starts[vertex.plus(1)] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn star(faces: &[([f32; 3], f32)]) -> Vec<RoundedNormal> {
        let star: Vec<StarFace> = faces.iter().map(|&(normal, angle)| StarFace { normal, angle }).collect();
        let mut out = Vec::new();
        corner_normals(&star, &mut out);
        out
    }

    #[test]
    fn faces_across_a_crease_keep_their_own_normals() {
        let square = std::f32::consts::FRAC_PI_2;
        let cube_corner = [([1.0, 0.0, 0.0], square), ([0.0, 1.0, 0.0], square), ([0.0, 0.0, 1.0], square)];
        assert_eq!(star(&cube_corner), [[10_000, 0, 0], [0, 10_000, 0], [0, 0, 10_000]]);
    }

    #[test]
    fn faces_within_the_crease_share_the_weighted_sum() {
        let (a, b) = ([0.6, 0.0, 0.8], [-0.6, 0.0, 0.8]);
        assert_eq!(star(&[(a, 1.0), ([0.0, 0.0, 1.0], 1.0)]), [[3162, 0, 9487]; 2]);
        // The outer two are 74° apart: each is within 60° of the middle one alone, which is within 60° of both.
        assert_eq!(
            star(&[(a, 1.0), ([0.0, 0.0, 1.0], 1.0), (b, 1.0)]),
            [[3162, 0, 9487], [0, 0, 10_000], [-3162, 0, 9487]]
        );
    }

    #[test]
    fn a_face_without_area_adds_nothing_and_takes_what_is_there() {
        assert_eq!(star(&[([0.0; 3], 0.0)]), [UP]);
        assert_eq!(star(&[([0.0; 3], 0.0), ([1.0, 0.0, 0.0], 0.5)]), [[10_000, 0, 0]; 2]);
        assert_eq!(face_normal([DVec3::ZERO, DVec3::X, DVec3::X * 2.0]), ([0.0; 3], [0.0; 3]));
    }

    #[test]
    fn opposite_faces_do_not_cancel() {
        assert_eq!(star(&[([0.0, 0.0, 1.0], 1.0), ([0.0, 0.0, -1.0], 1.0)]), [[0, 0, 10_000], [0, 0, -10_000]]);
    }

    #[test]
    fn a_huge_star_is_solved_in_linear_time() {
        let faces: Vec<_> = (0..200_000).map(|i| ([if i % 2 == 0 { 1.0 } else { -1.0 }, 0.0, 0.0], 0.1)).collect();
        assert!(star(&faces).chunks(2).all(|pair| pair == [[10_000, 0, 0], [-10_000, 0, 0]]));
    }

    #[test]
    fn angles_of_a_right_triangle() {
        let (normal, angles) = face_normal([DVec3::ZERO, DVec3::X, DVec3::Y]);
        assert_eq!(normal, [0.0, 0.0, 1.0]);
        for (angle, degrees) in angles.into_iter().zip([90f32, 45.0, 45.0]) {
            assert!((angle.to_degrees() - degrees).abs() < 1e-4);
        }
    }

    #[test]
    fn angles_of_any_triangle_are_those_between_its_sides() {
        let [a, b, c] = [DVec3::new(0.2, 0.1, 3.0), DVec3::new(2.0, 0.3, 2.0), DVec3::new(-0.4, 1.0, 1.0)];
        let (normal, angles) = face_normal([a, b, c]);
        assert!(vector(normal).distance((b - a).cross(c - a).normalize()) < 1e-6);
        for (angle, [at, one, other]) in angles.into_iter().zip([[a, b, c], [b, c, a], [c, a, b]]) {
            assert!((f64::from(angle) - (one - at).angle_between(other - at)).abs() < 1e-6);
        }
    }
}
