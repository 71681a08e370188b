//! Changes the program in one place at a time and tells which changes no test notices; see `--help`.

mod checkout;
mod find;
mod switch;
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::{fs, io, thread};

use checkout::Checkout;
use clap::Parser;
use serde::{Deserialize, Serialize};
use tests::{Outcome, Test};

/// Changes the program in one place at a time and tells which changes no test notices.
///
/// All changes of these files are built at once into a copy of the checkout (target/mutants/checkout), each behind a switch. One run
/// of every test records which switches it reaches; then each change is tried with the tests that reach it, the
/// shortest first, until one fails. Run it in the top folder of the project:
///
///     cargo run --release --manifest-path tools/mutants/Cargo.toml -- src/simplify src/os/durable.rs
///
/// What has been tried is kept in target/mutants/results.tsv, and a later run goes on after it in files that are the
/// same. Tests that need data from outside the checkout skip. A change that makes a test hang counts as noticed. Exit
/// code 1: there are survivors.
#[derive(Parser)]
struct Arguments {
    /// Source files and folders whose changes are tried, in this order
    #[arg(default_value = "src")]
    paths: Vec<PathBuf>,
    /// Try only N changes, drawn at random
    #[arg(long, value_name = "N")]
    sample: Option<usize>,
    /// Number that the draw depends on
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Use only tests that take at most this long without a change
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    slowest: f64,
    /// Use unit tests only
    #[arg(long)]
    unit: bool,
    /// Try what survived before once more, and nothing else
    #[arg(long)]
    survivors: bool,
    /// Print the changes and try none
    #[arg(long)]
    list: bool,
}

/// What was compiled and recorded, for these sources.
#[derive(Default, Serialize, Deserialize)]
struct Recorded {
    sources: u64,
    left_out: BTreeSet<usize>,
    tests: Vec<Test>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(survivors) if survivors > 0 => ExitCode::from(1),
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("mutants: {error}");
            ExitCode::from(2)
        }
    }
}

/// Returns how many changes no test noticed.
fn run(arguments: &Arguments) -> io::Result<usize> {
    let project = std::env::current_dir()?;
    if !project.join("src/lib.rs").is_file() || !project.join("tools/mutants").is_dir() {
        return Err(io::Error::other("run it in the top folder of the project"));
    }
    let under = project.join("target/mutants");
    let mut checkout = Checkout::new(&project, &under, &arguments.paths)?;
    if arguments.list {
        chosen(arguments, &checkout).into_iter().for_each(|number| println!("{}", checkout.mutants[number - 1]));
        return Ok(0);
    }
    let tests = record(&mut checkout, &under, arguments.unit)?;

    let results = under.join("results.tsv");
    let known = read_results(&results);
    let verdict = |number: usize| known.get(&checkout.key(number)).map(String::as_str);
    let (mut again, mut settled) = (Vec::new(), Vec::new());
    for number in chosen(arguments, &checkout) {
        let survived = matches!(verdict(number), Some("survived" | "not reached"));
        match verdict(number) {
            None if !arguments.survivors => again.push(number),
            Some(_) if arguments.survivors && survived => again.push(number),
            Some(verdict) => settled.push((number, verdict.to_owned())),
            None => {}
        }
    }
    eprintln!("{} changes to try, {} tried before, {} tests", again.len(), settled.len(), tests.len());
    let tried = try_all(&again, &checkout, &tests, arguments.slowest, &under)?;
    settled.extend(tried);
    settled.sort();
    Ok(print_summary(&settled, &checkout))
}

/// The numbers of the changes to try, in the order of the paths or as they are drawn.
fn chosen(arguments: &Arguments, checkout: &Checkout) -> Vec<usize> {
    let mut chosen: Vec<usize> =
        (1..=checkout.mutants.len()).filter(|number| !checkout.left_out.contains(number)).collect();
    let named =
        |&number: &usize| arguments.paths.iter().position(|path| checkout.mutants[number - 1].file.starts_with(path));
    chosen.sort_by_key(named);
    if let Some(count) = arguments.sample {
        chosen.sort_by_key(|number| hash_of(&(arguments.seed, number)));
        chosen.truncate(count);
    }
    chosen
}

