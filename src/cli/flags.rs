//! The flags of a run, and the options that they are.

use std::path::PathBuf;

use clap::Args;

use crate::base::{bytes, quantity};
use crate::job::stage::Lending;
use crate::options::{
    Borders, CLUSTER_FACES, Doubles, FaceTarget, ImageFormat, JobOptions, Limits, MetricChoice, Normals, Pieces,
    ReportNotes, ResumeChoice, Seams, SimplifyOptions, Target, TextureFiles, TexturesOutside, Topology, UpAxis, Weld,
};
use crate::remesh::cvd;

/// Headings of `--help`, in the order in which it prints them.
pub mod heading {
    /// How far to simplify.
    pub const TARGET: &str = "Target";
    /// What is read, and what holds while it is simplified.
    pub const INPUT: &str = "Input";
    /// Texture seams and images.
    pub const TEXTURE: &str = "Texture";
    /// Memory, threads, files.
    pub const JOB: &str = "Job";
    /// What is said afterwards.
    pub const REPORT: &str = "Report";
    /// Published methods and their parameters.
    pub const PAPERS: &str = "Methods of papers";
}

/// What a job may take of the machine, and where it keeps its files.
#[derive(Debug, Clone, Args)]
pub struct JobFlags {
    /// Memory that the program may use
    ///
    /// At least 128MiB [default: half of the machine's or cgroup's]
    #[arg(long, value_name = "SIZE", value_parser = bytes::parse, help_heading = heading::JOB)]
    memory: Option<u64>,

    /// Number of threads, at most one for every 32 MiB of memory
    ///
    /// The result does not depend on it [default: one per processor]
    #[arg(long, value_name = "COUNT", value_parser = quantity::parse_whole::<usize>, help_heading = heading::JOB)]
    threads: Option<usize>,

    /// Folder for intermediate files [default: OUTPUT.work]
    #[arg(long, value_name = "DIR", help_heading = heading::JOB)]
    work: Option<PathBuf>,

    /// What to do with an unfinished job in the work folder
    #[arg(long, value_enum, default_value_t = ResumeChoice::Auto, value_name = "HOW", hide_short_help = true, help_heading = heading::JOB)]
    resume: ResumeChoice,

    /// Keep the work folder after success; the same command then ends at once
    #[arg(long, help_heading = heading::JOB, hide_short_help = true)]
    keep_work: bool,

    /// Do not wait until files are on the disk: faster on slow disks
    ///
    /// A power cut may then cost the job and damage the result. A killed job still resumes
    #[arg(long, help_heading = heading::JOB, hide_short_help = true)]
    no_sync: bool,

    /// Command that has tasks done on other machines: docs/guide/machines.md
    ///
    /// The shell runs it once for each stage of the job, with {stage} replaced by the stage's file, {count} by the
    /// number of its tasks, {last} by the number of the last task. It runs `drystone task {stage} INDEX` for each INDEX
    /// from 0 to {last}, and exits when all tasks have ended, also those that failed. The result has the same bytes
    #[arg(long, value_name = "COMMAND", help_heading = heading::JOB, hide_short_help = true)]
    task_runner: Option<String>,

    /// With --task-runner: tasks of a stage, at most; 8 for each machine is good
    #[arg(long, value_name = "COUNT", default_value_t = Lending::TASKS, help_heading = heading::JOB, hide_short_help = true)]
    #[arg(value_parser = quantity::parse_whole::<u32>)]
    tasks: u32,

    /// With --task-runner: how often a stage is handed out while tasks of it have no result
    #[arg(long, value_name = "COUNT", default_value_t = Lending::TRIES, help_heading = heading::JOB, hide_short_help = true)]
    #[arg(value_parser = quantity::parse_whole::<u32>)]
    task_tries: u32,
}

impl JobFlags {
    /// Memory and threads.
    pub fn limits(&self) -> Limits {
        Limits { memory: self.memory, threads: self.threads }
    }

    /// Files of a job that may replace others only with `force`.
    pub fn options(&self, force: bool) -> JobOptions {
        JobOptions {
            work: self.work.clone(),
            resume: self.resume,
            keep_work: self.keep_work,
            no_sync: self.no_sync,
            force,
            task_runner: self.task_runner.clone(),
            hands: None,
            tasks: self.tasks,
            task_tries: self.task_tries,
        }
    }
}

