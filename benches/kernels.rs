//! How fast the inner steps are, each by itself and on one thread, in triangles a second.
//!
//! ```text
//! cargo bench --bench kernels                                   # fixtures/town, 18,218 triangles
//! DRYSTONE_BENCH_MESH=city.obj cargo bench --bench kernels      # any other mesh; clusters as in a run
//! ```
//! | Name | What a round does |
//! | --- | --- |
//! | `scan` | text to columns on disk |
//! | `partition` | columns to clusters on disk: numbering, welding, buckets |
//! | `load` | the largest cluster from disk to memory |
//! | `quadrics` | rings, classes and quadrics of that cluster, as each stage makes them anew |
//! | `evaluation` | the cost of all collapses of vertices inside a chart |
//! | `collapse` | that cluster to a quarter of its triangles, seams and borders free |
//!
//! Whole programs are compared by `tools/peers/run.py`.

use std::fs;
use std::hint::black_box;
use std::path::{Path, PathBuf};

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use drystone::base::Silent;
use drystone::base::id::TiVec;
use drystone::cost::{EdgeCase, SurfaceCost, Weights};
use drystone::mesh::class::classify;
use drystone::mesh::{Class, ClusterMesh, LocalVertex, Rings, WedgePair};
use drystone::partition::texture_scale::MaterialArea;
use drystone::partition::{
    ClusterId, ClusterSource, Partition, PartitionOptions, TextureScale, cluster, partition, reading,
};
use drystone::read::{Scan, ScanOptions, scan};
use drystone::simplify::{Engine, Stop};

/// Triangles of a cluster, as the program cuts them by default.
const CLUSTER_FACES: u64 = 100_000;
/// Memory for windows and buffers, as in a run with 1 GiB.
const WORK_BYTES: u64 = 512 << 20;

fn mesh_path() -> PathBuf {
    let chosen = std::env::var_os("DRYSTONE_BENCH_MESH").map(PathBuf::from);
    chosen.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/town/town.obj"))
}

fn scanned(folder: &Path) -> Scan {
    let options = ScanOptions::default();
    scan(&[mesh_path()], folder, &options, &Silent).expect("a mesh that can be read")
}

fn cut(scan: &Scan, folder: &Path) -> Partition {
    let options = PartitionOptions {
        cluster_faces: CLUSTER_FACES,
        pass: 0,
        weld: true,
        drop_doubles: false,
        drop_texcoords: false,
        threads: 1,
        work_bytes: WORK_BYTES,
    };
    partition(&scan.mesh, &scan.catalogue, folder, "bench", &options).expect("a partition")
}

/// The largest cluster, with its texture coordinates in units of length, and its number.
fn largest(scan: &Scan, partition: &Partition) -> (ClusterSource, ClusterId, TextureScale) {
    let number = partition.clusters().max_by_key(|&c| partition.face_count(c)).expect("a cluster");
    let faces = reading::read(partition, &scan.mesh, number).expect("a cluster");
    let mut areas = scan.catalogue.per_material(MaterialArea::default());
    faces.add_areas(&scan.catalogue, &mut areas);
    let scale = TextureScale::new(&areas);
    (faces.into_source(partition, &scan.catalogue, &scale), number, scale)
}

/// Rings, classes and quadrics of a mesh.
struct Prepared {
    rings: Rings,
    classes: TiVec<LocalVertex, Class>,
    cost: SurfaceCost,
}

impl Prepared {
    fn new(mesh: &ClusterMesh) -> Self {
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        let mut cost = SurfaceCost::new(Weights::default());
        cost.refresh(mesh, &rings, &classes);
        Self { rings, classes, cost }
    }

    /// Sum of the costs of all collapses of vertices inside a chart.
    fn evaluate(&self, mesh: &ClusterMesh) -> f64 {
        let mut sum = 0.0;
        for from in mesh.vertex_ids().filter(|&vertex| self.classes[vertex] == Class::Smooth) {
            for &corner in self.rings.of(from) {
                let to = mesh.end_of(corner.next());
                let wedges = [WedgePair { from: mesh.wedge_of(corner), to: to.wedge }];
                let edge = EdgeCase {
                    from,
                    to: to.vertex,
                    onto: false,
                    stays: true,
                    wedges: &wedges,
                    insets: [glam::Vec2::ZERO; 2],
                };
                sum += self.cost.place(mesh, &edge).cost;
            }
        }
        sum
    }
}

fn kernels(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scan = scanned(folder.path());
    let mut group = criterion.benchmark_group("kernels");
    group.sample_size(10);

    group.throughput(Throughput::Elements(scan.triangles));
    let place = folder.path().join("scan");
    group.bench_function("scan", |bench| {
        bench.iter_batched(
            || {
                let _ = fs::remove_dir_all(&place);
                fs::create_dir(&place).expect("a folder");
            },
            |()| scanned(&place).triangles,
            BatchSize::PerIteration,
        );
    });
    group.bench_function("partition", |bench| bench.iter(|| cut(&scan, folder.path()).total_faces()));

    let partition = cut(&scan, folder.path());
    let (source, number, scale) = largest(&scan, &partition);
    let mesh = source.mesh;
    group.throughput(Throughput::Elements(mesh.face_count as u64));
    group.bench_function("load", |bench| {
        let load = || cluster::load(&partition, &scan.mesh, &scan.catalogue, &scale, number).expect("a cluster");
        bench.iter(|| load().mesh.face_count);
    });
    group.bench_function("quadrics", |bench| bench.iter(|| Prepared::new(black_box(&mesh)).cost.area()));
    let prepared = Prepared::new(&mesh);
    group.bench_function("evaluation", |bench| bench.iter(|| prepared.evaluate(black_box(&mesh))));
    let goal = mesh.face_count / 4;
    group.bench_function("collapse", |bench| {
        bench.iter_batched(
            || Engine::<SurfaceCost>::new(mesh.clone(), &Weights::default()),
            |mut engine| {
                engine.run(Stop::Faces(goal));
                engine.mesh.face_count
            },
            BatchSize::PerIteration,
        );
    });
    group.finish();
}

criterion_group!(benches, kernels);
criterion_main!(benches);