/// Compiles the copy and runs every test once, unless that was done for the same sources.
fn record(checkout: &mut Checkout, under: &Path, unit: bool) -> io::Result<Vec<Test>> {
    let path = under.join("recorded.json");
    let sources = hash_of(&(checkout.fingerprint(), unit));
    let kept = fs::read(&path).ok().and_then(|bytes| serde_json::from_slice::<Recorded>(&bytes).ok());
    if let Some(kept) = kept.filter(|kept| kept.sources == sources) {
        checkout.left_out = kept.left_out;
        return Ok(kept.tests);
    }
    checkout.leave_out_what_does_not_compile()?;
    eprintln!("{} mutants, {} do not compile; compiling the tests", checkout.mutants.len(), checkout.left_out.len());
    let programs = checkout.build_tests(unit)?;
    let tests = programs.iter().map(|program| Test::all_of(program)).collect::<io::Result<Vec<_>>>()?.concat();
    eprintln!("recording {} tests", tests.len());
    let recorded = in_parallel(tests, under, |mut test, scratch| {
        let outcome = test.record(&checkout.folder, scratch)?;
        if outcome != Outcome::Passed {
            eprintln!("left out, fails without any change: {}", test.name);
        }
        Ok((outcome == Outcome::Passed).then_some(test))
    })?;
    let mut tests: Vec<Test> = recorded.into_iter().flatten().filter(|test| !test.reached.is_empty()).collect();
    tests.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    let recorded = Recorded { sources, left_out: checkout.left_out.clone(), tests };
    fs::write(&path, serde_json::to_vec(&recorded)?)?;
    Ok(recorded.tests)
}

/// Tries mutants, keeps each verdict, and prints the survivors as they are found.
fn try_all(
    numbers: &[usize],
    checkout: &Checkout,
    tests: &[Test],
    slowest: f64,
    under: &Path,
) -> io::Result<Vec<(usize, String)>> {
    let file = Mutex::new(fs::OpenOptions::new().create(true).append(true).open(under.join("results.tsv"))?);
    in_parallel(numbers.to_vec(), under, |number, scratch| {
        let mut verdict = "not reached";
        for test in tests.iter().filter(|test| test.reached.contains(&number) && test.seconds <= slowest) {
            verdict = match test.try_on(number, &checkout.folder, scratch)? {
                Outcome::Passed => "survived",
                Outcome::Failed => "killed",
                Outcome::TimedOut => "timed out",
            };
            if verdict != "survived" {
                break;
            }
        }
        let mutant = &checkout.mutants[number - 1];
        if matches!(verdict, "survived" | "not reached") {
            println!("{verdict}\t{mutant}");
        }
        writeln!(file.lock().unwrap_or_else(|e| e.into_inner()), "{verdict}\t{}", checkout.key(number))?;
        Ok((number, verdict.to_owned()))
    })
}

/// Calls `work` for each item, two at a time, each with a scratch folder that is its own; the results come in any order.
fn in_parallel<T: Send, R: Send>(
    items: Vec<T>,
    under: &Path,
    work: impl Fn(T, &Path) -> io::Result<R> + Sync,
) -> io::Result<Vec<R>> {
    let items = Mutex::new(items.into_iter());
    let work_on = |worker: usize| -> io::Result<Vec<R>> {
        let scratch = under.join(format!("scratch-{worker}"));
        let mut done = Vec::new();
        loop {
            let next = items.lock().unwrap_or_else(|e| e.into_inner()).next();
            let Some(item) = next else { break };
            done.push(work(item, &scratch)?);
        }
        let _ = fs::remove_dir_all(scratch);
        Ok(done)
    };
    thread::scope(|scope| {
        let other = scope.spawn(|| work_on(1));
        let mut done = work_on(0)?;
        done.extend(other.join().map_err(|_| io::Error::other("a worker panicked"))??);
        Ok(done)
    })
}

fn read_results(path: &Path) -> BTreeMap<String, String> {
    let text = fs::read_to_string(path).unwrap_or_default();
    let line = |line: &str| line.split_once('\t').map(|(verdict, mutant)| (mutant.to_owned(), verdict.to_owned()));
    text.lines().filter_map(line).collect()
}

/// Prints counts by folder; returns the number of survivors.
fn print_summary(verdicts: &[(usize, String)], checkout: &Checkout) -> usize {
    let mut folders: BTreeMap<PathBuf, BTreeMap<&str, usize>> = BTreeMap::new();
    for (number, verdict) in verdicts {
        let folder = checkout.mutants[number - 1].file.components().take(2).collect();
        *folders.entry(folder).or_default().entry(verdict).or_default() += 1;
    }
    println!("\n{:<24}{:>9}{:>9}{:>9}{:>9}{:>12}", "", "mutants", "killed", "hung", "survived", "not reached");
    let mut survivor_count = 0;
    for (folder, counts) in &folders {
        let [killed, hung, survived, unreached] =
            ["killed", "timed out", "survived", "not reached"].map(|verdict| counts.get(verdict).copied().unwrap_or(0));
        let all = killed + hung + survived + unreached;
        println!("{:<24}{all:>9}{killed:>9}{hung:>9}{survived:>9}{unreached:>12}", folder.display());
        survivor_count += survived + unreached;
    }
    survivor_count
}

fn hash_of(value: &impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}