/// Flags of `drystone simplify` and `drystone plan`.
#[derive(Debug, Clone, Args)]
pub struct SimplifyFlags {
    /// Share of the triangles to keep, above 0 and up to 1, such as 0.1 or 10%
    #[arg(long, value_name = "SHARE", group = "target", allow_negative_numbers = true, help_heading = heading::TARGET)]
    #[arg(value_parser = quantity::parse_share)]
    ratio: Option<f64>,

    /// Number of triangles to keep, such as 50000, 50k or 1.5M
    #[arg(long, value_name = "COUNT", group = "target", allow_negative_numbers = true, help_heading = heading::TARGET)]
    #[arg(value_parser = quantity::parse_count)]
    faces: Option<u64>,

    /// Largest distance between result and input, in the mesh's unit of length
    ///
    /// Holds for every point of both surfaces. The result has as few triangles as it allows; 0 removes only what changes
    /// nothing. With --ratio or --faces, the run stops at the limit that it reaches first
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true, help_heading = heading::TARGET)]
    #[arg(value_parser = quantity::parse_length)]
    max_error: Option<f64>,

    /// How to simplify open borders
    #[arg(long, value_enum, default_value_t = Borders::Simplify, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    borders: Borders,

    /// Whether to merge vertices at the same position
    #[arg(long, value_enum, default_value_t = Weld::Exact, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    weld: Weld,

    /// What to do with connected components smaller than the error
    #[arg(long, value_enum, default_value_t = Pieces::Keep, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    pieces: Pieces,

    /// Whether holes, handles and components may go. With --borders lock or --seams lock they stay
    #[arg(long, value_enum, default_value_t = Topology::Simplify, value_name = "HOW", hide_short_help = true, help_heading = heading::TARGET)]
    topology: Topology,

    /// What to do with copies and back sides of faces
    #[arg(long, value_enum, default_value_t = Doubles::Keep, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    doubles: Doubles,

    /// How to write normals
    #[arg(long, value_enum, default_value_t = Normals::Auto, value_name = "HOW", help_heading = heading::INPUT, hide_short_help = true)]
    normals: Normals,

    /// Which axis points up, for a GLB
    #[arg(long, value_enum, default_value_t = UpAxis::Z, value_name = "AXIS", help_heading = heading::INPUT, hide_short_help = true)]
    up: UpAxis,

    /// How to simplify texture seams
    ///
    /// [default: stitch, but follow with the metrics of papers]
    #[arg(long, value_enum, value_name = "HOW", help_heading = heading::TEXTURE)]
    seams: Option<Seams>,

    /// How to write texture images
    #[arg(long, value_enum, value_name = "HOW", default_value_t = TextureFiles::Copy, help_heading = heading::TEXTURE)]
    textures: TextureFiles,

    /// What to do with images that an MTL names outside its own folder, also by absolute paths
    #[arg(long, value_enum, value_name = "HOW", default_value_t = TexturesOutside::Refer, help_heading = heading::TEXTURE)]
    #[arg(hide_short_help = true)]
    textures_outside: TexturesOutside,

    /// With --textures bake: texels, as a share of those that the input shows, above 0 and up to 16
    #[arg(long, value_name = "SHARE", default_value_t = 1.0, allow_negative_numbers = true, help_heading = heading::TEXTURE)]
    #[arg(value_parser = quantity::parse_number, hide_short_help = true)]
    texels: f64,

    /// With --textures bake: largest side of an image in texels, a power of two from 256 to 16384
    #[arg(long, value_name = "SIDE", default_value_t = 4096, help_heading = heading::TEXTURE, hide_short_help = true)]
    #[arg(value_parser = quantity::parse_whole::<u32>)]
    atlas: u32,

    /// With --textures bake: format of the images: png, jpeg (quality 90), or jpeg:QUALITY, from 1 to 100 [default: png]
    #[arg(long, value_name = "FORMAT", help_heading = heading::TEXTURE, hide_short_help = true)]
    image: Option<ImageFormat>,

    /// With the metric qem-attributes: weight of texture drift, 0 to 1000; at 1 drift costs as much as distance
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.7, allow_negative_numbers = true, help_heading = heading::TEXTURE)]
    #[arg(value_parser = quantity::parse_number, hide_short_help = true)]
    uv_weight: f64,

    #[command(flatten)]
    job: JobFlags,

    /// Replace an existing output
    #[arg(long, help_heading = heading::JOB)]
    force: bool,

    /// Approximate triangles per cluster, 1000 to 10 million. Changes memory a lot and the result slightly
    #[arg(long, value_name = "COUNT", default_value_t = CLUSTER_FACES, help_heading = heading::JOB, hide_short_help = true)]
    #[arg(value_parser = quantity::parse_count)]
    cluster_faces: u64,

    /// Passes over shifted clusters, 1 to 16
    ///
    /// The run adds up to 12 passes if the target is far below the input, or if locked borders of clusters keep it out of
    /// reach. If --max-error ends them, a single cluster takes one pass, and several take passes until one
    /// removes less than 2 % of the triangles
    #[arg(long, value_name = "COUNT", default_value_t = 3, help_heading = heading::JOB, hide_short_help = true)]
    #[arg(value_parser = quantity::parse_whole::<usize>)]
    passes: usize,

    /// Cost of a collapse [default: qem-attributes with texture, else qem]
    #[arg(long, value_enum, help_heading = heading::PAPERS, hide_short_help = true)]
    metric: Option<MetricChoice>,

    /// Set a parameter of the metric, such as border=2; may be repeated. docs/guide/choosing.md lists the parameters
    #[arg(long, value_name = "NAME=VALUE", help_heading = heading::PAPERS, hide_short_help = true)]
    metric_option: Vec<String>,

    /// Before simplifying, remesh by centroidal Voronoi cells, denser where the surface bends (Liu, Chen & Wang 2020).
    /// cvd:2 sets the power of the curvature; cvd:cells=5000 stops at 5000 cells. docs/guide/choosing.md lists the settings
    #[arg(long, value_name = "cvd[:SETTINGS]", help_heading = heading::PAPERS, hide_short_help = true)]
    remesh: Option<cvd::CvdSettings>,

    /// After simplifying, move the vertices of slivers to the middle of their neighbours (Li, Jiang & Tang 2020).
    /// Triangles get rounder, the error grows
    #[arg(long, help_heading = heading::PAPERS, hide_short_help = true)]
    optimize: bool,

    /// Collapse one edge at a time, always the cheapest, as the heaps of the papers do. The time grows with the square of
    /// the triangles of a cluster
    #[arg(long, help_heading = heading::PAPERS, hide_short_help = true)]
    one_by_one: bool,
}

