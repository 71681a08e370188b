//! `--version`: the version, the commit and the sources that it was built from, and for which machine; `build.rs` finds
//! them.

/// `-V`: `0.1.0`.
pub const SHORT: &str = env!("CARGO_PKG_VERSION");

/// `--version`: `0.1.0 (commit 1f292f3c6d2a, 2026-11-23, x86_64-unknown-linux-gnu, sources 0123456789abcdef)`; the last
/// number is a checksum. Without the commit where neither git nor the packaged crate names it, and in a build for
/// development, which would compile everything again at each commit; a packaged crate does not know the date.
pub const LONG: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("DRYSTONE_DATED_BUILD"), ")");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_long_version_names_the_target() {
        assert!(LONG.starts_with(SHORT));
        assert!(LONG.contains(std::env::consts::ARCH) && LONG.contains(std::env::consts::OS), "{LONG}");
    }
}
