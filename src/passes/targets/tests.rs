use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use glam::{DVec2, DVec3};

use super::*;
use crate::base::{Silent, lock};
use crate::cost::curvature::CurvatureSettings;
use crate::cost::mesh_stats::MeshStats;
use crate::job::{Manifest, Resume, WorkFolder};
use crate::mesh::cluster::samples;
use crate::model::id::{FileId, PieceTexcoord, PieceVertex};
use crate::model::piece::write_piece;
use crate::model::{Catalogue, Face, Part, StoredMesh};
use crate::passes::floor::Floor;
use crate::passes::goal::Lead;
use crate::passes::metric_engine::{EngineRules, MetricEngine, Simplified};
use crate::passes::options::samples::three_passes;
use crate::passes::options::{Cost, SeamPolicy};
use crate::passes::outcome::PassReport;
use crate::passes::pass_id::PassKind;
use crate::passes::state::ResumePoint;
use crate::passes::stop_rule::{ClusterStop, Wanted};
use crate::simplify::{Changes, LoggedCollapse};

/// Squares along a side of the grid that is partitioned.
const SIDE: u32 = 20;
const FACES: u64 = 2 * (SIDE * SIDE) as u64;

/// What an engine was asked for.
#[derive(Default)]
struct Asked {
    /// Highest cost for each cluster of a trial.
    costs: Vec<f32>,
    /// Rules and shares for each sample.
    samples: Vec<(EngineRules, Vec<f64>)>,
}

/// An engine that collapses nothing: its logs are invented.
struct Inventor<F> {
    asked: Arc<Mutex<Asked>>,
    /// Costs of the collapses of a cluster with this number of faces, and the faces that each removes.
    collapses: F,
}

impl<F: Fn(u64) -> Vec<(f32, u64)> + Sync> MetricEngine for Inventor<F> {
    fn reads_texture(&self) -> bool {
        false
    }

    fn wants_raw_texture(&self) -> bool {
        false
    }

    fn needs_statistics(&self) -> bool {
        false
    }

    fn learn_seam_density(&mut self, _: f64) {}

    fn normalise(&mut self, _: &MeshStats) {}

    fn count(&self, _: ClusterMesh, _: &mut MeshStats) {}

    fn extra_bytes(&self, _: u64, _: u64) -> u64 {
        0
    }

    fn simplify(&self, mesh: ClusterMesh, _: &EngineRules, stop: &ClusterStop, wanted: Wanted) -> Simplified {
        let ClusterStop::Costs(costs, 0) = stop else { panic!("{stop:?}") };
        assert_eq!((costs.len(), wanted), (1, Wanted::Log));
        lock(&self.asked).costs.push(costs[0]);
        let mut faces = mesh.face_count as u64;
        let cheap = (self.collapses)(faces).into_iter().take_while(|&(cost, _)| cost <= costs[0]);
        let log = cheap.map(|(cost, removed)| {
            faces -= removed;
            LoggedCollapse { cost, faces: faces as u32 }
        });
        Simplified {
            mesh: None,
            faces_in: mesh.face_count as u64,
            log: log.collect(),
            faces_out: faces,
            cost: costs[0],
            area: 0.0,
            squared_error: 0.0,
            milestones: Vec::new(),
            seam_vertices: 0,
            changes: Changes::default(),
            floor: Floor::default(),
        }
    }

    fn thresholds(&self, _: ClusterMesh, rules: &EngineRules, shares: &[f64]) -> Vec<f32> {
        lock(&self.asked).samples.push((*rules, shares.to_vec()));
        shares.iter().map(|&share| share as f32).collect()
    }

    fn share_within(&self, sample: ClusterMesh, rules: &EngineRules, bounds: &[f64]) -> f64 {
        lock(&self.asked).samples.push((*rules, bounds.to_vec()));
        0.25 * sample.face_count as f64 / FACES as f64
    }
}

/// A grid in a work folder.
struct Bench {
    _folder: tempfile::TempDir,
    job: WorkFolder,
    catalogue: Catalogue,
    mesh: StoredMesh,
    asked: Arc<Mutex<Asked>>,
}

