//! The command line program; see `drystone --help`.

fn main() -> std::process::ExitCode {
    drystone::cli::run()
}
