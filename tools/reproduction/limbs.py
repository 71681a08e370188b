"""Closed triangle meshes of figures with limbs: a quadruped, a person, a helicopter, a car.

A figure is a list of cones with round ends, some squeezed flat, and of blocks with round edges, blended into one surface by a smooth minimum of their
distances. A lattice of irregular tetrahedra cuts it; the vertices then slide on the surface until the triangles are of about
even size. Nothing is drawn at random but the lattice, and that from a fixed seed: the same call gives the same mesh.
"""
import hashlib
import os
from pathlib import Path

import numpy as np

KEPT = Path("target/reproduce/figures")
SEED = 2015
SHAKE = 0.12  # how far lattice points stray, in cells
ROUNDS = 12  # of sliding


class Figure:
    """Cones and blocks with round ends; each blends into those before it."""

    def __init__(self):
        self.parts, self.blocks = [], []

    def limb(self, points, radii, blend=0.04, flat=(1, 1, 1), mirror=False):
        """A chain of cones through `points`, `radii` thick there, squeezed by `flat` along x, y, z; `mirror` adds its image at -y."""
        points, flat = np.atleast_2d(np.asarray(points, float)), np.asarray(flat, float)
        for i in range(max(len(points) - 1, 1)):
            j = min(i + 1, len(points) - 1)
            self.parts.append((points[i], points[j], radii[i], radii[j], flat, blend))
        if mirror:
            self.limb(points * (1, -1, 1), radii, blend, flat)

    def ball(self, centre, radii, blend=0.04, mirror=False):
        """An ellipsoid."""
        self.limb([centre], [1.0], blend, radii, mirror)

    def block(self, centre, half, radius, blend=0.04, lean=0.0, mirror=False):
        """A block with round edges, `half` as long, wide and high; `lean` moves its ends together towards the top, per unit of height."""
        self.blocks.append((np.asarray(centre, float), np.asarray(half, float), radius, lean, blend))
        if mirror:
            self.block(np.asarray(centre) * (1, -1, 1), half, radius, blend, lean)

    def distance(self, p):
        """Distance of every point of `p` to the surface, to first order; negative inside."""
        total = None
        for centre, half, radius, lean, blend in self.blocks:
            q = p - centre
            narrow = np.stack([lean * (q[:, 2] + half[2]), 0 * q[:, 2], 0 * q[:, 2]], axis=1)
            off = np.abs(q) - np.maximum(half - narrow, 0.1 * half) + radius
            d = np.linalg.norm(np.maximum(off, 0), axis=1) + np.minimum(off.max(axis=1), 0) - radius
            total = d if total is None else joined(total, d, blend)
        for a, b, ra, rb, flat, blend in self.parts:
            q, axis = (p - a) / flat, (b - a) / flat
            t = np.clip(q @ axis / max(axis @ axis, 1e-12), 0, 1)
            off = q - t[:, None] * axis
            far = np.sqrt(np.einsum("ij,ij->i", off, off)) + 1e-12
            slope = np.sqrt(np.einsum("ij,ij->i", off / flat, off / flat)) / far + 1e-12
            d = (far - ra - t * (rb - ra)) / slope
            total = d if total is None else joined(total, d, blend)
        return total

    def gradient(self, p, step):
        """Slope of the distance, by central differences."""
        shifts = step * np.eye(3)
        return np.stack([self.distance(p + s) - self.distance(p - s) for s in shifts], axis=1) / (2 * step)

    def box(self):
        """Corners of a box around the figure."""
        ends = [(e, r * flat) for a, b, ra, rb, flat, _ in self.parts for e, r in ((a, ra), (b, rb))]
        ends += [(centre, half) for centre, half, *_ in self.blocks]
        return np.min([e - r for e, r in ends], axis=0), np.max([e + r for e, r in ends], axis=0)

    def mesh(self, cells):
        """Vertices and faces, with `cells` lattice cells along the longest side; kept in a file, since it takes a while."""
        kept = KEPT / f"{hashlib.sha256(Path(__file__).read_bytes() + repr((self.parts, self.blocks, cells)).encode()).hexdigest()[:16]}.npz"
        if not kept.exists():
            kept.parent.mkdir(parents=True, exist_ok=True)
            vertices, faces = self.made(cells)
            half = kept.with_suffix(f".{os.getpid()}.npz")
            np.savez(half, vertices=vertices, faces=faces)
            half.replace(kept)
        found = np.load(kept)
        return found["vertices"], found["faces"]

    def made(self, cells):
        low, high = self.box()
        cell = (high - low).max() / cells
        vertices, faces = march(self.distance, low - 2 * cell, cell, np.ceil((high - low) / cell).astype(int) + 4)
        return slide(self, vertices, faces, cell)