impl Bench {
    /// The grid, and beside it as many copies of one small face.
    fn new(side: u32, copies: u32) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let job = WorkFolder::open(&folder.path().join("work"), &Manifest::default(), Resume::Never).unwrap();
        let grid = samples::grid(side, 0.3);
        let mut positions = grid.positions.raw.clone();
        let mut corners: Vec<[u32; 3]> = grid.face_ids().map(|face| grid.vertices(face).map(|v| v.number())).collect();
        if copies > 0 {
            let first = positions.len() as u32;
            positions.extend([DVec3::ZERO, DVec3::X, DVec3::Y].map(|corner| DVec3::splat(40.0) + corner * 1e-3));
            corners.extend(vec![[first, first + 1, first + 2]; copies as usize]);
        }
        let face = |vertices: [u32; 3]| Face {
            vertices: vertices.map(PieceVertex::new),
            texcoords: [PieceTexcoord::NONE; 3],
            ..Face::default()
        };
        let faces: Vec<_> = corners.into_iter().map(face).collect();
        let pending = write_piece(&job.path().join("scan-0.piece"), &positions, &[] as &[DVec2], None, &faces).unwrap();
        let mesh = StoredMesh { pieces: vec![pending.commit().unwrap()], ..StoredMesh::default() };
        let part = Part { file: FileId::new(0), object: None, group: None, material: None };
        let catalogue = Catalogue { parts: vec![part].into(), ..Catalogue::default() };
        Self { _folder: folder, job, catalogue, mesh, asked: Arc::default() }
    }

    /// The passes of the mesh, whose clusters have these collapses.
    fn run<'a>(
        &'a self,
        options: &'a PassOptions,
        collapses: impl Fn(u64) -> Vec<(f32, u64)> + Sync + 'static,
    ) -> Run<'a> {
        let point = ResumePoint::from(self.mesh.clone());
        let mut run = Run::resume(point, options, &self.catalogue, &self.job, &Silent).unwrap();
        run.engine = Box::new(Inventor { asked: self.asked.clone(), collapses });
        run
    }
}

fn no_collapses(_: u64) -> Vec<(f32, u64)> {
    Vec::new()
}

/// Options for a target, with a metric that takes memory of its own.
fn options(target: u64) -> PassOptions {
    let cost = Cost::Curvature(CurvatureSettings::from([1.0, 1e-3, 1.0]));
    PassOptions { cost, ..three_passes(FACES, target) }
}

fn pass(turn: usize) -> Pass {
    Pass { number: 0, turn, kind: PassKind::Collapse }
}

#[test]
fn a_bound_is_no_smaller_than_what_rounding_does() {
    let bench = Bench::new(SIDE, 0);
    let bound = |max_error| {
        let options = PassOptions { max_error, ..options(400) };
        let mut run = bench.run(&options, no_collapses);
        run.noise = 0.5;
        run.bound()
    };
    assert_eq!([Some(2.0), Some(0.1), None].map(bound), [Some(2.0), Some(0.5), None]);
}

#[test]
fn clusters_stop_as_the_goal_of_the_pass_says() {
    let bench = Bench::new(SIDE, 0);
    let plan = |options: PassOptions, turn, faces, thresholds: &[f32]| {
        let mut run = bench.run(&options, no_collapses);
        let partition = run.partition(pass(0)).unwrap();
        if options.max_error.is_some() {
            run.state.schedule.lead = Lead::Bound;
        }
        run.plan(&partition, thresholds.to_vec(), pass(turn), faces).unwrap()
    };
    let single = PassOptions { cluster_faces: FACES, ..options(400) };
    let bounded = PassOptions { max_error: Some(1.0), target: 0, ..options(0) };
    for options in [bounded, PassOptions { target: 0, max_error: Some(1.0), ..single }] {
        assert!(matches!(plan(options, 1, FACES, &[]), (StopRule::Deviation(..), false)));
        assert!(matches!(plan(options, 2, FACES, &[]), (StopRule::Deviation(..), false)));
    }
    assert!(matches!(plan(single, 1, FACES, &[]), (StopRule::Shares(_), false)));
    assert!(matches!(plan(single, 2, FACES, &[]), (StopRule::Faces(_, 400), true)));
    // Far above the target, several clusters stop at the costs of the sample.
    for turn in [0, 1, 2] {
        let (rule, is_exact) = plan(options(400), turn, FACES, &[1.0, 2.0]);
        assert!(matches!(rule, StopRule::Costs(costs) if costs == [1.0, 2.0]) && !is_exact);
    }
    let (rule, is_exact) = plan(options(FACES), 2, FACES, &[]);
    assert!(matches!(rule, StopRule::Costs(costs) if costs.is_empty()) && !is_exact, "without a sample");
}

