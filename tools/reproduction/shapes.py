"""Shapes of triangles that the program does not measure: flats, and what a level of detail changes."""

import numpy as np


def triangles_of(path):
    """Positions of the vertices, and the triangles; polygons are cut into fans."""
    vertices, faces = [], []
    for line in path.open(errors="replace"):
        words = line.split()
        if words and words[0] == "v":
            vertices.append([float(w) for w in words[1:4]])
        elif words and words[0] == "f":
            corners = [int(w.split("/")[0]) - 1 for w in words[1:]]
            faces += [(corners[0], *pair) for pair in zip(corners[1:], corners[2:])]
    return np.array(vertices), np.array(faces)


def flat_faces(vertices, faces):
    """Which triangles are flat: normals turn by less than 5° across each of their edges; and twice their areas."""
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    area = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(area, 1e-300)[:, None]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(edges.T[::-1])
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(1)
    one, other = owner[:-1][same], owner[1:][same]
    bent = np.zeros(len(faces), bool)
    turned = (normals[one] * normals[other]).sum(1) < np.cos(np.radians(5))
    bent[one[turned]] = bent[other[turned]] = True
    return ~bent, area


def flatness(path):
    """Share of the area that is flat, and of the vertices that lie on it alone."""
    vertices, faces = triangles_of(path)
    flat, area = flat_faces(vertices, faces)
    on_bent, used = np.zeros(len(vertices), bool), np.zeros(len(vertices), bool)
    on_bent[faces[~flat]] = True
    used[faces] = True
    return area[flat].sum() / area.sum(), (used & ~on_bent).sum() / used.sum()


def lost_flats(fine, coarse):
    """Share of the area of the finer level's flats whose triangles the coarser level does not have."""
    vertices, faces = triangles_of(fine)
    flat, area = flat_faces(vertices, faces)
    kept = set(keys(*triangles_of(coarse)))
    lost = np.array([key not in kept for key in keys(vertices, faces)])
    return area[flat & lost].sum() / area[flat].sum()


def keys(vertices, faces):
    """Each triangle by its corners' places, whatever their order."""
    corners = vertices.round(6)[faces].tolist()
    return [tuple(sorted(map(tuple, triangle))) for triangle in corners]