impl SimplifyFlags {
    /// Format of the images, if one is given.
    pub fn image(&self) -> Option<ImageFormat> {
        self.image
    }

    /// The options that the flags are.
    pub fn options(&self) -> SimplifyOptions {
        let flags = self.clone();
        let faces = flags.ratio.map(FaceTarget::Ratio).or(flags.faces.map(FaceTarget::Count));
        SimplifyOptions {
            target: Target { faces, max_error: flags.max_error },
            borders: flags.borders,
            weld: flags.weld,
            pieces: flags.pieces,
            topology: flags.topology,
            doubles: flags.doubles,
            normals: flags.normals,
            up: flags.up,
            seams: flags.seams,
            textures: flags.textures,
            textures_outside: flags.textures_outside,
            texels: flags.texels,
            atlas: flags.atlas,
            image: flags.image.unwrap_or(ImageFormat::Png),
            uv_weight: flags.uv_weight,
            limits: flags.job.limits(),
            job: flags.job.options(flags.force),
            cluster_faces: flags.cluster_faces,
            passes: flags.passes,
            metric: flags.metric,
            metric_option: flags.metric_option,
            remesh: flags.remesh,
            optimize: flags.optimize,
            one_by_one: flags.one_by_one,
            notes: ReportNotes::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Alone {
        #[command(flatten)]
        flags: SimplifyFlags,
    }

    #[test]
    fn no_flag_means_the_defaults_of_the_library() {
        assert_eq!(Alone::parse_from(["drystone"]).flags.options(), SimplifyOptions::default());
    }
}
