//! Simplifies a mesh in memory: as one cluster, without files, by the same engine and schedule.
//!
//! ```text
//! Mesh ──▶ one cluster ──▶ (remesh) ──▶ pass 1: to about 4 × the target, … the target ──▶ Mesh
//! ```
//! # Memory
//! About 220 bytes per triangle while the first pass runs; twice the mesh where a pass may be repeated.

use glam::{DVec2, DVec3};

use super::goal::{Aim, Goal, half_first};
use super::metric_engine::{MetricEngine, Simplified};
use super::options::PassOptions;
use super::outcome::{StageReport, StageSums};
use super::pass_id::{Pass, PassKind};
use super::sample;
use super::schedule::{PassEnd, Schedule};
use super::second_attempt::costs_before_leap;
use super::stop_rule::{ClusterStop, Wanted};
use crate::base::id::{TiSlice, TiVec};
use crate::base::{Progress, Result};
use crate::cost::mesh_stats::MeshStats;
use crate::mesh::ClusterMesh;
use crate::mesh::compact::{Compacted, compact};
use crate::mesh::id::{LocalVertex, Wedge};
use crate::model::catalogue::Part;
use crate::model::id::{FileId, MaterialId, PartId, Texcoord};
use crate::model::{Catalogue, Face, Mesh};
use crate::partition::id::{ClusterId, ClusterTexcoord, PartitionVertex};
use crate::partition::reading::ClusterFaces;
use crate::partition::texture_scale::{MaterialArea, TextureScale};
use crate::remesh::cvd::{self, CvdSettings, FrozenStatistics};
use crate::remesh::relax;
use crate::simplify::Changes;

/// Result of simplifying a mesh in memory.
#[derive(Debug)]
pub struct SimplifiedMesh {
    /// The simplified mesh.
    pub mesh: Mesh,
    /// Whether the target was met.
    pub is_reached: bool,
    /// Changes of topology.
    pub changes: Changes,
}

/// The mesh under way.
struct InMemory<'a> {
    options: &'a PassOptions,
    engine: Box<dyn MetricEngine>,
    scale: TextureScale,
    catalogue: Catalogue,
    /// Label of each part of the catalogue, ascending.
    labels: TiVec<PartId, u32>,
    origin: DVec3,
    mesh: ClusterMesh,
    /// Texture coordinate of the input for each wedge; `None` once it has moved.
    texcoord_of: TiVec<Wedge, Option<ClusterTexcoord>>,
    /// Colour of each vertex, if there are any.
    colours: Vec<[f32; 3]>,
    schedule: Schedule,
    changes: Changes,
    /// End of the pass before.
    before: Option<StageReport>,
}

/// Simplifies a mesh, which must be [sound](Mesh::check). `options.input` must be its number of faces.
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped) if asked to stop; it is asked before each pass.
pub fn simplify(mesh: &Mesh, options: &PassOptions, progress: &dyn Progress) -> Result<SimplifiedMesh> {
    let mut under_way = InMemory::new(mesh, options);
    while let Some(pass) = under_way.schedule.next(options) {
        progress.check_stopped()?;
        progress.begin_pass(pass.number + 1);
        let faces = under_way.mesh.face_count as u64;
        progress.begin("simplify", faces, "faces");
        match pass.kind {
            PassKind::Remesh(settings) => under_way.remesh(&settings),
            PassKind::Collapse => under_way.collapse(pass),
        }
        progress.advance(faces);
    }
    let (is_reached, changes) = (under_way.schedule.reached, under_way.changes);
    Ok(SimplifiedMesh { mesh: under_way.finish(mesh), is_reached, changes })
}

impl<'a> InMemory<'a> {
    fn new(mesh: &Mesh, options: &'a PassOptions) -> Self {
        let labels = labels_of(mesh);
        let catalogue = catalogue_of(mesh, labels.len());
        let faces = faces_of(mesh, &labels, options);
        let mut engine = options.cost.engine();
        let mut scale = TextureScale::none(&catalogue);
        if engine.reads_texture() {
            if !engine.wants_raw_texture() {
                let mut areas = catalogue.per_material(MaterialArea::default());
                faces.add_areas(&catalogue, &mut areas);
                scale = TextureScale::new(&areas);
            }
            let kept = options.target as f64 / options.input.max(1) as f64;
            engine.learn_seam_density(faces.tally_seams(&catalogue).seam_density(kept));
        }
        let source = faces.into_whole(&catalogue, &scale);
        let colour = |vertex: &PartitionVertex| mesh.colours.get(vertex.index()).copied().unwrap_or_default();
        let colours =
            if mesh.colours.is_empty() { Vec::new() } else { source.vertex_ids().iter().map(colour).collect() };
        let texcoord_of = source.wedge_texcoords().iter().map(|texcoord| texcoord.some()).collect();
        if engine.needs_statistics() {
            let mut stats = MeshStats::default();
            source.mesh.positions.iter().for_each(|position| stats.enclose(source.origin + *position));
            engine.count(source.mesh.clone(), &mut stats);
            engine.normalise(&stats);
        }
        Self {
            options,
            engine,
            scale,
            catalogue,
            labels,
            origin: source.origin,
            mesh: source.mesh,
            texcoord_of,
            colours,
            schedule: Schedule::default(),
            changes: Changes::default(),
            before: None,
        }
    }

