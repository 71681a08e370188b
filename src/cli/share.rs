//! Estimates the share of a whole run that is done, from the times that `drystone plan` predicts.
//!
//! ```text
//! scan │ draw │ cut 1 │ pass 1        │ cut 2 │ pass 2 │ … │ bake │ textures │ write │ measure │ draw │ comparison
//!      └─ known once the triangles are counted; until then they are estimated from the bytes
//! ```
//! In: phases as they begin and advance. Out: a share that never falls. The share has no effect on results.

use crate::options::{Drawing, SimplifyOptions, TextureFiles};
use crate::plan::memory::{self, Sizes};
use crate::plan::passes;
use crate::plan::time::{self, InputSize};
use crate::read;
use crate::read::InputChoice;

/// Approximate bytes of an OBJ for each triangle; until the triangles of a PLY are counted, its share is too low.
const BYTES_PER_TRIANGLE: u64 = 70;
/// Approximate seconds of a comparison for each sample on one core; both directions, colours included.
const SECONDS_PER_SAMPLE: f64 = 8e-6;
/// Approximate seconds on one core to draw a mesh, and further seconds for each of its triangles.
const DRAW_SECONDS: f64 = 1.0;
const DRAW_SECONDS_PER_TRIANGLE: f64 = 4e-6;
/// Approximate seconds to measure the deviation, for each triangle of the input.
const GAUGE_SECONDS_PER_TRIANGLE: f64 = 3e-7;
/// Time to copy textures, as a multiple of the time to write the mesh; the size of the textures is unknown.
const TEXTURES_PER_WRITE: f64 = 0.3;
/// Approximate seconds on one core to bake as many texels as the input shows, for each of its triangles; a part of them
/// is for decoding its images.
const BAKE_SECONDS_PER_TRIANGLE: f64 = 4e-5;
const DECODE_SHARE: f64 = 0.1;
/// Number of phases of a comparison.
const COMPARISON_PHASES: f64 = 11.0;

/// Progress of a run.
#[derive(Debug, Clone)]
pub struct JobShare {
    options: SimplifyOptions,
    threads: usize,
    input: InputSize,
    comparison: f64,
    /// Predicted seconds: of the scan, of drawing input and result, of partitioning and of simplifying in each pass, of
    /// baking, of copying textures, of writing, of measuring.
    scan: f64,
    draw: [f64; 2],
    passes: Vec<[f64; 2]>,
    bake: f64,
    textures: f64,
    write: f64,
    gauge: f64,
    has_triangles: bool,
    pass: usize,
    /// Begin and end of the current phase, in predicted seconds.
    phase: [f64; 2],
    /// Predicted seconds of the phases that an earlier process completed.
    skipped: f64,
    has_written: bool,
    /// Number of phases of the comparison that began.
    compared: f64,
    share: f64,
}

impl JobShare {
    /// A run that has not begun, followed by a comparison with `samples` samples.
    pub fn of(input: &InputChoice, options: &SimplifyOptions, samples: u64) -> Self {
        let files = read::find_inputs(input).unwrap_or_default();
        let bytes = files.iter().filter_map(|path| path.metadata().ok()).map(|meta| meta.len()).sum();
        let input = InputSize { files: files.len() as u64, bytes };
        let budget = memory::choose_budget(options);
        let threads = budget.map_or(1, |budget| memory::choose_threads(options.limits.threads, budget)).max(1);
        Self::new(options, input, threads, samples)
    }

    fn new(options: &SimplifyOptions, input: InputSize, threads: usize, samples: u64) -> Self {
        let mut share = Self {
            options: options.clone(),
            threads,
            input,
            comparison: samples as f64 * SECONDS_PER_SAMPLE / threads as f64,
            scan: 0.0,
            draw: [0.0; 2],
            passes: Vec::new(),
            bake: 0.0,
            textures: 0.0,
            write: 0.0,
            gauge: 0.0,
            has_triangles: false,
            pass: 0,
            phase: [0.0; 2],
            skipped: 0.0,
            has_written: false,
            compared: 0.0,
            share: 0.0,
        };
        share.predict(input.bytes / BYTES_PER_TRIANGLE);
        share
    }

