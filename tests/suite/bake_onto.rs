//! New textures for meshes that other programs made.

use std::fs;
use std::path::{Path, PathBuf};

use drystone::options::{Limits, SimplifyOptions, TextureFiles};
use drystone::read::InputChoice;
use drystone::{Error, Progress, Silent, Target, bake_textures, pipeline};

use crate::bake::compared;
use crate::meshes::{StopAfter, contents, copy_town, ratio, simplify, town};

/// A folder with the town in `in`, and a tenth of its triangles in `coarse.obj`, without texture.
struct Job(tempfile::TempDir);

impl Job {
    fn new() -> Self {
        let job = Self(tempfile::tempdir().unwrap());
        copy_town(&job.path("in"));
        let baked = simplify(&town(), &SimplifyOptions { textures: TextureFiles::Bake, ..ratio(0.1) });
        fs::write(job.path("coarse.obj"), bare(&baked.output)).unwrap();
        job
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn bake(&self, to: &str, options: &SimplifyOptions, progress: &dyn Progress) -> Result<(), Error> {
        fs::create_dir_all(self.path(to)).unwrap();
        let output = self.path(to).join("out.obj");
        bake_textures(self.path("in/town.obj"), self.path("coarse.obj"), output, options, progress).map(drop)
    }

    /// Bakes to `out` until the job has recorded something.
    fn stop_midway(&self, options: &SimplifyOptions) {
        let stopped = (20..).step_by(10).find(|&units| {
            matches!(self.bake("out", options, &StopAfter::units(units)), Err(Error::Stopped))
                && self.path("out/out.obj.work/journal.bin").metadata().is_ok_and(|journal| journal.len() > 500)
        });
        assert!(stopped.is_some());
    }
}

/// Positions and faces of an OBJ.
fn bare(path: &Path) -> String {
    let face = |line: &str| {
        let corners = line.split(' ').skip(1).map(|corner| corner.split('/').next().unwrap());
        format!("f {}\n", corners.collect::<Vec<_>>().join(" "))
    };
    let text = fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| line.starts_with("v ") || line.starts_with("f "));
    lines.map(|line| if line.starts_with('f') { face(line) } else { format!("{line}\n") }).collect()
}

#[test]
fn a_bare_mesh_gets_the_colours_of_its_original() {
    let job = Job::new();
    job.bake("out", &SimplifyOptions::default(), &Silent).unwrap();
    let output = job.path("out/out.obj");
    assert_eq!(bare(&output).lines().count(), bare(&job.path("coarse.obj")).lines().count());
    let own = simplify(&town(), &SimplifyOptions { textures: TextureFiles::Bake, ..ratio(0.1) });
    let [found, expected] = [&output, &own.output].map(|path| compared(&town(), path));
    assert_eq!(found.geometry.area.after, expected.geometry.area.after);
    let [found, expected] = [found, expected].map(|figures| figures.texture.unwrap().colour_rms);
    assert!(found < 1.05 * expected, "{found} {expected}");
    assert!(!job.path("out/out.obj.work").exists());
}

#[test]
fn stops_and_threads_leave_no_trace() {
    let job = Job::new();
    let options = SimplifyOptions { atlas: 512, texels: 0.5, ..SimplifyOptions::default() };
    job.bake("whole", &options, &Silent).unwrap();
    let whole = contents(&job.path("whole"));
    let limits = Limits { threads: Some(1), memory: Some(128 << 20) };
    job.bake("one", &SimplifyOptions { limits, ..options.clone() }, &Silent).unwrap();
    assert!(contents(&job.path("one")) == whole);
    let mut stops = 0;
    while let Err(error) = job.bake("parts", &options, &StopAfter::units(10 + 5 * stops)) {
        assert!(matches!(error, Error::Stopped) && stops < 1000, "{error}");
        stops += 1;
    }
    assert!(stops > 2 && contents(&job.path("parts")) == whole);
}

#[test]
fn a_mesh_that_changed_is_noticed_and_files_stay() {
    let job = Job::new();
    let options = SimplifyOptions { atlas: 512, ..SimplifyOptions::default() };
    job.stop_midway(&options);
    // Mesh and original swapped, and the same files without a mesh among them.
    let output = job.path("out/out.obj");
    let swapped = bake_textures(job.path("coarse.obj"), job.path("in/town.obj"), &output, &options, &Silent);
    let message = swapped.unwrap_err().to_string();
    assert!(
        message.contains("`mesh` was file 1 of the input, coarse.obj, is file 2 of the input, town.obj"),
        "{message}"
    );
    let paths = vec![job.path("coarse.obj"), job.path("in/town.obj")];
    let both = InputChoice { paths, ..InputChoice::default() };
    let alike = SimplifyOptions { target: Target::ratio(1.0), textures: TextureFiles::Bake, ..options.clone() };
    let simplified = pipeline::simplify(both, &output, &alike, &Silent);
    assert!(matches!(simplified, Err(Error::Changed(_))), "{simplified:?}");
    let text = fs::read_to_string(job.path("coarse.obj")).unwrap();
    fs::write(job.path("coarse.obj"), text.replacen("v ", "v 1", 1)).unwrap();
    assert!(matches!(job.bake("out", &options, &Silent), Err(Error::Changed(_))));
    let onto = |original: &str, mesh: &str, output: &str| {
        let [original, mesh, output] = [original, mesh, output].map(|name| job.path(name));
        let force =
            SimplifyOptions { job: drystone::JobOptions { force: true, ..Default::default() }, ..options.clone() };
        bake_textures(original, mesh, output, &force, &Silent)
    };
    for [original, mesh, output] in [
        ["in/town.obj", "in/town.obj", "new.obj"],
        ["in/town.obj", "coarse.obj", "coarse.obj"],
        ["in/town.obj", "coarse.obj", "in/town.obj"],
        ["in", "coarse.obj", "in/new.obj"],
    ] {
        assert!(matches!(onto(original, mesh, output), Err(Error::Usage(_))), "{original} {mesh} {output}");
    }
}