    fn remesh(&mut self, settings: &CvdSettings) {
        let frame = FrozenStatistics::of_one(&self.mesh, settings);
        let mut mesh = std::mem::take(&mut self.mesh);
        let outcome = cvd::reconstruct(&mut mesh, settings, &frame);
        if !self.colours.is_empty() {
            for point in &outcome.points {
                let [a, b] = point.ends.map(|end| self.colours[end.index()]);
                let share = point.share as f32;
                self.colours.push([0, 1, 2].map(|k| a[k] + share * (b[k] - a[k])));
            }
        }
        self.take(&mesh);
        self.schedule.end_remeshing(settings, 1);
    }

    fn collapse(&mut self, pass: Pass) {
        if pass.is_first_turn()
            && let Some(left) = self.left_within_bound(pass)
        {
            self.schedule.choose_lead(left, true, self.options);
        }
        let &PassOptions { target, passes, max_error, optimize, .. } = self.options;
        let aim = self.aim();
        let faces_in = self.mesh.face_count as u64;
        let stop = match aim.goal(pass.turn, faces_in) {
            Goal::Deviation(most) => aim.within(most, pass.turn, 1),
            _ => aim.in_one_cluster(pass.turn, faces_in),
        }
        .of(ClusterId::new(0));
        let rules = self.options.rules(pass, aim);
        let mesh = std::mem::take(&mut self.mesh);
        // Without a bound, a pass is repeated if costs leap before its end.
        let spare = max_error.is_none().then(|| mesh.clone());
        let mut simplified = self.engine.simplify(mesh, &rules, &stop, Wanted::Mesh);
        let mut met_wall = false;
        if let Some(mesh) = spare
            && let Some(costs) = self.better_costs(&simplified, &stop)
        {
            met_wall = matches!(stop, ClusterStop::Faces(..));
            simplified = self.engine.simplify(mesh, &rules, &ClusterStop::Costs(costs, target), Wanted::Mesh);
        }
        self.before =
            Some(StageReport { faces: simplified.faces_out, threshold: f64::from(simplified.cost), rms_estimate: 0.0 });
        self.changes += simplified.changes;
        let mut mesh = simplified.mesh.unwrap_or_default();
        if optimize && pass.turn + 1 >= passes {
            relax(&mut mesh);
        }
        self.take(&mesh);
        let end = PassEnd {
            faces_in,
            faces_out: simplified.faces_out,
            is_last: aim.is_last(pass.turn),
            is_single: true,
            is_exact: aim.is_last(pass.turn) && !matches!(stop, ClusterStop::Deviation(..)),
            is_steepest: false,
            met_wall,
        };
        self.schedule.end_collapsing(end, self.options);
    }

    fn aim(&self) -> Aim {
        let &PassOptions { target, input, passes, max_error, .. } = self.options;
        Aim { target, input, passes, bound: max_error, lead: self.schedule.lead }
    }

    /// Returns the share of the faces that the bound on the deviation alone would leave, measured on a sample; `None`
    /// without a bound. Without a target nothing depends on it: it is not measured.
    fn left_within_bound(&self, pass: Pass) -> Option<f64> {
        let bound = self.aim().bound_of(pass.turn)?;
        if self.options.target == 0 {
            return Some(1.0);
        }
        let faces = self.mesh.face_count as u64;
        let purpose = self.aim().purpose(pass.turn, faces as f64);
        let sample = sample::patch(&self.mesh, sample::sample_faces(faces, purpose) as usize);
        Some(self.engine.share_within(sample, &self.options.sample_rules(pass, self.aim()), &half_first(bound)))
    }

    /// Cost thresholds for a second attempt; `None` if the first one stands.
    fn better_costs(&self, first: &Simplified, stop: &ClusterStop) -> Option<Vec<f32>> {
        if matches!(stop, ClusterStop::Faces(_, target) if first.faces_out <= *target) {
            return None;
        }
        let mut stages = StageSums::default();
        stages.add(first.faces_in, first.area, &first.milestones);
        costs_before_leap(self.before, &stages, first.area / first.faces_in.max(1) as f64)
    }

