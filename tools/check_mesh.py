#!/usr/bin/env python3
"""check_mesh.py OUT.obj [--against IN.obj] [--json]: counts cracks, topology and folded texture of an OBJ file.

The same counts as `drystone check`, by other means: an OBJ reader of its own and array operations instead of tables of
half-edges, so that a mistake in one shows as a difference from the other.  Needs numpy and nothing else.

Vertices at equal positions are welded first.  Polygons are cut into the fan of their first corner.

Exit code: 0 if nothing is worse than in IN.obj (or there is none to compare with), 1 if something is, 2 if a file
cannot be read.
"""
import argparse
import json
import sys
from array import array

import numpy as np

T_JUNCTION_TOLERANCE = 1e-6  # of the bounding box's diagonal
FLAT_RATIO = 1e-9  # height per longest side below which a triangle has no area
FLAT_ROUNDINGS = 4.0  # the same in roundings of the largest coordinate
PAIRS_AT_ONCE = 4_000_000

# what may not rise, and what it is called
WORSE = [
    ("boundary_loops", "boundary loops"),
    ("t_junctions", "T-junctions"),
    ("non_manifold_edges", "non-manifold edges"),
    ("non_manifold_vertices", "non-manifold vertices"),
    ("inconsistent_edges", "inconsistent edges"),
    ("components", "components"),
    ("degenerate_faces", "degenerate faces"),
    ("zero_area_faces", "zero-area faces"),
    ("duplicate_faces", "duplicate faces"),
    ("folded_uv", "folded texture triangles"),
]


class BadMesh(Exception):
    """A file that is no OBJ mesh; the message begins with file and line."""


class Mesh:
    """positions (v, 3), texcoords (t, 2), faces (f, 3), face_texcoords (f, 3) and materials (f); -1 stands for none."""


