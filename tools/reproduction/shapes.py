"""Shapes of triangles that the program does not measure: flats, and what a level of detail changes."""

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "python"))
import objlib

# How much greener than red and blue a triangle of the green is (2 G - R - B, of 255).
GREENER = 20


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


def flat_faces(vertices, faces, degrees=5):
    """Which triangles are flat: normals turn by less than some degrees across each of their edges; and twice their areas."""
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
    turned = (normals[one] * normals[other]).sum(1) < np.cos(np.radians(degrees))
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


@lru_cache(None)
def small(path):
    """An image at about 512 pixels, which is enough to tell green from grey, and quick to read."""
    image = Image.open(path)
    image.draft("RGB", (512, 512))
    return np.asarray(image.convert("RGB"))


def kinds_by_colour(path):
    """Share of the triangles that look green, of the rest those steeper than 60°, and those that are not."""
    mesh, pictures, name = objlib.read(path), {}, None
    for line in "\n".join(objlib.read_libraries(path)).splitlines():
        word, _, rest = line.strip().partition(" ")
        name = rest if word == "newmtl" else name
        if word == "map_Kd":
            pictures[name] = small((Path(path).parent / rest).resolve())
    corners = mesh.texcoord[mesh.face_uv]
    middle = corners.mean(1, keepdims=True)
    places = np.concatenate([middle, (corners + middle) / 2], 1) % 1.0
    colour, material = np.zeros((len(corners), 3)), np.asarray(mesh.material)
    for name, picture in pictures.items():
        rows, columns = picture.shape[:2]
        own = places[material == name]
        row, column = ((1 - own[..., 1]) * rows).astype(int) % rows, (own[..., 0] * columns).astype(int) % columns
        colour[material == name] = picture[row, column].mean(1)
    a, b, c = (mesh.position[mesh.face[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    steep = np.abs(across[:, 2]) < 0.5 * np.linalg.norm(across, axis=1)
    green = 2 * colour[:, 1] - colour[:, 0] - colour[:, 2] > GREENER
    return {"green": green.mean(), "walls": (~green & steep).mean(), "roofs and ground": (~green & ~steep).mean()}


@lru_cache
def read(path):
    return objlib.read(path)


def sides(mesh):
    """Of each triangle of a mesh its corners in the texture, and whether it shows its front there (1), its back (-1) or no area (0)."""
    corners = mesh.texcoord[mesh.face_uv]
    return corners, np.sign(across(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def across(u, v):
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def hold(triangles, points):
    """Which of some triangles in a plane hold which of some points."""
    a, b, c = (triangles[:, None, k] for k in range(3))
    turns = np.stack([across(b - a, points - a), across(c - b, points - b), across(a - c, points - c)])
    return (turns >= 0).all(0) | (turns <= 0).all(0)


def turned(original, path):
    """Triangles of a result that show their other side in the texture: where the middle of one lies, the original has triangles of the same material, and all of them show the other side."""
    before, after = read(original), objlib.read(path)
    (old, old_side), (new, new_side) = sides(before), sides(after)
    old_material, new_material, middles, count = np.asarray(before.material), np.asarray(after.material), new.mean(1), 0
    for material in set(new_material.tolist()):
        its_old, its_new = old_material == material, new_material == material
        for side in (1, -1):
            mine, others = old[its_old & (old_side == side)], old[its_old & (old_side == -side)]
            points = middles[its_new & (new_side == side)]
            if len(points) and len(others):
                rare = min(len(points), len(others))
                among = [hold(others, points[None, at]).any() for at in range(len(points))] if rare == len(points) else np.any([hold(one[None], points[None])[0] for one in others], axis=0)
                count += sum(not len(mine) or not hold(mine, point[None, None]).any() for point in points[np.asarray(among, bool)])
    return count


def middle_of(path, material):
    """The middle of the triangle of a material that lies nearest to the middle of them all."""
    mesh = objlib.read(path)
    centres = mesh.position[mesh.face[np.asarray(mesh.material) == material]].mean(1)
    return centres[np.argmin(np.linalg.norm(centres - centres.mean(0), axis=1))]


def keys(vertices, faces):
    """Each triangle by its corners' places, whatever their order."""
    corners = vertices.round(6)[faces].tolist()
    return [tuple(sorted(map(tuple, triangle))) for triangle in corners]