def joined(one, other, blend):
    """A smooth minimum of two distances."""
    overlap = np.maximum(1 - np.abs(one - other) / blend, 0)
    return np.minimum(one, other) - overlap * overlap * blend / 4


def march(distance, low, cell, counts):
    """The zero of `distance`, cut out of a body-centred lattice of tetrahedra with shaken points: closed and manifold."""
    counts = counts + 1
    corner = np.arange(counts.prod()).reshape(counts)
    where = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    points = np.concatenate([where, where + 0.5])  # corners, then the centres of the cells above them
    points = low + cell * (points + np.random.default_rng(SEED).uniform(-SHAKE, SHAKE, points.shape))
    value = distance(points)
    tets = []
    for axis in range(3):  # between neighbouring centres, around the square between them
        u, v = np.roll(np.eye(3, dtype=int), -axis, axis=0)[1:]
        n = np.roll(np.eye(3, dtype=int), -axis, axis=0)[0]
        base = where[np.all((where >= n) & (where < counts - 1), axis=1)]
        at = lambda shift: corner[tuple((base + shift).T)]
        square = [at(0), at(u), at(u + v), at(v)]
        two = [at(-n) + corner.size, at(0) + corner.size]
        tets += [np.stack([*two, square[i], square[(i + 1) % 4]], axis=1) for i in range(4)]
    tets = np.concatenate(tets)
    inside = value[tets] < 0
    count = inside.sum(axis=1)
    cut = (count > 0) & (count < 4)
    tets, count = tets[cut], count[cut]
    order = np.argsort(~inside[cut], axis=1, kind="stable")  # those inside first
    a, b, c, d = np.take_along_axis(tets, order, axis=1).T
    one, two, three = count == 1, count == 2, count == 3
    pick = lambda mask, *pairs: np.stack([np.stack([x[mask], y[mask]], axis=1) for x, y in pairs], axis=1)
    triangles = np.concatenate([
        pick(one, (a, b), (a, c), (a, d)), pick(three, (a, d), (b, d), (c, d)),
        pick(two, (a, c), (a, d), (b, d)), pick(two, (a, c), (b, d), (b, c))])
    edges, faces = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    faces = faces.reshape(-1, 3)
    near, far = value[edges[:, 0]], value[edges[:, 1]]
    share = np.clip(near / (near - far), 0.1, 0.9)[:, None]  # off the lattice points, so that no triangle is empty
    vertices = points[edges[:, 0]] * (1 - share) + points[edges[:, 1]] * share
    core = points[edges[faces[:, 0], 0]]  # a lattice point inside, behind each face
    back = np.einsum("ij,ij->i", normals(vertices, faces), vertices[faces[:, 0]] - core) < 0
    faces[back] = faces[back][:, ::-1]
    return vertices, faces


