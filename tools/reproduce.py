#!/usr/bin/env python3
"""Remakes the pages about the published systems: python3 tools/reproduce.py

The papers' meshes are not public. Figures, terrains and a town are generated with the papers' counts; pieces of real surveys
are cut from ../shared/data (or DRYSTONE_SHARED) where it is there, else those tables are left out. Writes
docs/results/papers/README.md and a page for each paper in docs/results/papers/. Needs numpy and pillow, and target/release/drystone; takes
about an hour on one core. What was measured is kept in target/reproduce, so that a second run is short.
"""

import argparse

from reproduction import runs, curvature, oblique, overview, reconstruction, sharpness, terrain

PAPERS = {"oblique": oblique, "reconstruction": reconstruction, "curvature": curvature, "terrain": terrain, "sharpness": sharpness}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PAPERS, default=list(PAPERS), help="pages of these papers alone; of README.md the counts of claims alone")
    asked = parser.parse_args()
    runs.FOLDER.mkdir(parents=True, exist_ok=True)
    for name in asked.only:
        PAPERS[name].write()
    if set(asked.only) == set(PAPERS):
        overview.write()
    else:
        overview.recount()


if __name__ == "__main__":
    main()
