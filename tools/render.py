#!/usr/bin/env python3
"""Draws a textured OBJ to a PNG: a view from above at an angle, z-buffer, texture sampling, one light.

    tools/render.py fixtures/town/town.obj town.png
    tools/render.py before.obj after.obj pair.png --wire        # several meshes side by side, edges drawn

Orthographic, so that two meshes of one place can be compared pixel by pixel: the view is fitted to the first mesh.
Needs numpy and pillow. Slow but short: about a second per 20,000 triangles.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "python"))
import objlib

BACKGROUND = (236, 240, 245)
SUN = np.array((-0.45, -0.60, 0.66))
SUPERSAMPLE = 2
FILLED = 0.96  # share of a view that the mesh fills, in one direction at least


def load_textures(obj_path):
    """{material: picture as (h, w, 3) floats}; a plain colour is a picture of one pixel."""
    pictures, name = {}, None
    for library in objlib.read_libraries(obj_path):
        for line in library.splitlines():
            word, _, rest = line.strip().partition(" ")
            if word == "newmtl":
                name = rest
                pictures[name] = np.full((1, 1, 3), 200.0)
            elif word == "Kd" and pictures[name].shape[0] == 1:
                pictures[name] = 255 * np.array([[[float(x) for x in rest.split()[:3]]]])
            elif word == "map_Kd":
                pictures[name] = np.asarray(Image.open(Path(obj_path).parent / rest).convert("RGB"), float)
    return pictures


class View:
    """World to screen: rotated by `turn` about the vertical, tilted by `tilt` from the horizon."""

    def __init__(self, mesh, width, height, turn, tilt, near=None):
        t, e = np.radians(turn), np.radians(tilt)
        right = np.array((np.cos(t), np.sin(t), 0))
        ahead = np.array((-np.sin(t), np.cos(t), 0))
        up = np.array((0, 0, 1.0))
        self.axes = np.stack([right, -(np.sin(e) * ahead + np.cos(e) * up), np.sin(e) * up - np.cos(e) * ahead])
        flat = (mesh.position - mesh.position[0]) @ self.axes.T
        low, high = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
        if near:
            middle = ((np.array(near[:3]) - mesh.position[0]) @ self.axes.T)[:2]
            low, high = middle - near[3], middle + near[3]
        self.origin = mesh.position[0]
        self.scale = FILLED * min(width / (high[0] - low[0]), height / (high[1] - low[1]))
        self.shift = np.array((width, height)) / 2 - self.scale * (low + high) / 2

    def project(self, position):
        """(x, y, nearness) in pixels, y downwards."""
        flat = (position - self.origin) @ self.axes.T * self.scale
        flat[:, :2] += self.shift
        return flat


def visible(mesh, view, width, height):
    """What each pixel shows: its face, -1 where there is none, and the weights of the face's corners."""
    face = np.full((height, width), -1)
    weight = np.zeros((height, width, 3))
    depth = np.full((height, width), -np.inf)
    for t, p in enumerate(view.project(mesh.position)[mesh.face]):
        x0, y0 = np.maximum(np.ceil(p[:, :2].min(axis=0) - 0.5).astype(int), 0)
        x1, y1 = np.minimum(np.floor(p[:, :2].max(axis=0) + 0.5).astype(int), (width, height))
        area = (p[1, 0] - p[0, 0]) * (p[2, 1] - p[0, 1]) - (p[1, 1] - p[0, 1]) * (p[2, 0] - p[0, 0])
        if x0 >= x1 or y0 >= y1 or area == 0:
            continue
        x, y = np.arange(x0, x1) + 0.5, (np.arange(y0, y1) + 0.5)[:, None]
        v = ((x - p[0, 0]) * (p[2, 1] - p[0, 1]) - (y - p[0, 1]) * (p[2, 0] - p[0, 0])) / area
        w = ((p[1, 0] - p[0, 0]) * (y - p[0, 1]) - (p[1, 1] - p[0, 1]) * (x - p[0, 0])) / area
        u = 1 - v - w
        near = u * p[0, 2] + v * p[1, 2] + w * p[2, 2]
        patch = (slice(y0, y1), slice(x0, x1))
        shown = (u >= 0) & (v >= 0) & (w >= 0) & (near > depth[patch])
        face[patch][shown], depth[patch][shown] = t, near[shown]
        weight[patch][shown] = np.stack([u, v, w], -1)[shown]
    return face, weight