def read_obj(path):
    """Reads v, vt, f and usemtl; materials are one if their names are."""
    try:
        with open(path, "rb") as file:
            text = file.read()
    except OSError as error:
        raise BadMesh(f"{path}: {error.strerror}") from error
    positions, texcoords = array("d"), array("d")
    faces, face_texcoords, materials = array("q"), array("q"), array("q")
    material_ids, material, rest_of_line = {}, -1, b""
    for number, line in enumerate(text.split(b"\n"), 1):
        line = rest_of_line + line.rstrip(b"\r")
        rest_of_line = b""
        if line.endswith(b"\\"):
            rest_of_line = line[:-1] + b" "
            continue
        words = line.split()
        if not words:
            continue
        try:
            if words[0] == b"v":
                x, y, z = words[1:4]
                positions.extend((float(x), float(y), float(z)))
            elif words[0] == b"vt":
                u, v = words[1], words[2] if len(words) > 2 else 0.0
                texcoords.extend((float(u), float(v)))
            elif words[0] == b"f":
                corners = [read_corner(word, len(positions) // 3, len(texcoords) // 2) for word in words[1:]]
                if len(corners) < 3:
                    raise ValueError(f"a face of {len(corners)} corners")
                for b, c in zip(corners[1:], corners[2:]):
                    for vertex, texcoord in (corners[0], b, c):
                        faces.append(vertex)
                        face_texcoords.append(texcoord)
                    materials.append(material)
            elif words[0] == b"usemtl":
                name = line.split(None, 1)[1].strip() if len(words) > 1 else b""
                material = material_ids.setdefault(name, len(material_ids))
        except ValueError as error:
            raise BadMesh(f"{path}:{number}: {error}") from error
    mesh = Mesh()
    mesh.positions = np.array(positions, np.float64).reshape(-1, 3)
    mesh.texcoords = np.array(texcoords, np.float64).reshape(-1, 2)
    mesh.faces = np.array(faces, np.int64).reshape(-1, 3)
    mesh.face_texcoords = np.array(face_texcoords, np.int64).reshape(-1, 3)
    mesh.materials = np.array(materials, np.int64)
    for ids, count, low, what in (
        (mesh.faces, len(mesh.positions), 0, "vertex"),
        (mesh.face_texcoords, len(mesh.texcoords), -1, "texture coordinate"),
    ):
        if len(ids) and (ids.min() < low or ids.max() >= count):
            raise BadMesh(f"{path}: a face refers to a {what} that the file does not have; it has {count}")
    return mesh


def read_corner(word, vertex_count, texcoord_count):
    """'7/8/9', '7//9' or '7' -> (6, 7 or -1); negative numbers count back from the last one read so far."""
    fields = word.split(b"/")
    vertex = int(fields[0])
    vertex = vertex - 1 if vertex > 0 else vertex_count + vertex
    if len(fields) < 2 or not fields[1]:
        return vertex, -1
    texcoord = int(fields[1])
    texcoord = texcoord - 1 if texcoord > 0 else texcoord_count + texcoord
    if vertex < 0 or texcoord < 0:
        raise ValueError("a face refers to something before the first one")
    return vertex, texcoord


def unique_rows(rows):
    """First row of each kind, and for each row which kind it is."""
    rows = rows + 0.0
    if not len(rows):
        return rows, np.zeros(0, np.int64)
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    begins = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    kind = np.empty(len(rows), np.int64)
    kind[order] = np.cumsum(begins) - 1
    return ordered[begins], kind


def components(count, a, b):
    """Smallest member of the set of each of 0 .. count when a[i] and b[i] hang together."""
    label = np.arange(count)
    while True:
        low, high = np.minimum(label[a], label[b]), np.maximum(label[a], label[b])
        apart = low != high
        if not apart.any():
            return label
        a, b = a[apart], b[apart]
        np.minimum.at(label, high[apart], low[apart])
        while True:
            jumped = label[label]
            if (jumped == label).all():
                break
            label = jumped


def repeats(faces):
    """Whether each face names a vertex twice."""
    a, b, c = faces.T
    return (a == b) | (b == c) | (c == a)


def is_flat(area_2, longest, largest):
    """Whether triangles of these doubled areas and longest sides have no area."""
    limit = longest * (FLAT_RATIO * longest + FLAT_ROUNDINGS * np.finfo(np.float64).eps * largest)
    return ~(area_2 > limit)


def lengths(vectors):
    """Length of each row."""
    total = vectors[:, 0] * vectors[:, 0]
    for k in range(1, vectors.shape[1]):
        total = total + vectors[:, k] * vectors[:, k]
    return np.sqrt(total)


def longest_sides(corners):
    """Longest side of triangles given as (f, 3, k)."""
    sides = [lengths(corners[:, (k + 1) % 3] - corners[:, k]) for k in range(3)]
    return np.maximum(np.maximum(sides[0], sides[1]), sides[2])


def check(mesh):
    """All counts, by name."""
    positions, vertex_of = unique_rows(mesh.positions)
    faces = vertex_of[mesh.faces]
    sound = ~repeats(faces)
    counts = {"degenerate_faces": int((~sound).sum())}
    faces, materials = faces[sound], mesh.materials[sound]
    face_count = len(faces)
    used = np.unique(faces)
    _, texcoord_of = unique_rows(mesh.texcoords)
    face_texcoords = mesh.face_texcoords[sound]
    uv_kinds = np.append(texcoord_of, -1)[face_texcoords]  # index -1 finds the appended "none"

    # half-edges, sorted by the edge they lie on
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    order = np.lexsort((high, low))
    half_face, half_corner = np.arange(3 * face_count) // 3, np.arange(3 * face_count) % 3
    first_corner = half_face * 3 + half_corner
    next_corner = half_face * 3 + (half_corner + 1) % 3
    upward = begin < end
    low_corner, high_corner = np.where(upward, first_corner, next_corner), np.where(upward, next_corner, first_corner)
    same = (low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1])
    group = np.concatenate([[0], np.cumsum(~same)]) if face_count else np.zeros(0, np.int64)
    sizes = np.bincount(group) if face_count else np.zeros(0, np.int64)
    starts = np.cumsum(sizes) - sizes

    boundary_half = order[starts[sizes == 1]]
    boundary = np.stack([low[boundary_half], high[boundary_half]], axis=1)
    one, two = order[starts[sizes == 2]], order[starts[sizes == 2] + 1]
    left, right = order[:-1][same], order[1:][same]  # neighbours on an edge of any number of faces
    corner_label = components(
        3 * face_count,
        np.concatenate([low_corner[left], high_corner[left]]),
        np.concatenate([low_corner[right], high_corner[right]]),
    )
    fan_corners = np.flatnonzero(corner_label == np.arange(3 * face_count))
    fans = np.bincount(begin[fan_corners], minlength=len(positions))
    piece = components(face_count, half_face[left], half_face[right])
    loop = components(len(positions), boundary[:, 0], boundary[:, 1])
    bounds = positions[used] if len(used) else np.zeros((1, 3))
    diagonal = float(np.linalg.norm(bounds.max(axis=0) - bounds.min(axis=0)))
    corners = positions[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).reshape(-1, 3)
    flat = is_flat(lengths(normal), longest_sides(corners), np.abs(bounds).max())
    counts.update(
        vertices=len(used),
        faces=face_count,
        unused_vertices=len(positions) - len(used),
        zero_area_faces=int(flat.sum()),
        duplicate_faces=face_count - len(np.unique(np.sort(faces, axis=1), axis=0)),
        boundary_edges=len(boundary),
        boundary_loops=len(np.unique(loop[boundary])),
        non_manifold_edges=int((sizes > 2).sum()),
        inconsistent_edges=int((upward[one] == upward[two]).sum()),
        non_manifold_vertices=int((fans > 1).sum()),
        components=len(np.unique(piece)),
        euler=len(used) - len(sizes) + face_count,
        t_junctions=count_t_junctions(positions, boundary, T_JUNCTION_TOLERANCE * diagonal),
    )

    # charts
    corner_uv = uv_kinds.ravel()
    joined = (
        (materials[half_face[one]] == materials[half_face[two]])
        & (corner_uv[low_corner[one]] == corner_uv[low_corner[two]])
        & (corner_uv[high_corner[one]] == corner_uv[high_corner[two]])
    )
    textured = (uv_kinds >= 0).all(axis=1)
    inside = joined & textured[half_face[one]] & textured[half_face[two]] & (upward[one] != upward[two])
    chart = components(face_count, half_face[one][inside], half_face[two][inside])
    area = np.zeros(face_count)
    uv = mesh.texcoords[face_texcoords[textured]].reshape(-1, 3, 2)
    (ax, ay), (bx, by) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
    uv_area = ax * by - ay * bx
    uv_flat = is_flat(np.abs(uv_area), longest_sides(uv), np.abs(mesh.texcoords).max(initial=0.0))
    area[textured] = np.where(uv_flat, 0.0, uv_area)
    chart_area = np.bincount(chart, weights=area, minlength=face_count)
    counts.update(
        uv_negative=int((area < 0).sum()),
        uv_positive=int((area > 0).sum()),
        uv_degenerate=int(uv_flat.sum()),
        folded_uv=int((np.sign(area) * np.sign(chart_area[chart]) < 0).sum()),
        charts=len(np.unique(chart[textured])),
        seam_edges=int((~joined).sum()),
    )
    return counts


def count_t_junctions(positions, boundary, tolerance):
    """Number of boundary vertices within tolerance of the inside of a boundary edge that is not theirs.

    Edges are cut into pieces of at most half a cell of a grid, so that a piece touches at most two cells along each
    axis; vertices are looked up in these cells by sorted keys.
    """
    if not len(boundary):
        return 0
    vertices = np.unique(boundary)
    origin = positions[vertices].min(axis=0)
    extent = float((positions[vertices].max(axis=0) - origin).max())
    length = lengths(positions[boundary[:, 1]] - positions[boundary[:, 0]])
    boundary, length = boundary[length > 2 * tolerance], length[length > 2 * tolerance]  # shorter ones have no inside
    if not len(boundary):
        return 0
    cell = max(float(length.mean()), 8 * tolerance, extent / 1e6)

    def keys(cells):
        return (cells[:, 0] << 42) + (cells[:, 1] << 21) + cells[:, 2]

    vertex_keys = keys(np.floor((positions[vertices] - origin) / cell).astype(np.int64) + 1)
    order = np.argsort(vertex_keys, kind="stable")
    vertices, vertex_keys = vertices[order], vertex_keys[order]

    parts = np.maximum(np.ceil(length / (0.5 * cell)), 1).astype(np.int64)
    edge = np.repeat(np.arange(len(boundary)), parts)
    part = np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)
    start, step = positions[boundary[edge, 0]], (positions[boundary[:, 1]] - positions[boundary[:, 0]])[edge]
    p, q = start + step * (part / parts[edge])[:, None], start + step * ((part + 1) / parts[edge])[:, None]
    margin = 1.01 * tolerance
    low = np.floor((np.minimum(p, q) - margin - origin) / cell).astype(np.int64) + 1
    high = np.floor((np.maximum(p, q) + margin - origin) / cell).astype(np.int64) + 1
    found = np.zeros(len(vertices), bool)
    for corner in range(8):
        upper = np.array([corner >> k & 1 for k in range(3)], bool)
        once = (~upper | (high > low)).all(axis=1)  # where both cells are one, the lower one is enough
        wanted = keys(np.where(upper, high, low)[once])
        edges = edge[once]
        first, last = np.searchsorted(vertex_keys, wanted, "left"), np.searchsorted(vertex_keys, wanted, "right")
        some = last > first
        edges, first, last = edges[some], first[some], last[some]
        ends = np.cumsum(last - first)
        at = 0
        while at < len(edges):
            done = ends[at - 1] if at else 0
            to = max(int(np.searchsorted(ends, done + PAIRS_AT_ONCE, "right")), at + 1)
            number = (last - first)[at:to]
            pair_edge = boundary[np.repeat(edges[at:to], number)]
            pair = np.arange(number.sum()) + np.repeat(first[at:to] - np.cumsum(number) + number, number)
            found[pair[touches_inside(positions, vertices[pair], pair_edge, tolerance)]] = True
            at = to
    return int(found.sum())


