#!/usr/bin/env python3
"""Makes what a release consists of, for this machine's platform, in target/dist: python3 tools/release

    drystone-VERSION-TARGET.tar.gz      program, manual pages, completions, pages, licences (.zip on Windows)
    drystone-VERSION-TARGET.cdx.json    what the program was compiled from, as CycloneDX (SBOM)
    drystone_VERSION-1_ARCH.deb         where dpkg is
    drystone-VERSION-….whl, .tar.gz     the Python package, with --wheel
    SHA256SUMS

The same commit, compiler and tools give the same bytes in any folder; `--check` builds the commit twice and compares,
`--check --wheel` the Python package, too.
Needs Rust, git and Python 3.11; installs cargo-auditable, cargo-cyclonedx and cargo-deb once, if they are absent.
Publishes nothing. docs/releasing.md says what to do before and after.
"""

import argparse
import sys

import building
import comparing
import wheel


def main():
    parser = argparse.ArgumentParser(
        prog="tools/release", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="build the commit twice, in two folders, and compare the files")
    parser.add_argument("--allow-changes", action="store_true", help="build a checkout with changes; not for publication")
    parser.add_argument("--wheel", action="store_true", help="make the Python package, too; needs the network once")
    asked = parser.parse_args()
    try:
        if asked.check:
            comparing.compare_two_builds(asked.wheel)
        else:
            building.build(asked.allow_changes, wheel.build_wheel if asked.wheel else None)
    except building.ReleaseError as error:
        sys.exit(f"tools/release: {error}")


if __name__ == "__main__":
    main()
