"""A small OBJ reader and mesh checks, written apart from drystone: what the tests believe instead of the program."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
FIXTURES = REPOSITORY / "fixtures"
sys.path.insert(0, str(REPOSITORY / "tools" / "fixtures"))


@dataclass
class Mesh:
    """Triangles of an OBJ file. position: (n, 3); texcoord: (m, 2); colour: (n, 3) or None; face, face_uv, face_normal:
    (t, 3) zero-based, -1 where a corner has none; material and part: one name per triangle; faults: bad indices found.
    """

    position: np.ndarray
    colour: np.ndarray | None
    texcoord: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    face_uv: np.ndarray
    face_normal: np.ndarray
    material: np.ndarray
    libraries: list = field(default_factory=list)
    parts: set = field(default_factory=set)
    faults: list = field(default_factory=list)

    @property
    def diagonal(self):
        used = self.position[np.unique(self.face)]
        return float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))


def read(path):
    """The mesh in an OBJ file; polygons are cut into fans, which is enough to count and to check."""
    lists = {"v": [], "vt": [], "vn": []}
    faces, materials, libraries, parts, faults = [], [], [], set(), []
    material, part, group = "", "", ""
    with open(path, encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            word, _, rest = line.strip().partition(" ")
            if word in lists:
                lists[word].append([float(x) for x in rest.split()])
            elif word == "f":
                corners = []
                for corner in rest.split():
                    slots = [-1, -1, -1]
                    for slot, text in enumerate(corner.split("/")):
                        if text:
                            count = len(lists[("v", "vt", "vn")[slot]])
                            index = int(text) - 1 if int(text) > 0 else count + int(text)
                            if not 0 <= index < count:
                                faults.append(f"{path}:{number}: index {text}, the file has {count} so far")
                            slots[slot] = index
                    corners.append(slots)
                for k in range(1, len(corners) - 1):
                    faces.append((corners[0], corners[k], corners[k + 1]))
                    materials.append(material)
                parts.add((part, group, material))
            elif word == "usemtl":
                material = rest
            elif word == "o":
                part = rest
            elif word == "g":
                group = rest
            elif word == "mtllib":
                libraries.append(rest)
    corner = np.array(faces, np.int64).reshape(-1, 3, 3)
    vertex = np.array(lists["v"]).reshape(len(lists["v"]), -1)
    return Mesh(
        position=vertex[:, :3],
        colour=vertex[:, 3:6] if vertex.shape[1] >= 6 else None,
        texcoord=np.array([t[:2] for t in lists["vt"]]).reshape(-1, 2),
        normal=np.array(lists["vn"]).reshape(-1, 3),
        face=corner[:, :, 0],
        face_uv=corner[:, :, 1],
        face_normal=corner[:, :, 2],
        material=np.array(materials, dtype=object),
        libraries=libraries,
        parts=parts,
        faults=faults,
    )


def write(path, position, face, texcoord=None, face_uv=None, material=None):
    """Writes a mesh, with nine significant digits so that re-reading gives the same uv charts."""
    with open(path, "w", newline="\n") as out:
        if material:
            out.write(f"mtllib {material}.mtl\nusemtl {material}\n")
            Path(path).with_name(f"{material}.mtl").write_text(f"newmtl {material}\nKd 0.8 0.8 0.8\n")
        out.writelines("v %.6f %.6f %.6f\n" % tuple(p) for p in position.tolist())
        if texcoord is None:
            out.writelines("f %d %d %d\n" % tuple(f) for f in (face + 1).tolist())
        else:
            out.writelines("vt %.9f %.9f\n" % tuple(t) for t in texcoord.tolist())
            corners = np.stack([face, face_uv], -1).reshape(-1, 6) + 1
            out.writelines("f %d/%d %d/%d %d/%d\n" % tuple(c) for c in corners.tolist())


def textures(obj_path):
    """Names in the map_Kd lines of the mesh's material libraries."""
    names = []
    for library in read_libraries(obj_path):
        names += [line.split(None, 1)[1].strip() for line in library.splitlines() if line.strip().startswith("map_Kd")]
    return names


def read_libraries(obj_path):
    with open(obj_path, encoding="utf-8") as lines:
        found = [line.split(None, 1)[1].strip() for line in lines if line.startswith("mtllib")]
    return [(Path(obj_path).parent / name).read_text() for name in found]


def welded_faces(mesh):
    """Triangles over bit-identical positions, without those that name a position twice."""
    _, inverse = np.unique(mesh.position, axis=0, return_inverse=True)
    face = inverse.reshape(-1)[mesh.face]
    a, b, c = face.T
    return face[(a != b) & (b != c) & (c != a)]


def edges(face):
    """(edges, how many triangles each has), every edge once with its lower end first."""
    both = np.concatenate([face[:, [0, 1]], face[:, [1, 2]], face[:, [2, 0]]])
    return np.unique(np.sort(both, axis=1), axis=0, return_counts=True)


