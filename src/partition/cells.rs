//! Plans the cells of a partition: a kd-tree whose split planes follow the vertices.
//!
//! Vertices are counted in a histogram on a dense grid. The grid is split until no part holds more vertices than a cell
//! should. A split plane may move by up to a tenth of the vertices to where few of them lie (along a street, not
//! through a wall). A part that is too full and no wider than a grid cell gets a finer grid.

use glam::DVec3;

use super::id::ClusterId;
use super::options::PartitionOptions;
use super::weight::{ClusterWeight, ORDINARY_BYTES, limit_bytes};
use crate::base::Result;
use crate::base::id::{TiVec, ids};
use crate::base::ordered::map_in_order;
use crate::file::PackedColumn;
use crate::model::StoredMesh;

/// Grid cells along each axis: for the whole mesh, and for a part that is refined.
const GRID_SIDES: [usize; 2] = [128, 32];
/// Largest number of parts refined in one sweep over the vertices.
const PARTS_PER_SWEEP: usize = 64;
/// Largest number of refinements of a part. Each divides its extent by 32; together they divide 10³⁸, the largest
/// coordinate, by more than 10⁴⁵.
const REFINEMENTS_MAX: usize = 30;
/// Largest distance of a plane from its wanted position, as a share of the vertices of the part it splits.
const PLANE_PLAY: f64 = 0.1;
/// Share of the vertices below the first planes, by pass modulo 3. They differ so that no plane of one pass returns in
/// the next.
const FIRST_SHARES: [f64; 3] = [1.0 / 2.0, 1.0 / 3.0, 2.0 / 3.0];
/// Levels of the tree that use the first shares; deeper parts are split evenly.
const SHIFTED_LEVELS: usize = 3;
/// Bytes per face up to which cells get the number of faces asked for; in a triangle soup they get fewer.
const PLAIN_FACE_BYTES: f64 = 1.5 * ORDINARY_BYTES as f64;
/// Positions read at once by a sweep.
const SWEEP_RECORDS: u64 = 128 << 10;

ids! {
    /// A node of the tree of cells.
    NodeId;
}

const ROOT: NodeId = NodeId::new(0);
/// A leaf before the leaves are numbered.
const LEAF: Node = Node::Leaf { cell: ClusterId::new(0) };

/// A kd-tree of cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Cells {
    nodes: TiVec<NodeId, Node>,
    count: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Node {
    /// Positions with `p[axis] < plane` go to the node `below`, others to the one after it.
    Split {
        axis: usize,
        plane: f64,
        below: NodeId,
    },
    Leaf {
        cell: ClusterId,
    },
}

impl Cells {
    /// Number of cells.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Cell that contains a position.
    #[inline]
    pub fn of(&self, position: DVec3) -> ClusterId {
        let mut at = ROOT;
        loop {
            match self.nodes[at] {
                Node::Split { axis, plane, below } => at = below.plus(u32::from(position[axis] >= plane)),
                Node::Leaf { cell } => return cell,
            }
        }
    }

    /// Leaf that contains a position.
    fn leaf_of(&self, position: DVec3) -> NodeId {
        let mut at = ROOT;
        while let Node::Split { axis, plane, below } = self.nodes[at] {
            at = below.plus(u32::from(position[axis] >= plane));
        }
        at
    }

    /// Numbers the leaves in depth-first order, lower side first.
    fn number_leaves(&mut self) {
        let mut count = 0;
        let mut stack = vec![ROOT];
        while let Some(at) = stack.pop() {
            match &mut self.nodes[at] {
                Node::Leaf { cell } => {
                    *cell = ClusterId::from(count);
                    count += 1;
                }
                Node::Split { below, .. } => stack.extend([below.plus(1), *below]),
            }
        }
        self.count = count;
    }
}

/// A grid over a box, with a count of vertices per grid cell.
struct VertexGrid {
    node: NodeId,
    level: usize,
    low: DVec3,
    step: DVec3,
    side: usize,
    /// Empty before the vertices are counted.
    counts: Vec<u32>,
}

impl VertexGrid {
    fn new(node: NodeId, level: usize, low: DVec3, high: DVec3, side: usize) -> Self {
        let step = ((high - low) / side as f64).max(DVec3::splat(f64::MIN_POSITIVE));
        Self { node, level, low, step, side, counts: Vec::new() }
    }