#[test]
fn a_trim_takes_shares_of_large_clusters_until_a_pass_is_added() {
    let bench = Bench::new(SIDE, 0);
    // No cost goes up where nothing is to be removed: a trim by shares allows a multiple of it from the start.
    let cost = |target, turn| {
        let options = options(target);
        let mut run = bench.run(&options, no_collapses);
        let partition = run.partition(pass(0)).unwrap();
        match run.plan(&partition, vec![3.0], pass(turn), target).unwrap() {
            (StopRule::Trim(costs, keep), true) => {
                assert_eq!(keep.raw, partition.face_counts().raw);
                costs
            }
            other => panic!("{other:?}"),
        }
    };
    for turn in [2, 3] {
        assert_eq!(cost(1_000_000, turn), [3.0 * TRIM_SPREAD]);
        assert_eq!(cost(FACES, turn), [3.0]);
    }
    assert_eq!(cost(1_000_000, 4), [3.0]);
}

#[test]
fn clusters_are_large_from_five_thousand_faces_each_at_the_target() {
    let bench = Bench::new(SIDE, 0);
    let has_large = |target| {
        let options = options(target);
        let mut run = bench.run(&options, no_collapses);
        let partition = run.partition(pass(0)).unwrap();
        (run.has_large(&partition), partition.filled_count())
    };
    let (_, count) = has_large(1);
    assert!(count > 2);
    assert_eq!([0, 1, 2].map(|more| has_large(5_000 * count - 1 + more).0), [false, true, true]);
}

#[test]
fn a_sample_is_simplified_to_the_shares_of_its_pass_with_seams_free() {
    for (policy, locks) in [(SeamPolicy::Stitch, false), (SeamPolicy::Follow, false), (SeamPolicy::Lock, true)] {
        let bench = Bench::new(SIDE, 0);
        let options = PassOptions { seams: policy, lock_borders: true, ..options(400) };
        let run = bench.run(&options, no_collapses);
        let (mesh, faces) = (samples::grid(4, 0.3), 2 * 4 * 4);
        for (turn, faces_before) in [(0, FACES), (1, FACES), (2, FACES), (2, 410)] {
            let thresholds = run.sample_thresholds(mesh.clone(), pass(turn), faces_before);
            let (rules, shares) = lock(&bench.asked).samples.pop().unwrap();
            assert_eq!(rules, EngineRules { lock_seams: locks, ..run.rules(pass(turn)) });
            assert!(rules.lock_borders);
            match run.aim().goal(turn, faces_before) {
                Goal::Stages(goal) => assert_eq!(shares, goal),
                Goal::Trim(goal) => assert_eq!((turn, faces_before, &shares[..]), (2, 410, &[goal][..])),
                Goal::Deviation(_) => panic!("a target stands before a bound"),
            }
            assert_eq!(thresholds, shares.iter().map(|&share| share as f32).collect::<Vec<_>>());
        }
        let extra = options.cost.extra_face_bytes();
        assert!(extra > 0);
        assert_eq!(run.permits.peak(), faces * (ORDINARY_BYTES + extra));
        let bounded = PassOptions { target: 0, max_error: Some(1.0), ..options };
        let mut run = bench.run(&bounded, no_collapses);
        run.state.schedule.lead = Lead::Bound;
        assert!(run.sample_thresholds(mesh, pass(0), FACES).is_empty());
    }
}

/// What the sample says that a bound leaves, and which bounds and how much of the mesh it was measured with.
#[test]
fn a_bound_is_tried_on_a_sample_with_seams_free_where_something_depends_on_it() {
    for (policy, locks) in [(SeamPolicy::Stitch, false), (SeamPolicy::Lock, true)] {
        for (cluster_faces, target, is_measured) in
            [(100, 400, true), (100, 0, true), (FACES, 400, true), (FACES, 0, false)]
        {
            let bench = Bench::new(SIDE, 0);
            let options = PassOptions { seams: policy, max_error: Some(2.0), cluster_faces, ..options(target) };
            let mut run = bench.run(&options, no_collapses);
            let partition = run.partition(pass(0)).unwrap();
            assert_eq!(partition.is_single(), cluster_faces == FACES);
            run.state.sample = if partition.is_single() { ClusterMesh::default() } else { samples::grid(10, 0.3) };
            let left = run.left_within_bound(&partition, pass(0)).unwrap();
            let asked = lock(&bench.asked).samples.pop();
            assert_eq!(asked.is_some(), is_measured);
            if let Some((rules, bounds)) = asked {
                assert_eq!(rules.lock_seams, locks);
                assert_eq!(bounds, [1.96 / 2.0, 1.96]);
                // All of the only cluster, or the sample of several.
                assert_eq!(left, Some(if partition.is_single() { 0.25 } else { 0.25 / 4.0 }));
            } else {
                assert_eq!(left, Some(1.0));
            }
        }
    }
    let bench = Bench::new(SIDE, 0);
    let unbounded = options(400);
    let mut run = bench.run(&unbounded, no_collapses);
    let partition = run.partition(pass(0)).unwrap();
    assert_eq!(run.left_within_bound(&partition, pass(0)).unwrap(), None);
}