    fn predict(&mut self, triangles: u64) {
        let Self { options, threads, input, .. } = &*self;
        let target = options.most_faces(triangles);
        let sizes = Sizes::of(triangles, triangles / 2, options);
        let found = passes::forecast(&sizes, options.pass_count(triangles));
        let upto = |count: usize| time::forecast(*input, &found[..count], target, *threads);
        let each = |count: usize| {
            let (before, after) = (upto(count), upto(count + 1));
            [after.partition - before.partition, after.simplify - before.simplify]
        };
        let (start, each) = (upto(0), (0..found.len()).map(each).collect());
        let drawn = |triangles: u64| match options.notes.drawing {
            Drawing::Nothing => 0.0,
            _ => (DRAW_SECONDS + DRAW_SECONDS_PER_TRIANGLE * triangles as f64) / *threads as f64,
        };
        let draw = [drawn(triangles), drawn(target)];
        let textures = match options.textures {
            TextureFiles::Copy | TextureFiles::Bake => TEXTURES_PER_WRITE * start.write,
            TextureFiles::Link | TextureFiles::Reference => 0.0,
        };
        let texels = if options.bakes() { options.texels } else { 0.0 };
        let bake = BAKE_SECONDS_PER_TRIANGLE * texels.sqrt() * triangles as f64 / *threads as f64;
        self.scan = start.scan;
        self.draw = draw;
        self.passes = each;
        self.bake = bake;
        self.textures = textures;
        self.write = start.write;
        self.gauge = GAUGE_SECONDS_PER_TRIANGLE * triangles as f64;
    }

    /// Predicted seconds of the whole run.
    pub fn predicted_seconds(&self) -> f64 {
        let passes: f64 = self.passes.iter().flatten().sum();
        let end = self.bake + self.textures + self.write + self.gauge + self.comparison;
        self.scan + self.draw.iter().sum::<f64>() + passes + end
    }

    /// Number of the current pass: `pass 2 of 4`. A pass beyond the expected number is shown as the last one.
    pub fn pass(&self) -> Option<String> {
        (self.pass > 0).then(|| format!("pass {} of {}", self.pass, self.passes.len().max(self.pass)))
    }

    /// Begins a pass, counted from 1.
    pub fn begin_pass(&mut self, number: usize) {
        self.pass = number;
    }

    /// Begins a phase.
    pub fn begin(&mut self, phase: &str, total: u64) {
        let is_first = self.pass <= 1;
        let is_pass = matches!(phase, "simplify" | "stitch" | "remesh" | "weigh");
        if is_pass && is_first && !self.has_triangles {
            self.has_triangles = true;
            self.predict(if phase == "weigh" { total / 2 } else { total });
        }
        let ended = self.pass.saturating_sub(1).min(self.passes.len());
        let start = self.scan + self.draw[0];
        let before: f64 = start + self.passes[..ended].iter().flatten().sum::<f64>();
        let [cut, simplify] = self.passes.get(ended).copied().unwrap_or_default();
        let all = start + self.passes.iter().flatten().sum::<f64>();
        let decoded = all + DECODE_SHARE * self.bake;
        let baked = all + self.bake;
        let copied = baked + self.textures;
        let written = copied + self.write;
        let measured = written + self.gauge;
        let drawn = measured + self.draw[1];
        let end = self.phase[1];
        self.phase = match phase {
            "measure" => [written, measured],
            "draw" if self.has_written => [measured, drawn],
            _ if self.has_written => self.next_of_comparison(drawn),
            "scan" => [0.0, self.scan],
            "draw" => [self.scan, start],
            "partition" if self.pass > 0 => [before, before + cut],
            _ if is_pass => [before + cut, before + cut + simplify],
            "decode" => [all, decoded],
            "bake" => [decoded, baked],
            "collect" => [baked, baked],
            "textures" => [baked, copied],
            "write" => [copied, written],
            _ => [end; 2],
        };
        self.skipped += (self.phase[0] - end).max(0.0);
        if matches!(phase, "decode" | "collect" | "textures" | "write") {
            self.pass = 0;
        }
        self.has_written |= phase == "write";
        self.advance(0.0);
    }