    #[inline]
    fn index(&self, position: DVec3) -> usize {
        let last = (self.side - 1) as f64;
        // The conversion cuts off fractions.
        let cell = ((position - self.low) / self.step).clamp(DVec3::ZERO, DVec3::splat(last));
        (cell.z as usize * self.side + cell.y as usize) * self.side + cell.x as usize
    }

    /// A zero for each grid cell.
    fn zeros(&self) -> Vec<u32> {
        vec![0; self.side * self.side * self.side]
    }

    /// Returns the grid cells with vertices, usually few, and clears the counts.
    fn take_filled(&mut self) -> Vec<Filled> {
        let counts = std::mem::take(&mut self.counts);
        let at = |i: usize| [i % self.side, i / self.side % self.side, i / self.side / self.side].map(|n| n as u8);
        let filled = counts.iter().enumerate().filter(|(_, count)| **count > 0);
        filled.map(|(i, &count)| Filled { at: at(i), count }).collect()
    }

    /// Coordinate of grid plane `index` along an axis.
    fn plane(&self, axis: usize, index: usize) -> f64 {
        self.low[axis] + self.step[axis] * index as f64
    }
}

/// Where a vertex lies in the grids of some parts.
#[derive(Debug, Clone, Copy)]
struct GridHit {
    /// Index of the part.
    part: u8,
    /// Index of the cell in its grid.
    cell: u32,
}

/// A grid cell that contains vertices.
#[derive(Debug, Clone, Copy)]
struct Filled {
    at: [u8; 3],
    count: u32,
}

/// A range of grid cells: `low` is inclusive, `high` exclusive.
#[derive(Debug, Clone, Copy)]
struct GridBox {
    low: [usize; 3],
    high: [usize; 3],
}

/// Plans the cells for a mesh.
///
/// # Errors
/// On failed reads.
pub fn plan(mesh: &StoredMesh, options: &PartitionOptions) -> Result<Cells> {
    let vertices = mesh.vertex_count();
    let mut cells = Cells { nodes: vec![LEAF].into(), count: 1 };
    let (faces, weight) = (mesh.face_count(), weight_of(mesh).bytes());
    if fits_one(mesh, options.cluster_faces) || faces == 0 || vertices <= 4 {
        return Ok(cells);
    }
    // Vertices in a cell of `cluster_faces` faces, if both are distributed alike.
    let per_face = vertices as f64 / faces as f64;
    let plain = (PLAIN_FACE_BYTES / (weight as f64 / faces as f64)).min(1.0);
    let limit = (options.cluster_faces as f64 * plain * per_face).max(4.0) as u64;
    let (low, high) = mesh.bounds();
    let mut pending = vec![VertexGrid::new(ROOT, 0, low, high, GRID_SIDES[0])];
    for _ in 0..REFINEMENTS_MAX {
        if pending.is_empty() {
            break;
        }
        let mut next = Vec::new();
        for parts in pending.chunks_mut(PARTS_PER_SWEEP) {
            count(mesh, &cells, parts, options)?;
            for part in parts {
                let whole = GridBox { low: [0; 3], high: [part.side; 3] };
                let mut filled = part.take_filled();
                let (node, level) = (part.node, part.level);
                let mut splitter =
                    Splitter { cells: &mut cells, grid: part, limit, pass: options.pass, next: &mut next };
                splitter.split(&mut filled, node, level, whole);
            }
        }
        pending = next;
    }
    cells.number_leaves();
    Ok(cells)
}

/// Reports whether [`plan`] makes a single cell, because the mesh is no larger than a cluster may be.
pub fn fits_one(mesh: &StoredMesh, cluster_faces: u64) -> bool {
    mesh.face_count() <= cluster_faces && weight_of(mesh).bytes() <= limit_bytes(cluster_faces)
}

/// Weight of a whole mesh.
fn weight_of(mesh: &StoredMesh) -> ClusterWeight {
    let (faces, vertices) = (mesh.face_count(), mesh.vertex_count());
    ClusterWeight { faces, vertices, wedges: vertices.max(mesh.texcoord_count()) }
}