#[test]
fn seams_are_free_in_the_first_pass_if_the_bound_leads_it() {
    let bench = Bench::new(SIDE, 0);
    for (policy, lead, locks) in [
        (SeamPolicy::Stitch, Lead::Target, [true, false]),
        (SeamPolicy::Stitch, Lead::Bound, [false, false]),
        (SeamPolicy::Stitch, Lead::BoundFromHalf, [false, false]),
        (SeamPolicy::Lock, Lead::Bound, [true, true]),
    ] {
        let options = PassOptions { seams: policy, max_error: Some(2.0), ..options(400) };
        let mut run = bench.run(&options, no_collapses);
        run.state.schedule.lead = lead;
        assert_eq!([0, 1].map(|turn| run.rules(pass(turn)).lock_seams), locks, "{policy:?}, {lead:?}");
    }
}

#[test]
fn a_sample_is_as_large_as_the_pass_needs_that_it_is_for() {
    let bench = Bench::new(SIDE, 0);
    let is_of = |target, passes, turn: Option<usize>, sample_faces: usize| {
        let options = PassOptions { passes, ..options(target) };
        let mut run = bench.run(&options, no_collapses);
        let partition = run.partition(pass(0)).unwrap();
        let survey = match turn {
            Some(turn) => run.survey(&partition, pass(turn)),
            None => run.first_survey(&partition),
        };
        let clusters = survey.clusters();
        assert_eq!(clusters.len() as u64, partition.filled_count());
        assert_eq!(survey.patch_faces(clusters[0]), Some(sample_faces / clusters.len()), "{target} {passes} {turn:?}");
    };
    // 2,800 faces are to be left of it, from pass to pass; where the pass must end just above the target, it is larger.
    is_of(100, 3, Some(0), 11_200);
    is_of(100, 4, Some(1), 10_000);
    is_of(100, 3, Some(1), 20_000);
    is_of(100, 3, Some(2), 20_000);
    // Later passes make up for a small sample of the input.
    is_of(200, 1, None, 20_000);
    is_of(200, 2, None, 11_200 / 2);
    is_of(200, 3, None, 11_200 / 2);
}

#[test]
fn the_first_sample_has_a_patch_of_each_cluster_that_can_be_loaded() {
    for (copies, cluster_faces) in [(0, 100), (7_500, 1_000)] {
        let bench = Bench::new(SIDE, copies);
        let options = PassOptions { cluster_faces, ..options(400) };
        let mut run = bench.run(&options, no_collapses);
        let partition = run.partition(pass(0)).unwrap();
        let is_heavy = |cluster: &ClusterId| partition.weight(*cluster).is_none();
        let heavy_faces: u64 = partition.clusters().filter(is_heavy).map(|heavy| partition.face_count(heavy)).sum();
        assert_eq!((heavy_faces, partition.total_faces()), (copies.into(), FACES + u64::from(copies)));
        let survey = run.first_survey(&partition);
        let all = partition.clusters().filter(|&cluster| partition.is_loadable(cluster));
        assert!(all.eq(survey.clusters().iter().copied()));
        // A patch may be larger than any of the clusters.
        assert_eq!(run.take_sample(&partition).unwrap().face_count as u64, FACES);
    }
}

#[test]
fn the_highest_cost_is_that_of_the_passes_so_far() {
    let bench = Bench::new(SIDE, 0);
    let options = options(400);
    let mut run = bench.run(&options, no_collapses);
    assert_eq!(run.highest_cost(), 0.0);
    for threshold in [0.25, 0.75, 0.5] {
        run.state.reports.push(PassReport { threshold, ..PassReport::default() });
    }
    assert_eq!(run.highest_cost(), 0.75);
}

