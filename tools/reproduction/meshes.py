"""The meshes: figures and terrains with the papers' counts, and pieces of real surveys."""

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from . import limbs


def write(path, content):
    """Writes a file whole or not at all, and only if it is new: several pages may make the same mesh at a time."""
    content = content if isinstance(content, bytes) else content.encode()
    if not path.exists() or path.read_bytes() != content:
        half = path.with_suffix(f".{os.getpid()}.half")
        half.write_bytes(content)
        half.replace(path)
    return path


def write_image(path, pixels):
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, "png")
    return write(path, content.getvalue())


def copy_images(source, folder):
    """Copies the materials and images beside a mesh into a folder, if it is another."""
    folder.mkdir(exist_ok=True)
    if folder != source.parent:
        for beside in source.parent.iterdir():
            if beside.suffix in (".mtl", ".jpg", ".png"):
                write(folder / beside.name, beside.read_bytes())


def write_obj(path, vertices, faces, uvs=None, uv_faces=None, material=()):
    lines = [line for name in material for line in (f"mtllib {path.stem}.mtl", f"usemtl {name}")]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    if uvs is None:
        lines += [f"f {a} {b} {c}" for a, b, c in np.asarray(faces) + 1]
    else:
        lines += [f"vt {u:.7f} {v:.7f}" for u, v in uvs]
        corners = zip(np.asarray(faces) + 1, np.asarray(uv_faces) + 1)
        lines += [f"f {a}/{p} {b}/{q} {c}/{r}" for (a, b, c), (p, q, r) in corners]
    return write(path, "\n".join(lines) + "\n")


def split_faces(vertices, uvs, faces, uv_faces, count, random):
    """Puts a vertex into so many faces, two faces more each."""
    vertices, uvs, faces, uv_faces = list(vertices), list(uvs), list(faces), list(uv_faces)
    for face in random.choice(len(faces), count, replace=False):
        (a, b, c), (p, q, r) = faces[face], uv_faces[face]
        v, t = len(vertices), len(uvs)
        vertices.append((vertices[a] + vertices[b] + vertices[c]) / 3)
        uvs.append((uvs[p] + uvs[q] + uvs[r]) / 3)
        faces[face], uv_faces[face] = (a, b, v), (p, q, t)
        faces += [(b, c, v), (c, a, v)]
        uv_faces += [(q, r, t), (r, p, t)]
    return np.array(vertices), np.array(uvs), np.array(faces), np.array(uv_faces)


def town(folder, triangles):
    """The generated town of so many triangles, with its pictures."""
    made = folder / "town.obj"
    if not made.exists():
        tool = Path(__file__).resolve().parents[1] / "fixtures"
        subprocess.run([sys.executable, tool, "town", "--triangles", str(triangles), "--out", folder], check=True, stdout=sys.stderr)
    return made