def touches_inside(positions, vertex, edge, tolerance):
    """Whether each vertex lies on the inside of its edge and is not an end of it."""
    a, step = positions[edge[:, 0]], positions[edge[:, 1]] - positions[edge[:, 0]]
    offset = positions[vertex] - a
    length = lengths(step)
    along = (offset * step).sum(axis=1) / (step * step).sum(axis=1)
    off = lengths(offset - step * along[:, None])
    stranger = (vertex != edge[:, 0]) & (vertex != edge[:, 1])
    return stranger & (along * length > tolerance) & ((1 - along) * length > tolerance) & (off <= tolerance)


def compare(before, after):
    """What is worse after than before."""
    new = []
    if before["boundary_edges"] == 0 and after["boundary_edges"] > 0:
        new.append({"what": "open edges of a closed mesh", "before": 0, "after": after["boundary_edges"]})
    for name, what in WORSE:
        if after[name] > before[name]:
            new.append({"what": what, "before": before[name], "after": after[name]})
    return new


ROWS = """vertices faces unused_vertices degenerate_faces zero_area_faces duplicate_faces boundary_edges boundary_loops
non_manifold_edges inconsistent_edges non_manifold_vertices components euler t_junctions uv_negative uv_positive
uv_degenerate folded_uv charts seam_edges""".split()


def main():
    """Reads, counts, compares, prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", metavar="OUT.obj")
    parser.add_argument("--against", metavar="IN.obj", help="mesh that OUT.obj was made of")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    args = parser.parse_args()
    try:
        after = check(read_obj(args.out))
        before = check(read_obj(args.against)) if args.against else None
    except BadMesh as error:
        print(error, file=sys.stderr)
        return 2
    new = compare(before, after) if before else []
    after, before = ({name: counts[name] for name in ROWS} if counts else None for counts in (after, before))
    if args.json:
        print(json.dumps({"after": after, "before": before, "new": new}))
    else:
        for name in ROWS:
            print(f"{name:<22}{after[name]:>12}" + (f"{before[name]:>12}" if before else ""))
        for item in new:
            print(f"new: {item['what']}: {item['before']} before, {item['after']} after")
    return 1 if new else 0


if __name__ == "__main__":
    sys.exit(main())
