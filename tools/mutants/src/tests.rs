//! The tests, each in a process of its own: which mutants it reaches, how long it takes, and whether it notices one.

use std::collections::BTreeSet;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use std::{fs, io, thread};

use serde::{Deserialize, Serialize};

/// Memory that a test may map, in KiB: a change that makes it allocate without end must not take the machine down.
const MEMORY_KIB: u32 = 8 << 20;
/// How often a running test is looked at.
const INTERVAL: Duration = Duration::from_millis(3);

/// A test of a test program.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Test {
    program: PathBuf,
    pub name: String,
    /// How long it takes without a change.
    pub seconds: f64,
    pub reached: BTreeSet<usize>,
}

/// How a test ended.
#[derive(Debug, PartialEq, Eq)]
pub enum Outcome {
    Passed,
    Failed,
    TimedOut,
}

impl Test {
    /// The tests of a program, not yet recorded.
    pub fn all_of(program: &Path) -> io::Result<Vec<Self>> {
        let output = Command::new(program).args(["--list", "--format", "terse"]).output()?.stdout;
        let output = String::from_utf8_lossy(&output);
        let names = output.lines().filter_map(|line| line.strip_suffix(": test"));
        let test =
            |name: &str| Self { program: program.into(), name: name.into(), seconds: 0.0, reached: BTreeSet::new() };
        Ok(names.map(test).collect())
    }

    /// Runs the test without a change and keeps what it reaches.
    pub fn record(&mut self, project: &Path, scratch: &Path) -> io::Result<Outcome> {
        let file = scratch.with_extension("reached");
        fs::write(&file, "")?;
        let began = Instant::now();
        let outcome =
            self.run(project, scratch, ("DRYSTONE_MUTANTS_REACHED", file.as_os_str()), Duration::from_secs(600))?;
        self.seconds = began.elapsed().as_secs_f64();
        self.reached = fs::read_to_string(&file)?.lines().filter_map(|line| line.parse().ok()).collect();
        Ok(outcome)
    }

    /// Runs the test with one mutant on, for five times its usual time and five seconds.
    pub fn try_on(&self, mutant: usize, project: &Path, scratch: &Path) -> io::Result<Outcome> {
        let limit = Duration::from_secs_f64(5.0 * self.seconds + 5.0);
        self.run(project, scratch, ("DRYSTONE_MUTANT", mutant.to_string().as_ref()), limit)
    }

    fn run(
        &self,
        project: &Path,
        scratch: &Path,
        variable: (&str, &std::ffi::OsStr),
        limit: Duration,
    ) -> io::Result<Outcome> {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")]).arg(&self.program);
        command.args(["--exact", &self.name, "--test-threads", "1"]).current_dir(project).env(variable.0, variable.1);
        // A failure is enough: no smaller one is looked for, and none is kept.
        command.env("PROPTEST_MAX_SHRINK_ITERS", "0").env("CARGO_MANIFEST_DIR", project).env("TMPDIR", scratch);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).process_group(0);
        fs::create_dir_all(scratch)?;
        let mut child = command.spawn()?;
        let outcome = wait(&mut child, limit)?;
        if outcome != Outcome::Passed {
            // What it started may still run.
            let _ =
                Command::new("kill").args(["-KILL", "--", &format!("-{}", child.id())]).stderr(Stdio::null()).status();
            let _ = child.wait();
            let _ = fs::remove_dir_all(scratch);
        }
        Ok(outcome)
    }
}

fn wait(child: &mut Child, limit: Duration) -> io::Result<Outcome> {
    let began = Instant::now();
    loop {
        match child.try_wait()? {
            Some(status) if status.success() => return Ok(Outcome::Passed),
            Some(_) => return Ok(Outcome::Failed),
            None if began.elapsed() > limit => return Ok(Outcome::TimedOut),
            None => thread::sleep(INTERVAL),
        }
    }
}