/// Predicts how many cells [`plan`] makes of `faces` faces, if every plane moves by half of its range.
pub fn expected_count(faces: u64, cluster_faces: u64, pass: usize) -> u64 {
    fn count(faces: f64, limit: f64, level: usize, pass: usize) -> u64 {
        if faces <= limit {
            return 1;
        }
        let parts = (faces / limit).ceil().max(2.0);
        let share = if level < SHIFTED_LEVELS { FIRST_SHARES[pass % 3] } else { (parts / 2.0).floor() / parts };
        let share = share - 0.5 * PLANE_PLAY;
        count(faces * share, limit, level + 1, pass) + count(faces * (1.0 - share), limit, level + 1, pass)
    }
    count(faces as f64, cluster_faces.max(1) as f64, 0, pass)
}

/// Counts vertices into the histograms of the parts.
fn count(mesh: &StoredMesh, cells: &Cells, parts: &mut [VertexGrid], options: &PartitionOptions) -> Result<()> {
    if let [part] = &mut parts[..]
        && part.node == ROOT
    {
        let grid = &*part;
        let mut counts = part.zeros();
        sweep(
            mesh,
            options,
            |positions| positions.iter().map(|&p| grid.index(p) as u32).collect::<Vec<_>>(),
            |indices| indices.into_iter().for_each(|i| counts[i as usize] += 1),
        )?;
        part.counts = counts;
        return Ok(());
    }
    let mut part_of: TiVec<NodeId, Option<u8>> = vec![None; cells.nodes.len()].into();
    for (part, grid) in (0..).zip(&*parts) {
        part_of[grid.node] = Some(part);
    }
    let grids = &*parts;
    let mut counts: Vec<Vec<u32>> = grids.iter().map(VertexGrid::zeros).collect();
    let look = |&position: &DVec3| {
        let part = part_of[cells.leaf_of(position)]?;
        Some(GridHit { part, cell: grids[usize::from(part)].index(position) as u32 })
    };
    sweep(
        mesh,
        options,
        |positions| positions.iter().filter_map(look).collect::<Vec<_>>(),
        |hits| hits.into_iter().for_each(|hit| counts[usize::from(hit.part)][hit.cell as usize] += 1),
    )?;
    for (part, counts) in parts.iter_mut().zip(counts) {
        part.counts = counts;
    }
    Ok(())
}

/// Splits the leaves of a part of the tree.
struct Splitter<'a> {
    cells: &'a mut Cells,
    grid: &'a VertexGrid,
    /// Most vertices of a leaf.
    limit: u64,
    /// Number of the pass, which shifts the planes.
    pass: usize,
    /// Parts that need a finer grid.
    next: &'a mut Vec<VertexGrid>,
}

impl Splitter<'_> {
    /// Splits a leaf, and the leaves that this makes.
    fn split(&mut self, filled: &mut [Filled], node: NodeId, level: usize, range: GridBox) {
        let slabs = slab_counts(filled, range);
        let total: u64 = slabs[0].iter().sum();
        if total <= self.limit {
            return;
        }
        // Split along the longest occupied extent.
        let mut occupied = range;
        for (axis, counts) in slabs.iter().enumerate() {
            let first = counts.iter().position(|&n| n > 0).unwrap_or(0);
            let last = counts.iter().rposition(|&n| n > 0).unwrap_or(0);
            occupied.low[axis] = range.low[axis] + first;
            occupied.high[axis] = range.low[axis] + last + 1;
        }
        let extent = |axis: usize| (occupied.high[axis] - occupied.low[axis]) as f64 * self.grid.step[axis];
        let can_cut = |axis: &usize| occupied.high[*axis] - occupied.low[*axis] > 1;
        let wider = |a: &usize, b: &usize| extent(*a).total_cmp(&extent(*b)).then(b.cmp(a));
        let is_too_coarse = (0..3).max_by(wider).is_some_and(|widest| !can_cut(&widest));
        // Refine rather than split along a shorter axis: where an outlier makes the grid coarse, such a split would
        // give slabs that are all border.
        if is_too_coarse && refine(self.grid, node, level, occupied, self.next) {
            return;
        }
        let Some(axis) = (0..3).filter(can_cut).max_by(wider) else { return };
        let parts = total.div_ceil(self.limit).max(2);
        let even = (parts / 2) as f64 / parts as f64;
        let share = if level < SHIFTED_LEVELS { FIRST_SHARES[self.pass % 3] } else { even };
        let cut = choose_cut(&slabs[axis], range.low[axis], occupied.low[axis], occupied.high[axis], total, share);
        let below = self.cells.nodes.push_and_get_key(LEAF);
        let above = self.cells.nodes.push_and_get_key(LEAF);
        self.cells.nodes[node] = Node::Split { axis, plane: self.grid.plane(axis, cut), below };
        let (mut lower, mut upper) = (range, range);
        lower.high[axis] = cut;
        upper.low[axis] = cut;
        let mut below_count = 0;
        for at in 0..filled.len() {
            if usize::from(filled[at].at[axis]) < cut {
                filled.swap(at, below_count);
                below_count += 1;
            }
        }
        let (below_cut, above_cut) = filled.split_at_mut(below_count);
        self.split(below_cut, below, level + 1, lower);
        self.split(above_cut, above, level + 1, upper);
    }
}