/// Runs a trim by cost; returns where clusters stop, their faces, and the costs of its trials.
fn trim(
    side: u32,
    target: u64,
    cost: f32,
    ended_at: &[f64],
    collapses: impl Fn(u64) -> Vec<(f32, u64)> + Sync + 'static,
) -> (StopRule, Vec<u64>, Vec<f32>) {
    let bench = Bench::new(side, 0);
    let options = options(target);
    let mut run = bench.run(&options, collapses);
    run.state.reports = ended_at.iter().map(|&threshold| PassReport { threshold, ..PassReport::default() }).collect();
    let partition = run.partition(pass(0)).unwrap();
    let stops = run.plan_trim(&partition, cost, pass(3)).unwrap();
    let mut trials = std::mem::take(&mut lock(&bench.asked).costs);
    assert_eq!(trials.len() % partition.filled_count() as usize, 0, "a trial covers each cluster once");
    trials.dedup();
    (stops, partition.face_counts().raw, trials)
}

/// Ten collapses of two faces each, at costs that depend on the faces of the cluster; they do not rise evenly.
fn pairs(faces: u64) -> Vec<(f32, u64)> {
    let mut costs: Vec<f32> = (1..=10).map(|i| (faces * i * i * 7_919 % 1_009) as f32 / 1_009.0).collect();
    costs.sort_by(f32::total_cmp);
    costs.into_iter().map(|cost| (cost, 2)).collect()
}

#[test]
fn a_trim_by_cost_removes_the_cheapest_faces_of_all_clusters() {
    for excess in [0, 1, 2, 7, 20, 33, 50, 61] {
        let (stops, faces, trials) = trim(SIDE, FACES - excess, 2.0, &[], pairs);
        let StopRule::Trim(costs, keep) = stops else { panic!("{stops:?}") };
        assert_eq!((costs, trials), (vec![2.0], vec![2.0]));
        let mut all: Vec<(f32, usize)> = Vec::new();
        for (cluster, &faces) in faces.iter().enumerate() {
            all.extend(pairs(faces).iter().map(|&(cost, _)| (cost, cluster)));
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut lost = BTreeMap::new();
        all[..excess.div_ceil(2) as usize].iter().for_each(|&(_, cluster)| *lost.entry(cluster).or_default() += 2);
        for (cluster, (keep, faces)) in keep.iter().zip(faces).enumerate() {
            assert_eq!(*keep, faces - lost.get(&cluster).copied().unwrap_or(0), "{cluster} of {excess}");
        }
    }
}

#[test]
fn trials_go_on_at_higher_costs_until_enough_faces_can_go() {
    let trials = |excess, cost, ended_at: &[f64], collapses: fn(u64) -> Vec<(f32, u64)>| {
        let (stops, _, trials) = trim(SIDE, FACES - excess, cost, ended_at, collapses);
        let StopRule::Trim(costs, keep) = stops else { panic!("{stops:?}") };
        assert_eq!(costs, trials[trials.len() - 1..]);
        (trials, FACES - keep.iter().sum::<u64>())
    };
    let at_one = |_: u64| vec![(1.0, 2)];
    assert_eq!(trials(2, 1.0, &[], at_one), (vec![1.0], 2));
    assert_eq!(trials(2, 0.25, &[], at_one), (vec![0.25, 1.0], 2));
    assert_eq!(trials(2, 0.25, &[0.1, 8.0], at_one), (vec![0.25, 8.0], 2));
    assert_eq!(trials(2, 0.0, &[0.5], at_one), (vec![0.0, 0.5, 2.0], 2));
    // After five of them, what can go goes.
    let five = [1.0, 4.0, 16.0, 64.0, 256.0];
    assert_eq!(trials(2, 1.0, &[], |_| vec![(256.0, 2)]), (five.to_vec(), 2));
    assert_eq!(trials(2, 1.0, &[], |_| vec![(257.0, 2)]), (five.to_vec(), 0));
}

#[test]
fn a_trim_may_end_a_thousandth_below_the_target_or_two_faces() {
    // Every cluster can lose this many faces, all at once.
    let trial_count = |side, target, removed| {
        let once = move |faces| if faces > removed { vec![(1.0, removed)] } else { Vec::new() };
        trim(side, target, 1.0, &[], once).2.len()
    };
    assert_eq!([40, 42, 43].map(|removed| trial_count(20, 760, removed)), [1, 1, 5]);
    assert_eq!([42, 45, 46].map(|removed| trial_count(39, 3_000, removed)), [1, 1, 5]);
}