def terrain(path):
    """30,868 triangles with 566 border edges: hills, ridges and a river bed of 730 m by 2,100 m."""
    columns, rows, random = 73, 210, np.random.default_rng(7)
    y, x = np.mgrid[0 : rows + 1, 0 : columns + 1].astype(float)
    z = np.zeros_like(x)
    for octave in range(6):
        size = 40.0 / 2**octave
        grid = random.standard_normal((int(rows / size) + 3, int(columns / size) + 3))
        i, j = (y / size).astype(int), (x / size).astype(int)
        s, t = y / size - i, x / size - j
        s, t = s * s * (3 - 2 * s), t * t * (3 - 2 * t)
        z += 45.0 / 2**octave * ((1 - s) * ((1 - t) * grid[i, j] + t * grid[i, j + 1]) + s * ((1 - t) * grid[i + 1, j] + t * grid[i + 1, j + 1]))
    z -= 18 * np.exp(-(((x - 36 - 12 * np.sin(y / 25)) / 4) ** 2))
    vertices = np.stack([10 * x.ravel(), 10 * y.ravel(), z.ravel()], 1)
    uvs = np.stack([x.ravel() / columns, y.ravel() / rows], 1)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices, uvs, faces, uv_faces = split_faces(vertices, uvs, faces, faces, 104, random)
    lanes = (np.mgrid[0:1024, 0:512] // 24).sum(0) % 2
    picture = np.stack([110 + 60 * lanes, 140 - 40 * lanes, 70 + 50 * lanes], 2) + random.integers(-25, 26, (1024, 512, 1))
    write_image(path.with_suffix(".png"), picture.astype(np.uint8))
    write(path.with_suffix(".mtl"), f"newmtl ground\nmap_Kd {path.stem}.png\n")
    return write_obj(path, vertices, faces, uvs, uv_faces, ["ground"])


def lathe(profile, around, bumps=0.0, noise=0.0, seed=3):
    """A closed surface of revolution about z, from (radius, height) pairs, first and last on the axis."""
    random, profile = np.random.default_rng(seed), np.asarray(profile, float)
    inner, turn = profile[1:-1], np.arange(around) / around
    vertices = [(0, 0, profile[0][1])]
    for radius, height in inner:
        wave = 1 + bumps * np.sin(5 * 2 * np.pi * turn + 7 * height) + noise * random.standard_normal(around)
        vertices += list(zip(radius * wave * np.cos(2 * np.pi * turn), radius * wave * np.sin(2 * np.pi * turn), np.full(around, height)))
    vertices.append((0, 0, profile[-1][1]))
    count, last = len(inner), 1 + len(inner) * around
    vertex = lambda ring, k: 1 + ring * around + k % around
    faces, uv_faces, uvs = [], [], []
    for ring in range(count):
        uvs += [(k / around, (ring + 1) / (count + 1)) for k in range(around + 1)]
    poles = len(uvs)
    uvs += [((k + 0.5) / around, 0.0) for k in range(around)] + [((k + 0.5) / around, 1.0) for k in range(around)]
    texture = lambda ring, k: ring * (around + 1) + k
    for k in range(around):
        faces.append((0, vertex(0, k + 1), vertex(0, k)))
        uv_faces.append((poles + k, texture(0, k + 1), texture(0, k)))
        for ring in range(count - 1):
            a, b, c, d = vertex(ring, k), vertex(ring, k + 1), vertex(ring + 1, k + 1), vertex(ring + 1, k)
            p, q, r, s = texture(ring, k), texture(ring, k + 1), texture(ring + 1, k + 1), texture(ring + 1, k)
            faces += [(a, b, c), (a, c, d)]
            uv_faces += [(p, q, r), (p, r, s)]
        faces.append((last, vertex(count - 1, k), vertex(count - 1, k + 1)))
        uv_faces.append((poles + around + k, texture(count - 1, k), texture(count - 1, k + 1)))
    return np.array(vertices, float), np.array(uvs), np.array(faces), np.array(uv_faces)


def stick(path):
    """10,474 triangles: an ellipsoid of 4 m across with a stick of 1.2 m by 1 cm, all one surface."""
    body = [(2 * np.sin(t), -0.7 * np.cos(t)) for t in np.linspace(0, np.pi - 0.01, 106)]
    rod = [(0.005, 0.7 + 1.2 * s) for s in np.linspace(0.01, 1, 25)]
    vertices, uvs, faces, uv_faces = lathe([*body, *rod, (0, 1.9)], 40, 0.03)
    vertices, uvs, faces, uv_faces = split_faces(vertices, uvs, faces, uv_faces, (10474 - len(faces)) // 2, np.random.default_rng(1))
    return write_obj(path, vertices, faces)


def antenna():
    """The car's antenna: 90 cm by 1 cm, a closed piece of its own that leans back from the roof."""
    rod, _, faces, _ = lathe([(0, 0), *((0.005, 0.9 * s) for s in np.linspace(0, 1, 26)), (0, 0.9)], 8)
    rod[:, 0] -= 0.3 * rod[:, 2]
    return rod + [-0.75, 0.35, 1.36], faces


def car(path, thinned):
    """10,474 triangles: a body with a cabin, wheels and mirrors, thinned by a function from a finer mesh, and an antenna."""
    rod, triangles = antenna()
    fine = write_obj(path.with_name("car-fine.obj"), *limbs.car())
    vertices, faces = thinned(fine, 10474 - len(triangles))
    return write_obj(path, np.concatenate([vertices, rod]), np.concatenate([faces, triangles + len(vertices)]))


def part_where(path, vertices, faces, holds):
    """The triangles of which all corners lie where something holds."""
    return write_obj(path, vertices, faces[holds(*vertices.T)[faces].all(1)])


def rotor(path):
    """A body with four rotor blades of 5 m by 30 cm by 2 cm, each a closed piece."""
    vertices, _, faces, _ = lathe([(1.5 * np.sin(t), -1.2 * np.cos(t)) for t in np.linspace(0, np.pi, 90)], 48, 0.02)
    pieces, triangles, count = [vertices], [faces], len(vertices)
    for blade in range(4):
        blank, _, flat, _ = lathe([(np.sin(t), -np.cos(t)) for t in np.linspace(0, np.pi, 40)], 12)
        blank = blank[:, [2, 0, 1]] * [2.5, 0.15, 0.01] + [2.6, 0, 1.4]
        angle = blade * np.pi / 2
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        pieces.append(blank @ turn.T)
        triangles.append(flat + count)
        count += len(blank)
    return write_obj(path, np.concatenate(pieces), np.concatenate(triangles))


def blade_mesh():
    """The blade of a knife, a hand wide before the right hand of the person: 34 cm by 5 cm by 12 mm."""
    blank, _, faces, _ = lathe([(np.sin(t), -np.cos(t)) for t in np.linspace(0, np.pi, 14)], 12)
    return blank[:, [2, 0, 1]] * [0.17, 0.006, 0.025] + [0.33, 0.58, 0.99], faces


def blade(path):
    return write_obj(path, *blade_mesh())


def person_with_knife(path):
    """The person in about 4,000 triangles with a knife in a hand, a closed piece of its own."""
    vertices, faces = limbs.person(22)
    knife, triangles = blade_mesh()
    return write_obj(path, np.concatenate([vertices, knife]), np.concatenate([faces, triangles + len(vertices)]))


def half_flat(path, side=44):
    """A sheet of which the left half is wavy and the right one flat."""
    y, x = np.mgrid[0 : side + 1, 0 : side + 1].astype(float)
    z = np.where(x < side / 2, 1.2 * np.sin(0.9 * x) * np.cos(0.8 * y), 0.0)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    a, b, c, d = corner, corner + 1, corner + side + 2, corner + side + 1
    return write_obj(path, np.stack([x.ravel(), y.ravel(), z.ravel()], 1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def figure(path, around, rings, seed):
    """A textured figure: belly, neck, head and a beak, with a seam down its back, two eyes and a striped tie."""
    t = np.linspace(0, 1, rings)
    radius = 0.5 * np.sin(np.pi * t) ** 0.6 * (1 + 0.5 * np.cos(6 * t)) * (1 - 0.5 * np.exp(-(((t - 0.7) / 0.05) ** 2)))
    radius += 0.15 * np.exp(-(((t - 0.95) / 0.03) ** 2))
    radius[0] = radius[-1] = 0
    vertices, uvs, faces, uv_faces = lathe(list(zip(radius, 2.5 * t)), around, 0.04, 0.004, seed)
    y, x = np.mgrid[0:1024, 0:1024] / 1024
    picture = np.full((1024, 1024, 3), 190, np.uint8)
    for u in (0.15, 0.4):
        away = np.hypot(x - u, (1 - y - 0.85) * 1.5)
        picture[away < 0.05] = (245, 245, 240)
        picture[away < 0.022] = (20, 40, 90)
    tie = (abs(x - 0.275) < 0.06) & (abs(1 - y - 0.65) < 0.08)
    picture[tie] = np.where((np.floor(60 * (x + y)) % 2 == 0)[tie][:, None], (150, 20, 30), (240, 220, 60))
    write_image(path.with_suffix(".png"), picture)
    write(path.with_suffix(".mtl"), f"newmtl skin\nmap_Kd {path.stem}.png\n")
    return write_obj(path, vertices, faces, uvs, uv_faces, ["skin"])


def bevelled_box(path, side=24):
    """A box of flat faces with rounded edges, evenly cut: creases between large flats, as in engineering."""
    at = np.linspace(-1, 1, side + 1)
    v, w = (grid.ravel() for grid in np.meshgrid(at, at, indexing="ij"))
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    sheet = np.concatenate([np.stack([corner, corner + 1, corner + side + 2], 1), np.stack([corner, corner + side + 2, corner + side + 1], 1)])
    vertices, faces = [], []
    for axis in range(3):
        for sign in (-1, 1):
            square = np.stack([np.full_like(v, sign), v, w], 1)
            square = square[:, [[0, 1, 2], [2, 0, 1], [1, 2, 0]][axis]]
            faces.append((sheet if sign < 0 else sheet[:, ::-1]) + len(vertices) * len(v))
            vertices.append(square)
    vertices, places = np.unique(np.concatenate(vertices).round(9), axis=0, return_inverse=True)
    inner = np.clip(vertices, -0.85, 0.85)
    away = vertices - inner
    length = np.linalg.norm(away, axis=1, keepdims=True)
    vertices = np.where(length > 0, inner + 0.15 * away / np.maximum(length, 1e-9), vertices)
    return write_obj(path, vertices, places.ravel()[np.concatenate(faces)])


def without_texture(source, path):
    """The same triangles without texture coordinates and materials."""
    kept = []
    for line in source.open():
        word, *rest = line.split() or [""]
        if word == "v":
            kept.append(line)
        elif word == "f":
            kept.append("f " + " ".join(corner.split("/")[0] for corner in rest) + "\n")
    return write(path, "".join(kept))


def shuffled(path, vertices, faces, seed):
    """The same mesh turned about, its vertices and triangles in another order."""
    random = np.random.default_rng(seed)
    order = random.permutation(len(vertices))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    return write_obj(path, vertices[order] @ turn.T, place[faces][random.permutation(len(faces))])


def reordered(source, path, seed):
    """The same mesh with its vertices, texture coordinates and triangles in another order; triangles stay with their material."""
    random = np.random.default_rng(seed)
    rows, groups = {"v": [], "vt": []}, [[]]
    for line in source.open():
        word = line.partition(" ")[0]
        if word in rows:
            rows[word].append(line)
        elif word == "f":
            groups[-1].append(line.split()[1:])
        else:
            groups += [line, []]
    places = {}
    for word, lines in rows.items():
        order = random.permutation(len(lines))
        places[word] = np.argsort(order) + 1
        rows[word] = [lines[k] for k in order]
    turned = lambda corner: "/".join(str(places[word][int(number) - 1]) for word, number in zip(("v", "vt"), corner.split("/")))
    lines = []
    for group in groups:
        lines += [group] if isinstance(group, str) else [f"f {' '.join(map(turned, group[k]))}\n" for k in random.permutation(len(group))]
    first = next(at for at, line in enumerate(lines) if line.startswith("f "))
    copy_images(source, path.parent)
    return write(path, "".join([line for line in lines[:first] if not line.startswith("usemtl")] + rows["v"] + rows["vt"] + [line for line in lines[:first] if line.startswith("usemtl")] + lines[first:]))


def beside_its_images(source, path):
    """A result of a run, whose MTL names its images by path, under a name of its own; without its images it is no mesh with texture."""
    path.parent.mkdir(exist_ok=True)
    materials = source.with_suffix(".mtl")
    if materials.exists():
        write(path.with_suffix(".mtl"), materials.read_text())
    return write(path, source.read_text().replace(materials.name, path.with_suffix(".mtl").name))


# Orders that a mesh is taken in, and of one with more triangles than `LARGE`.
ORDERS, ORDERS_OF_LARGE, LARGE = 5, 3, 50000


def orders(source):
    """A mesh, and the same in other orders."""
    folder = source.parent if source.is_relative_to("target") else Path("target/reproduce") / f"{source.stem}-orders"
    count = ORDERS if sum(line.startswith("f ") for line in source.open()) < LARGE else ORDERS_OF_LARGE
    return [source, *(reordered(source, folder / f"{source.stem}-order-{seed}.obj", seed) for seed in range(1, count))]


def part_of(source, path, materials):
    """The triangles of some materials."""
    vertices, faces, material = [], [], None
    for line in source.open():
        word, _, rest = line.strip().partition(" ")
        if word == "v":
            vertices.append([float(x) for x in rest.split()])
        elif word == "usemtl":
            material = rest
        elif word == "f" and material in materials:
            faces.append([int(corner.split("/")[0]) - 1 for corner in rest.split()])
    return write_obj(path, vertices, faces)


def outlines(source, path, one, other):
    """Points along the edges between two materials, each a triangle half a millimetre wide, so that they are a mesh."""
    vertices, owners, material = [], {}, None
    for line in source.open():
        word, _, rest = line.strip().partition(" ")
        if word == "v":
            vertices.append([float(x) for x in rest.split()])
        elif word == "usemtl":
            material = rest
        elif word == "f":
            corners = [int(corner.split("/")[0]) - 1 for corner in rest.split()]
            for a, b in zip(corners, corners[1:] + corners[:1]):
                owners.setdefault((min(a, b), max(a, b)), set()).add(material)
    edges = np.array([edge for edge, materials in owners.items() if materials == {one, other}])
    ends = np.array(vertices)[edges]
    points = np.concatenate([ends[:, 0] + share * (ends[:, 1] - ends[:, 0]) for share in (0.1, 0.3, 0.5, 0.7, 0.9)])
    points = points[np.random.default_rng(5).permutation(len(points))[:10000]]
    corners = points[:, None] + 5e-4 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1]])
    return write_obj(path, corners.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3))