def components(pairs, count):
    """The smallest member of every node's connected component, for `count` nodes joined by `pairs`."""
    label = np.arange(count)
    while True:
        low = np.minimum(label[pairs[:, 0]], label[pairs[:, 1]])
        best = label.copy()
        np.minimum.at(best, pairs[:, 0], low)
        np.minimum.at(best, pairs[:, 1], low)
        np.minimum.at(best, label[pairs[:, 0]], low)
        np.minimum.at(best, label[pairs[:, 1]], low)
        best = best[best]
        if np.array_equal(best, label):
            return label
        label = best


@dataclass
class Topology:
    border_edges: int
    border_loops: int
    non_manifold_edges: int
    euler: int
    pieces: int
    repeated_faces: int


def topology(mesh):
    """Counts after welding. A border loop is a connected set of edges with one triangle."""
    face = welded_faces(mesh)
    edge, uses = edges(face)
    border = edge[uses == 1]
    nodes, local = np.unique(border, return_inverse=True)
    loops = components(local.reshape(-1, 2), len(nodes)) if len(border) else np.empty(0)
    used, compact = np.unique(face, return_inverse=True)
    piece = components(np.searchsorted(used, edge), len(used))
    distinct = np.unique(np.sort(face, axis=1), axis=0)
    return Topology(
        border_edges=len(border),
        border_loops=len(np.unique(loops)),
        non_manifold_edges=int((uses > 2).sum()),
        euler=len(used) - len(edge) + len(face),
        pieces=len(np.unique(piece)),
        repeated_faces=len(face) - len(distinct),
    )


def uv_areas(mesh):
    """Signed areas of the texture triangles."""
    a, b, c = (mesh.texcoord[mesh.face_uv[:, k]] for k in range(3))
    ab, ac = b - a, c - a
    return 0.5 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


def charts(mesh):
    """A chart number per triangle: triangles that share a (position, texcoord) pair are of one chart."""
    key = mesh.face * (len(mesh.texcoord) + 1) + mesh.face_uv
    _, wedge = np.unique(key, return_inverse=True)
    wedge = wedge.reshape(-1, 3)
    pairs = np.concatenate([wedge[:, [0, 1]], wedge[:, [1, 2]]])
    label = components(pairs, wedge.max() + 1)[wedge[:, 0]]
    return np.unique(label, return_inverse=True)[1]


def seam_wedges(mesh):
    """{position: set of texcoords} of the vertices that have more than one texcoord."""
    pairs = np.unique(np.stack([mesh.face.reshape(-1), mesh.face_uv.reshape(-1)], -1), axis=0)
    vertex, uses = np.unique(pairs[:, 0], return_counts=True)
    wanted = set(vertex[uses > 1].tolist())
    found = {}
    for v, t in pairs.tolist():
        if v in wanted:
            found.setdefault(tuple(mesh.position[v].tolist()), set()).add(tuple(mesh.texcoord[t].tolist()))
    return found


class ChartMap:
    """The texture square of a mesh as pixels: which chart lies where, and which surface point it shows.

    `grow` pixels around every chart count as the chart's own, for rounding and for straightened outlines.
    """

    def __init__(self, mesh, side=2048):
        self.side = side
        self.chart = np.full((side, side), -1, np.int64)
        self.point = np.full((side, side, 3), np.nan)
        numbers = charts(mesh)
        for t, (uv, xyz, number) in enumerate(
            zip(mesh.texcoord[mesh.face_uv] * side, mesh.position[mesh.face], numbers)
        ):
            low = np.maximum(np.floor(uv.min(axis=0)).astype(int) - 1, 0)
            high = np.minimum(np.ceil(uv.max(axis=0)).astype(int) + 1, side)
            x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
            (ax, ay), (bx, by), (cx, cy) = uv
            area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            if area == 0:
                continue
            v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
            w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
            inside = (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1 + 1e-9)
            rows, columns = (y[inside] - 0.5).astype(int), (x[inside] - 0.5).astype(int)
            self.chart[rows, columns] = number
            self.point[rows, columns] = xyz[0] + v[inside, None] * (xyz[1] - xyz[0]) + w[inside, None] * (xyz[2] - xyz[0])

    def grow(self, pixels):
        """Widens every chart into the empty pixels around it."""
        for _ in range(pixels):
            for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
                near, near_point = np.roll(self.chart, step, axis), np.roll(self.point, step, axis)
                take = (self.chart < 0) & (near >= 0)
                self.chart[take], self.point[take] = near[take], near_point[take]
        return self

    def look_up(self, uv):
        """(chart numbers, surface points) at texture coordinates."""
        x, y = np.clip((uv * self.side).astype(int), 0, self.side - 1).T
        return self.chart[y, x], self.point[y, x]


def surface_samples(mesh, count, seed=1):
    """`count` points spread evenly over the surface: (triangle, position, texture coordinate) of each."""
    random = np.random.default_rng(seed)
    a, b, c = (mesh.position[mesh.face[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    triangle = random.choice(len(area), count, p=area / area.sum())
    v, w = random.random((2, count))
    outside = v + w > 1
    v[outside], w[outside] = 1 - v[outside], 1 - w[outside]
    weight = np.stack([1 - v - w, v, w], -1)[..., None]
    position = (mesh.position[mesh.face[triangle]] * weight).sum(axis=1)
    texcoord = (mesh.texcoord[mesh.face_uv[triangle]] * weight).sum(axis=1) if len(mesh.texcoord) else None
    return triangle, position, texcoord