    /// Takes over the mesh after a pass.
    fn take(&mut self, mesh: &ClusterMesh) {
        let label = |part| self.catalogue.material_of(part);
        let Compacted { mesh: compacted, vertices, wedges } = compact(mesh, label);
        let texcoord = |&old: &Wedge| {
            let known = self.texcoord_of.get(old).copied().flatten();
            known.filter(|_| !mesh.wedge_moved[old])
        };
        self.texcoord_of = wedges.iter().map(texcoord).collect();
        if !self.colours.is_empty() {
            self.colours = vertices.iter().map(|&old| self.colours[mesh.origin_of(old).index()]).collect();
        }
        self.mesh = compacted;
    }

    /// Returns the simplified mesh.
    fn finish(self, input: &Mesh) -> Mesh {
        let Self { mesh, catalogue, labels, scale, origin, texcoord_of, colours, .. } = self;
        let mut part_of = mesh.per_wedge(PartId::default());
        for (corners, &part) in mesh.corners.iter().zip(&mesh.parts) {
            corners.iter().for_each(|&wedge| part_of[wedge] = part);
        }
        let mut texcoords = Vec::new();
        let mut texcoord_ids: TiVec<Wedge, u32> = TiVec::with_capacity(part_of.len());
        for (wedge, &uv) in mesh.wedge_uv.iter_enumerated() {
            if uv.is_nan() {
                texcoord_ids.push(Mesh::NO_TEXCOORD);
                continue;
            }
            texcoord_ids.push(texcoords.len() as u32);
            texcoords.push(match texcoord_of[wedge] {
                Some(texcoord) => input.texcoords[texcoord.index()],
                None => (uv / DVec2::splat(scale.of(&catalogue, part_of[wedge]))).to_array(),
            });
        }
        let has_texture = !input.face_texcoords.is_empty();
        let has_labels = !input.face_labels.is_empty();
        let face_labels = mesh.parts.iter().map(|&part| labels[part]);
        Mesh {
            positions: mesh.positions.iter().map(|&position| (origin + position).to_array()).collect(),
            colours,
            texcoords,
            faces: mesh.corner_vertices.iter().map(|face| face.map(LocalVertex::number)).collect(),
            face_texcoords: if has_texture {
                mesh.corners.iter().map(|corners| corners.map(|wedge| texcoord_ids[wedge])).collect()
            } else {
                Vec::new()
            },
            face_labels: if has_labels { face_labels.collect() } else { Vec::new() },
        }
    }
}

/// Labels of the faces, ascending; at least one.
fn labels_of(mesh: &Mesh) -> TiVec<PartId, u32> {
    let mut labels = mesh.face_labels.clone();
    labels.sort_unstable();
    labels.dedup();
    if labels.is_empty() {
        labels.push(0);
    }
    labels.into()
}

/// A catalogue with a part and a material for each of `count` labels.
fn catalogue_of(mesh: &Mesh, count: usize) -> Catalogue {
    let part = |material| Part { file: FileId::new(0), object: None, group: None, material: Some(material) };
    Catalogue {
        parts: MaterialId::first(count).map(part).collect(),
        materials: vec![Default::default(); count].into(),
        has_texcoords: !mesh.face_texcoords.is_empty(),
        ..Catalogue::default()
    }
}

fn faces_of(mesh: &Mesh, labels: &TiSlice<PartId, u32>, options: &PassOptions) -> ClusterFaces {
    let part_of = |face: usize| match mesh.face_labels.get(face) {
        Some(label) => labels.partition_point(|other| other < label),
        None => PartId::new(0),
    };
    let face = |(face, &vertices): (usize, &[u32; 3])| Face {
        vertices: vertices.map(PartitionVertex::new),
        texcoords: mesh.face_texcoords.get(face).map_or([Texcoord::NONE; 3], |ids| ids.map(Texcoord::new)),
        part: part_of(face),
        ..Face::default()
    };
    let faces = mesh.faces.iter().enumerate().map(face).collect();
    let positions: TiVec<PartitionVertex, DVec3> = mesh.positions.iter().copied().map(DVec3::from_array).collect();
    // Negative zero is zero, and no seam beside it.
    let texcoords = mesh.texcoords.iter().map(|&texcoord| DVec2::from_array(texcoord) + 0.0).collect();
    ClusterFaces::whole(faces, &positions, texcoords, options.weld, options.drop_doubles)
}