def of_materials(source, materials):
    """The triangles of some materials with their texture coordinates, in a file in the folder of their pictures."""
    path = source.with_name(f"{source.stem}.{'-'.join(sorted(materials))}.obj")
    kept, material = [], None
    for line in source.open():
        word, _, rest = line.strip().partition(" ")
        material = rest if word == "usemtl" else material
        if word in ("mtllib", "v", "vt") or word in ("usemtl", "f") and material in materials:
            kept.append(line)
    path = path if source.is_relative_to("target") else Path("target/reproduce") / path.name
    copy_images(source, path.parent)
    return write(path, "".join(kept))


def cut(path, source, wanted, choose_middle=lambda triangles, wanted: np.median(triangles.mean(1), 0), has_images=True):
    """A compact piece of a survey: the triangles nearest to a middle, with their texture coordinates and images."""
    if path.exists() and path.stat().st_mtime > max(source.stat().st_mtime, Path(__file__).stat().st_mtime):
        return path
    path.unlink(missing_ok=True)
    vertices, uvs, faces, material = [], [], [], -1
    for line in source.open(errors="replace"):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(w) for w in words[1:4]])
        elif words[0] == "vt":
            uvs.append([float(w) for w in words[1:3]])
        elif words[0] == "usemtl":
            material = words[1]
        elif words[0] == "f":
            faces.append((material, [[int(n) for n in (w if "/" in w else f"{w}/1").split("/")[:2]] for w in words[1:4]]))
    vertices, uvs = np.array(vertices), np.array(uvs)
    vertices -= vertices[0].round()
    corners = np.array([face for _, face in faces]) - 1
    triangles = vertices[corners[:, :, 0]]
    centres, middle = triangles.mean(1), choose_middle(triangles, wanted)
    order = np.argsort(((centres - middle) ** 2).sum(1), kind="stable")[:wanted]
    order.sort()
    used, place = np.unique(corners[order][:, :, 0], return_inverse=True)
    used_uv, place_uv = np.unique(corners[order][:, :, 1], return_inverse=True)
    place, place_uv = place.reshape(-1, 3) + 1, place_uv.reshape(-1, 3) + 1
    if not has_images:
        return write_obj(path, vertices[used], place - 1)
    copy_materials(source, path, {faces[face][0] for face in order})
    lines = [f"mtllib {path.stem}.mtl"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices[used]]
    lines += [f"vt {u:.8f} {v:.8f}" for u, v in uvs[used_uv]]
    now = None
    for at, face in enumerate(order):
        if faces[face][0] != now:
            now = faces[face][0]
            lines.append(f"usemtl {now}")
        lines.append("f " + " ".join(f"{v}/{t}" for v, t in zip(place[at], place_uv[at])))
    return write(path, "\n".join(lines) + "\n")


