//! What a program that calls the library keeps for itself. The only test of this process, so that nothing else touches
//! what the process has once.

mod meshes;

use drystone::{Silent, Simplify};
use meshes::{ratio, rms_distance, simplify, town};

#[test]
fn the_thread_pool_and_the_memory_of_the_host_stay_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("town.obj");
    let call = Simplify::new(town()).to(&output).ratio(0.2).threads(2).with(|options| options.cluster_faces = 1000);
    let report = call.run(&Silent).unwrap();
    // The memory of this process is not that of the job alone.
    assert_eq!(report.memory.peak_resident, None);
    assert!(!report.summary().contains("peak memory"));
    let run = simplify(&town(), &ratio(0.3));
    assert!(rms_distance(&town(), &run) > 0.0);
    run.mesh().check();
    // The global pool can be built once; it was not.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().unwrap();
}