    fn next_of_comparison(&mut self, start: f64) -> [f64; 2] {
        let step = |number: f64| start + self.comparison * (number / COMPARISON_PHASES).min(1.0);
        self.compared += 1.0;
        [step(self.compared - 1.0), step(self.compared)]
    }

    /// Records the share of the phase that is done; returns that of the whole run.
    pub fn advance(&mut self, of_phase: f64) -> f64 {
        let [begin, end] = self.phase;
        let done = begin + (end - begin) * of_phase.clamp(0.0, 1.0);
        let share = done / self.predicted_seconds().max(f64::MIN_POSITIVE);
        self.share = self.share.max(share.clamp(0.0, 1.0));
        self.share
    }
}

impl JobShare {
    /// Approximate seconds left, if this process has taken `elapsed` so far; `None` while too little is done for an
    /// estimate.
    pub fn seconds_left(&self, elapsed: f64) -> Option<f64> {
        let predicted = self.predicted_seconds();
        let done = self.share * predicted - self.skipped;
        (done > 0.02 * predicted).then(|| elapsed * (1.0 - self.share) * predicted / done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{ReportNotes, Target};
    use proptest::prelude::*;

    fn city() -> JobShare {
        let options = SimplifyOptions { target: Target::ratio(0.1), ..SimplifyOptions::default() };
        JobShare::new(&options, InputSize { files: 1, bytes: 300 << 20 }, 2, 0)
    }

    #[test]
    fn drawing_textures_and_measuring_have_their_shares() {
        let options = SimplifyOptions {
            target: Target::ratio(0.1),
            notes: ReportNotes { drawing: Drawing::Renderings, ..ReportNotes::default() },
            ..SimplifyOptions::default()
        };
        let mut share = JobShare::new(&options, InputSize { files: 1, bytes: 300 << 20 }, 2, 1_000_000);
        let mut last = 0.0;
        for phase in ["scan", "draw", "textures", "write", "measure", "draw", "partition", "compare"] {
            share.begin(phase, 0);
            let now = share.advance(1.0);
            assert!(now > last && now < 1.0, "{phase}: {last} {now}");
            last = now;
        }
    }

    #[test]
    fn a_run_goes_from_nothing_to_all() {
        let mut share = city();
        let mut last = 0.0;
        share.begin("scan", 300 << 20);
        for pass in 1..=4 {
            share.begin_pass(pass);
            for phase in ["partition", "stitch"] {
                share.begin(phase, 4_313_336 >> pass);
                let now = share.advance(1.0);
                assert!(now > last && now < 1.0, "pass {pass}, {phase}: {last} {now}");
                last = now;
            }
            assert_eq!(share.pass(), Some(format!("pass {pass} of 4")));
        }
        share.begin("write", 1_000_000);
        assert_eq!(share.pass(), None);
        assert!(share.advance(1.0) < 1.0);
        share.begin("measure", 0);
        assert!((share.advance(1.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_an_earlier_process_did_does_not_count_as_speed() {
        let mut share = city();
        share.begin_pass(3);
        share.begin("partition", 0);
        assert_eq!(share.seconds_left(1.0), None);
        share.begin("stitch", 1_200_000);
        share.advance(1.0);
        let whole = share.predicted_seconds();
        assert!(share.seconds_left(whole / 10.0).is_some_and(|left| left > whole / 20.0 && left < whole));
    }

    proptest! {
        #[test]
        fn the_share_never_falls_and_never_passes_all(steps in prop::collection::vec((0_usize..9, 0_usize..6, 0.0..1.5_f64), 0..60)) {
            let names = ["scan", "compare", "partition", "weigh", "remesh", "simplify", "stitch", "textures", "write"];
            let mut share = city();
            let mut last = 0.0;
            for (name, pass, done) in steps {
                if pass > 0 {
                    share.begin_pass(pass);
                }
                share.begin(names[name], 1000);
                let now = share.advance(done);
                prop_assert!(now >= last && now <= 1.0);
                last = now;
            }
        }
    }
}