def copy_materials(source, path, used):
    """Writes the used materials of a survey beside its piece, and their images into a folder of its own."""
    images = path.with_suffix(".images")
    images.mkdir(exist_ok=True)
    kept, name = [], None
    for line in source.with_suffix(".mtl").read_text(errors="replace").splitlines():
        word, _, rest = line.strip().partition(" ")
        name = rest if word == "newmtl" else name
        if word == "newmtl" and name in used:
            kept.append(line.strip())
        elif word == "map_Kd" and name in used:
            write(images / Path(rest).name, (source.parent / rest).read_bytes())
            kept.append(f"map_Kd {images.name}/{Path(rest).name}")
    write(path.with_suffix(".mtl"), "\n".join(kept) + "\n")


def most_ground(triangles, wanted, tries=80):
    """The middle of a piece with as much of its area as possible no steeper than 45 degrees, seen from above."""
    centres, across = triangles.mean(1), np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area, level = np.linalg.norm(across, axis=1), across[:, 2]
    shares = []
    for middle in (middles := centres[:: len(centres) // tries]):
        near = np.argpartition(((centres - middle) ** 2).sum(1), wanted)[:wanted]
        shares.append(area[near][level[near] > np.sqrt(0.5) * area[near]].sum() / area[near].sum())
    return middles[np.argmax(shares)]