/// Vertices in each slab of a range of grid cells, for each axis.
fn slab_counts(filled: &[Filled], range: GridBox) -> [Vec<u64>; 3] {
    let mut slabs: [Vec<u64>; 3] = std::array::from_fn(|axis| vec![0; range.high[axis] - range.low[axis]]);
    for cell in filled {
        for (axis, slabs) in slabs.iter_mut().enumerate() {
            slabs[usize::from(cell.at[axis]) - range.low[axis]] += u64::from(cell.count);
        }
    }
    slabs
}

/// Returns the grid plane near `share` of the vertices whose two adjacent slabs hold the fewest vertices.
fn choose_cut(slabs: &[u64], base: usize, low: usize, high: usize, total: u64, share: f64) -> usize {
    let mut below = 0;
    let mut best: Option<(bool, u64, f64, usize)> = None;
    for cut in low + 1..high {
        below += slabs[cut - 1 - base];
        let off = (below as f64 / total as f64 - share).abs();
        let is_far = off > PLANE_PLAY;
        let crowd = if is_far { 0 } else { slabs[cut - 1 - base] + slabs[cut - base] };
        let candidate = (is_far, crowd, off, cut);
        let order = |a: &(bool, u64, f64, usize), b: &(bool, u64, f64, usize)| {
            a.0.cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.total_cmp(&b.2))
        };
        if best.is_none_or(|best| order(&candidate, &best).is_lt()) {
            best = Some(candidate);
        }
    }
    best.map_or(low + 1, |best| best.3)
}

/// Queues a part for refinement, unless its extent is at the precision of doubles. Returns whether it was queued.
fn refine(grid: &VertexGrid, node: NodeId, level: usize, cell: GridBox, next: &mut Vec<VertexGrid>) -> bool {
    let low = DVec3::from_array(std::array::from_fn(|axis| grid.plane(axis, cell.low[axis])));
    let high = DVec3::from_array(std::array::from_fn(|axis| grid.plane(axis, cell.high[axis])));
    let smallest = low.abs().max(high.abs()) * f64::EPSILON;
    let is_finer = (high - low).cmpgt(smallest * 4.0).any();
    if is_finer {
        next.push(VertexGrid::new(node, level, low, high, GRID_SIDES[1]));
    }
    is_finer
}

