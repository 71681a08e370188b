#!/usr/bin/env python3
"""border_density.py IN.obj --many N --one N [--ratio R]: is the result denser where the first pass cut the mesh?

    tools/benchmarks/border_density.py city.obj --many 50000 --one 10000000 --scratch out

Simplifies IN.obj twice, with clusters of --many and of --one triangles.  The work folder of the first run is watched for
`pass-0-shared-positions.col` (docs/reference/work-folder.md): the vertices on borders between the first pass's clusters, where they
were in the input.  Counts the vertices of each result within two mean edges of one of these.  Both results describe the
same surface, so the quotient of the counts is the quotient of the densities: 1 means that borders left no trace.

Needs numpy.
"""
import argparse
import json
import os
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HEADER_BYTES = 64
RAW = 255
BAND_EDGES = 2.0
VERTICES_AT_ONCE = 512


def read(path):
    """Vertices and triangles of a result, which has no polygons."""
    vertices, faces = [], []
    with open(path, encoding="utf-8", errors="replace") as lines:
        for line in lines:
            words = line.split()
            if words[:1] == ["v"]:
                vertices.append(tuple(map(float, words[1:4])))
            elif words[:1] == ["f"]:
                faces.append(tuple(int(word.split("/")[0]) - 1 for word in words[1:4]))
    return np.array(vertices), np.array(faces)


def unpack(path):
    """Positions of a packed column (docs/reference/work-folder.md)."""
    data, at, numbers = path.read_bytes(), HEADER_BYTES, []
    while at < len(data):
        count, decimals = int.from_bytes(data[at : at + 2], "little"), data[at + 2]
        at += 3
        if decimals == RAW:
            numbers.extend(struct.unpack_from(f"<{3 * count}d", data, at))
            at += 24 * count
            continue
        last = [0, 0, 0]
        for i in range(3 * count):
            folded = shift = 0
            while True:
                byte, at = data[at], at + 1
                folded |= (byte & 0x7F) << shift
                shift += 7
                if byte < 0x80:
                    break
            last[i % 3] += (folded >> 1) ^ -(folded & 1)
            numbers.append(last[i % 3] / 10**decimals)
    return np.array(numbers).reshape(-1, 3)


def simplify(asked, cluster_faces, name):
    """The result's vertices, its mean edge, the clusters of each pass, and the first pass's shared vertices, if any."""
    folder = (asked.scratch / name).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    work, result, kept = folder / "work", folder / "out.obj", folder / "shared.col"
    kept.unlink(missing_ok=True)
    command = [asked.binary, "simplify", asked.source, "-o", result, "--ratio", asked.ratio, "--cluster-faces", cluster_faces]
    command += ["--work", work, "--textures", "reference", "--force", "--quiet", "--report", folder / "report.json"]
    running = subprocess.Popen([str(word) for word in command])
    while running.poll() is None:
        if not kept.exists():
            try:
                for shared in work.rglob("pass-0-shared-positions.col"):
                    os.link(shared, kept)
            except FileNotFoundError:
                pass  # removed in between
        time.sleep(0.002)
    if running.returncode:
        sys.exit(f"drystone ended with {running.returncode}")
    vertices, faces = read(result)
    corners = vertices[faces]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()
    clusters = [each["clusters"] for each in json.loads((folder / "report.json").read_text())["passes"]]
    shared = unpack(kept) if kept.exists() else np.empty((0, 3))
    return vertices, edge, clusters, shared


def count_near(vertices, places, reach):
    near = 0
    for begin in range(0, len(vertices), VERTICES_AT_ONCE):
        some = vertices[begin : begin + VERTICES_AT_ONCE]
        low, high = some.min(axis=0) - reach, some.max(axis=0) + reach
        candidates = places[((places >= low) & (places <= high)).all(axis=1)]
        if len(candidates):
            square = ((some[:, None] - candidates[None]) ** 2).sum(axis=2)
            near += int((square.min(axis=1) <= reach * reach).sum())
    return near


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("source", type=Path)
    arguments.add_argument("--many", type=int, required=True)
    arguments.add_argument("--one", type=int, required=True)
    arguments.add_argument("--ratio", default="0.1")
    arguments.add_argument("--binary", default="drystone")
    arguments.add_argument("--scratch", type=Path, default=Path("."))
    asked = arguments.parse_args()
    many, edge, many_clusters, shared = simplify(asked, asked.many, "many")
    one, _, one_clusters, _ = simplify(asked, asked.one, "one")
    if not len(shared):
        sys.exit("no shared vertices seen: too few clusters, or the pass was too short to watch")
    reach = BAND_EDGES * edge
    near_many, near_one = count_near(many, shared, reach), count_near(one, shared, reach)
    print(json.dumps({
        "input": asked.source.name,
        "clusters": [many_clusters, one_clusters],
        "border_vertices": len(shared),
        "band": reach,
        "vertices": [len(many), len(one)],
        "near_border": [near_many, near_one],
        "density_ratio": near_many / near_one,
    }))


if __name__ == "__main__":
    main()