def normals(vertices, faces):
    """Normals of the faces, as long as twice their area."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def slide(figure, vertices, faces, cell):
    """Moves vertices towards the middle of the triangles around them, along the surface, and back onto it."""
    ends = faces.ravel()
    for _ in range(ROUNDS):
        size = np.repeat(np.linalg.norm(normals(vertices, faces), axis=1), 3)
        middle = np.repeat(vertices[faces].mean(axis=1), 3, axis=0)
        total = np.bincount(ends, size)
        goal = np.stack([np.bincount(ends, size * middle[:, i]) for i in range(3)], axis=1) / total[:, None]
        slope = figure.gradient(vertices, 1e-3 * cell)
        slope /= np.linalg.norm(slope, axis=1, keepdims=True) + 1e-12
        move = 0.6 * (goal - vertices)
        vertices = vertices + move - np.einsum("ij,ij->i", move, slope)[:, None] * slope
        for _ in range(2):
            slope = figure.gradient(vertices, 1e-3 * cell)
            step = figure.distance(vertices) / np.maximum(np.einsum("ij,ij->i", slope, slope), 0.1)
            vertices = vertices - np.clip(step, -0.5 * cell, 0.5 * cell)[:, None] * slope
    return vertices, faces


def quadruped(cells=32):
    """A cow-like animal, 2 long, looking along x: horns, ears, jaw, udder, legs with hooves, tail with a tuft."""
    f = Figure()
    f.ball((0, 0, 1.0), (0.62, 0.27, 0.29))
    f.ball((0.42, 0, 1.04), (0.28, 0.25, 0.30), 0.1)
    f.ball((-0.48, 0, 1.06), (0.26, 0.25, 0.26), 0.1)
    f.limb([(0.55, 0, 1.12), (0.92, 0, 1.36)], [0.19, 0.12], 0.12)
    f.limb([(0.90, 0, 1.40), (1.18, 0, 1.20)], [0.125, 0.075], 0.05)
    f.limb([(0.98, 0, 1.24), (1.16, 0, 1.13)], [0.06, 0.05], 0.03)
    f.limb([(0.86, 0.09, 1.45), (0.82, 0.19, 1.52), (0.88, 0.23, 1.63)], [0.045, 0.040, 0.030], 0.02, mirror=True)
    f.limb([(0.84, 0.10, 1.39), (0.80, 0.28, 1.37)], [0.075, 0.060], 0.03, (1, 1, 0.65), mirror=True)
    f.ball((1.03, 0.085, 1.37), (0.03, 0.02, 0.03), 0.02, mirror=True)
    f.limb([(0.45, 0.15, 0.9), (0.47, 0.17, 0.5), (0.45, 0.17, 0.06)], [0.13, 0.06, 0.045], 0.08, mirror=True)
    f.limb([(0.45, 0.17, 0.05), (0.50, 0.17, 0.04)], [0.06, 0.05], 0.02, mirror=True)
    f.limb([(-0.52, 0.15, 0.95), (-0.46, 0.17, 0.62), (-0.58, 0.17, 0.42), (-0.54, 0.17, 0.06)], [0.17, 0.08, 0.05, 0.042], 0.08, mirror=True)
    f.limb([(-0.54, 0.17, 0.05), (-0.49, 0.17, 0.04)], [0.06, 0.05], 0.02, mirror=True)
    f.limb([(-0.68, 0, 1.22), (-0.86, 0, 1.14), (-0.94, 0, 0.82), (-0.95, 0, 0.58)], [0.05, 0.042, 0.040, 0.040], 0.03)
    f.limb([(-0.95, 0, 0.58), (-0.96, 0, 0.44)], [0.055, 0.035], 0.03)
    f.ball((-0.25, 0, 0.72), (0.13, 0.11, 0.09), 0.05)
    f.limb([(-0.22, 0.06, 0.66), (-0.22, 0.08, 0.58)], [0.042, 0.038], 0.02, mirror=True)
    return f.mesh(cells)


def person(cells=41):
    """A standing figure, 1.8 high, looking along x: hat with a brim, nose, ears, arms away from the body, fingers, feet."""
    f = Figure()
    f.limb([(0, 0, 0.95), (0.02, 0, 1.12), (0, 0, 1.36)], [0.15, 0.14, 0.155], 0.08, (0.75, 1.1, 1))
    f.limb([(0, 0, 1.42), (0.01, 0, 1.56)], [0.06, 0.055], 0.05)
    f.ball((0.02, 0, 1.65), (0.105, 0.085, 0.125), 0.03)
    f.limb([(0.11, 0, 1.66), (0.145, 0, 1.625)], [0.020, 0.026], 0.015)
    f.limb([(0.01, 0.085, 1.67), (0, 0.105, 1.64)], [0.035, 0.028], 0.015, (1, 0.65, 1), mirror=True)
    brim = [(0.02 + 0.19 * np.cos(t), 0.17 * np.sin(t), 1.735) for t in np.linspace(0, 2 * np.pi, 17)]
    f.limb(brim, [0.024] * len(brim), 0.01)
    f.ball((0.02, 0, 1.735), (0.20, 0.18, 0.06), 0.02)
    f.limb([(0.01, 0, 1.76), (0.01, 0, 1.80)], [0.098, 0.085], 0.02)
    f.limb([(0, 0.15, 1.40), (-0.02, 0.36, 1.20), (0.05, 0.54, 1.04)], [0.065, 0.045, 0.032], 0.05, mirror=True)
    f.limb([(0.05, 0.55, 1.03), (0.05, 0.61, 0.96)], [0.045, 0.055], 0.02, (1.4, 0.8, 0.9), mirror=True)
    for i in (-1, 0, 1):
        f.limb([(0.05 + 0.06 * i, 0.63, 0.93), (0.05 + 0.14 * i, 0.71, 0.82)], [0.030, 0.028], 0.012, mirror=True)
    f.limb([(0.09, 0.58, 1.0), (0.22, 0.58, 0.99)], [0.030, 0.028], 0.012, mirror=True)
    f.limb([(0, 0.10, 0.92), (0.02, 0.15, 0.50), (-0.02, 0.17, 0.08)], [0.095, 0.062, 0.042], 0.05, mirror=True)
    f.limb([(-0.03, 0.17, 0.04), (0.15, 0.20, 0.035)], [0.05, 0.045], 0.04, (1, 1, 0.8), mirror=True)
    return f.mesh(cells)


def helicopter(cells=39):
    """A helicopter, 2 long, looking along x, as one blended surface: four blades, tail boom, fin, tail rotor, skids on struts."""
    f = Figure()
    f.ball((0.35, 0, 0.55), (0.42, 0.24, 0.25))
    f.limb([(0.05, 0, 0.66), (-0.85, 0, 0.72)], [0.12, 0.04], 0.1)
    f.limb([(0.25, 0, 0.76), (0.0, 0, 0.77)], [0.10, 0.07], 0.06)
    f.limb([(-0.80, 0, 0.72), (-0.98, 0, 0.98)], [0.10, 0.075], 0.03, (1, 0.45, 1))
    f.limb([(-0.68, -0.22, 0.70), (-0.68, 0.22, 0.70)], [0.080, 0.075], 0.02, (1, 1, 0.6))
    f.limb([(0.2, 0, 0.8), (0.2, 0, 0.97)], [0.035, 0.028], 0.03)
    f.ball((0.2, 0, 0.97), (0.07, 0.07, 0.035), 0.02)
    for x, y in ((0.92, 0.38), (-0.38, 0.92), (-0.92, -0.38), (0.38, -0.92)):
        f.limb([(0.2, 0, 0.975), (0.2 + 0.95 * x, 0.95 * y, 0.965)], [0.066, 0.060], 0.02, (1, 1, 0.65))
    f.limb([(-0.95, 0, 0.92), (-0.95, 0.14, 0.92)], [0.036, 0.036], 0.02)
    f.limb([(-1.08, 0.14, 0.79), (-0.82, 0.14, 1.05)], [0.042, 0.040], 0.015, (1, 0.75, 1))
    f.limb([(0.75, 0.26, 0.16), (0.66, 0.26, 0.10), (-0.05, 0.26, 0.10)], [0.036, 0.036, 0.036], 0.02, mirror=True)
    for x in (0.15, 0.52):
        f.limb([(x, 0.12, 0.40), (x, 0.26, 0.10)], [0.036, 0.034], 0.03, mirror=True)
    f.limb([(-0.05, 0.07, 0.78), (-0.16, 0.12, 0.80)], [0.04, 0.035], 0.02, mirror=True)
    return f.mesh(cells)


def car(cells=40):
    """A saloon car, 4.2 long, looking along x: body, cabin, wheels in their arches, bumpers, lamps, mirrors on arms."""
    f = Figure()
    f.block((0, 0, 0.62), (2.1, 0.85, 0.30), 0.12)
    f.block((-0.25, 0, 1.10), (1.25, 0.72, 0.30), 0.14, 0.12, lean=0.9)
    f.block((2.05, 0, 0.42), (0.14, 0.80, 0.09), 0.05, 0.03)
    f.block((-2.05, 0, 0.42), (0.14, 0.80, 0.09), 0.05, 0.03)
    for x in (-1.30, 1.35):
        f.limb([(x, 0.66, 0.32), (x, 0.86, 0.32)], [0.33, 0.33], 0.03, (1, 0.4, 1), mirror=True)
        f.limb([(x, -0.7, 0.32), (x, 0.7, 0.32)], [0.07, 0.07], 0.04)
    f.ball((2.08, 0.55, 0.72), (0.09, 0.14, 0.10), 0.03, mirror=True)
    f.limb([(0.72, 0.80, 0.95), (0.74, 1.00, 1.02)], [0.055, 0.050], 0.03, mirror=True)
    f.ball((0.74, 1.02, 1.03), (0.06, 0.10, 0.09), 0.03, mirror=True)
    return f.mesh(cells)


FIGURES = {"quadruped": quadruped, "person": person, "helicopter": helicopter}
CELLS = {"quadruped": 32, "person": 41, "helicopter": 39}
