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
        self.scale = 0.96 * min(width / (high[0] - low[0]), height / (high[1] - low[1]))
        self.shift = np.array((width, height)) / 2 - self.scale * (low + high) / 2

    def project(self, position):
        """(x, y, nearness) in pixels, y downwards."""
        flat = (position - self.origin) @ self.axes.T * self.scale
        flat[:, :2] += self.shift
        return flat


def draw(mesh, pictures, view, width, height, wire):
    colour = np.empty((height, width, 3))
    colour[:] = BACKGROUND
    depth = np.full((height, width), -np.inf)
    screen = view.project(mesh.position)
    a, b, c = (mesh.position[mesh.face[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    light = 0.52 + 0.58 * np.clip(normal @ SUN, 0, 1) + 0.08 * normal[:, 2]
    plain = np.full((1, 1, 3), 200.0)
    for t in range(len(mesh.face)):
        p = screen[mesh.face[t]]
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
        if not shown.any():
            continue
        if mesh.face_uv[t, 0] >= 0:
            uv = mesh.texcoord[mesh.face_uv[t]]
            picture = pictures.get(mesh.material[t], plain)
            rows, columns = picture.shape[:2]
            s = (u * uv[0, 0] + v * uv[1, 0] + w * uv[2, 0])[shown] % 1.0
            r = (u * uv[0, 1] + v * uv[1, 1] + w * uv[2, 1])[shown] % 1.0
            rgb = picture[((1 - r) * rows).astype(int) % rows, (s * columns).astype(int) % columns]
        elif mesh.colour is not None:
            weights = np.stack([u, v, w], -1)[shown]
            rgb = 255 * weights @ mesh.colour[mesh.face[t]]
        else:
            rgb = np.full((int(shown.sum()), 3), 200.0)
        rgb = rgb * light[t]
        if wire:
            reach = np.abs(area) / np.array([np.hypot(*(p[i, :2] - p[j, :2])) for i, j in ((1, 2), (2, 0), (0, 1))])
            gap = np.minimum.reduce([u * reach[0], v * reach[1], w * reach[2]])[shown]
            rgb = np.where((gap < 0.9)[:, None], 0.35 * rgb + 0.65 * np.array((20, 24, 40)), rgb)
        colour[patch][shown] = rgb
        depth[patch][shown] = near[shown]
    return np.clip(colour, 0, 255).astype(np.uint8)


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
        page = page.quantize(options.palette, dither=Image.Dither.NONE)
    page.save(options.picture, optimize=True)


if __name__ == "__main__":
    main()