/// Applies `look` to windows of all positions in parallel; passes the results to `take` in order.
fn sweep<R: Send>(
    mesh: &StoredMesh,
    options: &PartitionOptions,
    look: impl Fn(&[DVec3]) -> R + Sync,
    mut take: impl FnMut(R),
) -> Result<()> {
    let windows = mesh.position_columns().flat_map(|column| column.ranges(SWEEP_RECORDS).map(move |r| (column, r)));
    map_in_order(
        windows,
        options.threads,
        options.threads * 2,
        |(column, range): (&PackedColumn<DVec3>, _)| Ok(look(&column.window(range)?)),
        |result| {
            take(result);
            Ok(())
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::PackedWriter;
    use crate::model::id::{PieceTexcoord, PieceVertex};
    use crate::model::{Face, FaceWriter, StoredPiece};

    fn mesh_of(folder: &std::path::Path, positions: &[DVec3]) -> StoredMesh {
        let mut column = PackedWriter::create(&folder.join("p"), *b"position").unwrap();
        column.append(positions).unwrap();
        let texcoords = PackedWriter::create(&folder.join("t"), *b"texcoord").unwrap().finish().unwrap();
        let mut faces = FaceWriter::create(&folder.join("f")).unwrap();
        let vertices = [0, 1, 2].map(PieceVertex::new);
        let face = Face { vertices, texcoords: [PieceTexcoord::NONE; 3], ..Face::default() };
        faces.append(&vec![face; positions.len() * 2]).unwrap();
        StoredMesh {
            pieces: vec![StoredPiece {
                positions: column.finish().unwrap(),
                colours: None,
                texcoords,
                faces: faces.finish().unwrap(),
            }],
            ..StoredMesh::default()
        }
    }

    fn planned(positions: &[DVec3], cluster_faces: u64, pass: usize) -> Cells {
        let folder = tempfile::tempdir().unwrap();
        let mesh = mesh_of(folder.path(), positions);
        plan(
            &mesh,
            &PartitionOptions {
                cluster_faces,
                pass,
                weld: true,
                drop_doubles: false,
                drop_texcoords: false,
                threads: 2,
                work_bytes: 1 << 24,
            },
        )
        .unwrap()
    }

    fn largest(cells: &Cells, positions: &[DVec3]) -> usize {
        let mut counts: TiVec<ClusterId, usize> = vec![0; cells.count()].into();
        positions.iter().for_each(|&p| counts[cells.of(p)] += 1);
        counts.into_iter().max().unwrap()
    }

    #[test]
    fn an_even_square_is_cut_into_bounded_cells_that_shift_with_the_pass() {
        let positions: Vec<DVec3> =
            (0..10_000).map(|i| DVec3::new(f64::from(i % 100), f64::from(i / 100), 0.0)).collect();
        let first = planned(&positions, 2000, 0);
        let second = planned(&positions, 2000, 1);
        assert!(first.count() >= 10 && first.count() <= 20, "{}", first.count());
        assert!(largest(&first, &positions) <= 1000);
        assert!(largest(&second, &positions) <= 1000);
        assert_ne!(first, second);
    }

    #[test]
    fn a_crowd_far_smaller_than_the_box_is_cut_too() {
        let mut positions: Vec<DVec3> =
            (0..10_000).map(|i| DVec3::new(f64::from(i % 100), f64::from(i / 100), 0.0) * 1e-9).collect();
        positions.push(DVec3::splat(1e6));
        assert!(largest(&planned(&positions, 2000, 0), &positions) <= 1000);
    }

    #[test]
    fn a_crowd_beside_the_farthest_vertex_is_cut_too() {
        let mut positions: Vec<DVec3> =
            (0..10_000).map(|i| DVec3::new(f64::from(i % 100), f64::from(i / 100), 0.0)).collect();
        positions.push(DVec3::splat(3.4e38));
        assert!(largest(&planned(&positions, 2000, 0), &positions) <= 1000);
    }

    /// Number of adjacent points on a grid of 100 × 100 that lie in different cells.
    fn borders(cells: &Cells, hills: &[DVec3]) -> usize {
        let differs = |i: usize, j: usize| usize::from(cells.of(hills[i]) != cells.of(hills[j]));
        (0..9900).map(|i| differs(i, i + 100) + if i % 100 < 99 { differs(i, i + 1) } else { 0 }).sum()
    }

    #[test]
    fn a_distant_vertex_does_not_cut_the_rest_into_slabs() {
        let hill = |i: i32| f64::from(i * 7919 % 100) / 25.0;
        let mut positions: Vec<DVec3> =
            (0..10_000).map(|i| DVec3::new(f64::from(i % 100), f64::from(i / 100), hill(i))).collect();
        for pass in 0..3 {
            let alone = borders(&planned(&positions, 2000, pass), &positions);
            positions.push(DVec3::new(4e5, 4e6, 50.0));
            let cells = planned(&positions, 2000, pass);
            assert!(largest(&cells, &positions) <= 1001);
            let beside = borders(&cells, &positions);
            assert!(beside * 2 < alone * 3, "pass {pass}: {beside} instead of {alone}");
            positions.pop();
        }
    }

    #[test]
    fn one_position_cannot_be_cut_and_ends_as_one_cell() {
        let positions = vec![DVec3::new(3.0, 4.0, 5.0); 5000];
        assert_eq!(largest(&planned(&positions, 1000, 0), &positions), 5000);
    }
}
