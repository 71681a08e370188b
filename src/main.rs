//! The command line program; see `drystone --help`.

fn main() -> std::process::ExitCode {
    drystone::os::mmap::map_large_allocations();
    drystone::claim_process();
    drystone::cli::run()
}
