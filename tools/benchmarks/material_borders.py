#!/usr/bin/env python3
"""Whether materials stay where they were: points on a result whose nearest point on the original has another material.

    tools/benchmarks/material_borders.py ORIGINAL.obj RESULT.obj

Where charts meet, a straightened border leaves slivers of one material on the other's ground; what matters is whether
such points lie farther from a border of materials than the surface deviates. Prints a line of JSON: points, those with another
material, and of these the ones farther from a border than twice the RMS and twice the largest distance of the points to
the original. Needs numpy, scipy and open3d; in memory.
"""
import json
import sys

import numpy as np
import open3d
from scipy.spatial import cKDTree

POINTS = 400_000
# Points along each border edge: a point's distance to the nearest of them stands for that to the edge.
ALONG_EDGE = 17


def load(path, names):
    """Vertices, triangles and the number of each triangle's material; `names` grows."""
    vertices, faces, materials, material = [], [], [], -1
    for line in open(path, errors="replace"):
        if line.startswith("v "):
            vertices.append(line.split()[1:4])
        elif line.startswith("usemtl"):
            material = names.setdefault(line.split(None, 1)[1].strip(), len(names))
        elif line.startswith("f "):
            corners = [int(word.split("/")[0]) for word in line.split()[1:]]
            faces += [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
            materials += [material] * (len(corners) - 2)
    faces = np.array(faces)
    return np.array(vertices, float), np.where(faces > 0, faces - 1, faces + len(vertices)), np.array(materials)


def points_of_borders(vertices, faces, materials):
    """Points on edges between materials, and on open edges: another tile may lie there."""
    welded = np.unique(vertices.round(9), axis=0, return_inverse=True)[1].reshape(-1)
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    keys = np.sort(welded[edges], 1) @ np.array([len(vertices), 1])
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    of_edge = np.repeat(materials, 3)[order]
    differs = np.minimum.reduceat(of_edge, starts) != np.maximum.reduceat(of_edge, starts)
    is_open = np.diff(starts, append=len(keys)) == 1
    a, b = vertices[edges[order[starts]][differs | is_open]].transpose(1, 0, 2)
    return np.concatenate([a + (b - a) * share for share in np.linspace(0, 1, ALONG_EDGE)])


def main(original, result):
    names = {}
    vertices, faces, materials = load(original, names)
    moved, kept, labels = load(result, names)
    middle = vertices.mean(0)
    vertices, moved = vertices - middle, moved - middle
    corners = moved[kept]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    random = np.random.default_rng(1)
    face = random.choice(len(kept), POINTS, p=area / area.sum())
    root, other = np.sqrt(random.random((POINTS, 1))), random.random((POINTS, 1))
    points = (corners[face] * np.stack([1 - root, root * (1 - other), root * other], 1)).sum(1)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.core.Tensor(vertices.astype(np.float32)), open3d.core.Tensor(faces.astype(np.uint32)))
    answer = scene.compute_closest_points(open3d.core.Tensor(points.astype(np.float32)))
    distance = np.linalg.norm(points - answer["points"].numpy(), axis=1)
    strays = materials[answer["primitive_ids"].numpy().astype(np.int64)] != labels[face]
    rms, largest = np.sqrt((distance**2).mean()), distance.max()
    away = cKDTree(points_of_borders(vertices, faces, materials)).query(points[strays])[0] if strays.any() else np.zeros(0)
    counts = {"points": POINTS, "other material": int(strays.sum()), "rms": float(rms), "largest": float(largest)}
    counts |= {"beyond 2 rms": int((away > 2 * rms).sum()), "beyond 2 largest": int((away > 2 * largest).sum())}
    print(json.dumps(counts))


if __name__ == "__main__":
    main(*sys.argv[1:3])