def mixed(picture, uv):
    """A picture at texture coordinates, mixed between its four nearest pixels; it repeats."""
    rows, columns = picture.shape[:2]
    x, y = uv[:, 0] * columns - 0.5, (1 - uv[:, 1]) * rows - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    x, y = (x - left)[:, None], (y - top)[:, None]
    upper, lower = (
        (1 - x) * picture[row % rows, left % columns] + x * picture[row % rows, (left + 1) % columns]
        for row in (top, top + 1)
    )
    return (1 - y) * upper + y * lower


def colours(mesh, pictures, face, weight):
    """Colours of points on faces, without light."""
    rgb = np.full((len(face), 3), 200.0)
    if mesh.colour is not None:
        rgb = 255 * np.einsum("nk,nkc->nc", weight, mesh.colour[mesh.face[face]])
    for material, picture in pictures.items():
        shows = (mesh.material[face] == material) & (mesh.face_uv[face, 0] >= 0)
        texcoord = mesh.texcoord[mesh.face_uv[face[shows]]]
        rgb[shows] = mixed(picture, np.einsum("nk,nkc->nc", weight[shows], texcoord))
    return rgb


def lights(mesh):
    """How bright each face is."""
    a, b, c = (mesh.position[mesh.face[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    return 0.52 + 0.58 * np.clip(normal @ SUN, 0, 1) + 0.08 * normal[:, 2]


def edge_gaps(mesh, view, face, weight):
    """Distances in pixels of points on faces from the edge opposite to each corner."""
    corner = view.project(mesh.position)[mesh.face, :2]
    side = np.stack([corner[:, i] - corner[:, j] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)
    area = np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
    height = area[:, None] / np.maximum(np.linalg.norm(side, axis=2), 1e-12)
    return weight * height[face]


def draw(mesh, pictures, view, width, height, wire):
    face, weight = visible(mesh, view, width, height)
    covered = face >= 0
    face, weight = face[covered], weight[covered]
    rgb = colours(mesh, pictures, face, weight) * lights(mesh)[face, None]
    if wire:
        on_edge = edge_gaps(mesh, view, face, weight).min(axis=1) < 0.9
        rgb[on_edge] = 0.35 * rgb[on_edge] + 0.65 * np.array((20, 24, 40))
    page = np.full((height, width, 3), BACKGROUND, float)
    page[covered] = rgb
    return np.clip(page, 0, 255).astype(np.uint8)


def few_colours(page, count):
    """A picture with as many colours, for a smaller file."""
    return page.quantize(count, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", type=Path, metavar="MESH.obj")
    parser.add_argument("picture", type=Path, metavar="OUT.png")
    parser.add_argument("--size", default="1200x800", help="pixels of each view (default: 1200x800)")
    parser.add_argument("--turn", type=float, default=30, help="degrees about the vertical (default: 30)")
    parser.add_argument("--tilt", type=float, default=42, help="degrees above the horizon (default: 42)")
    parser.add_argument("--near", metavar="X,Y,Z,R", help="show what lies within R of a point")
    parser.add_argument("--wire", action="store_true", help="draw the triangles' edges")
    parser.add_argument("--columns", type=int, help="views side by side (default: all)")
    parser.add_argument("--palette", type=int, metavar="N", help="reduce to N colours, for a smaller file")
    options = parser.parse_args()
    near = [float(x) for x in options.near.split(",")] if options.near else None
    width, height = (int(x) for x in options.size.split("x"))
    big = (width * SUPERSAMPLE, height * SUPERSAMPLE)
    columns = options.columns or len(options.meshes)
    rows = -(-len(options.meshes) // columns)
    page, view = Image.new("RGB", (width * columns, height * rows), BACKGROUND), None
    for k, path in enumerate(options.meshes):
        mesh = objlib.read(path)
        view = view or View(mesh, *big, options.turn, options.tilt, near)
        drawn = Image.fromarray(draw(mesh, load_textures(path), view, *big, options.wire))
        page.paste(drawn.resize((width, height), Image.LANCZOS), (k % columns * width, k // columns * height))
    if options.palette:
        page = few_colours(page, options.palette)
    page.save(options.picture, optimize=True)


if __name__ == "__main__":
    main()
