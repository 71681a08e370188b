#!/usr/bin/env python3
"""python.py NAME=IN.obj...: simplifiers called from Python, one mesh in arrays, as a page of Markdown on stdout.

    python3 tools/benchmarks/python.py town=town.obj terrain=terrain.obj > docs/results/python.md

Each call runs three times in a process of its own, which loads the arrays first: the time is that of the call alone, the
memory what the process grew by. `drystone compare` measures each result against the input. A mesh with texture
coordinates is given with them to the tools that take them. Needs the package (pip install ./python), numpy, pillow, and
the tools of the table; one that is missing has no row.
"""
import argparse
import datetime
import importlib.metadata
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import measure

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "python"))
RATIO, REPEATS, SAMPLES = 0.1, 3, 200_000
HEAD = """# Simplifiers called from Python

Made by `tools/benchmarks/python.py` with drystone {version}, {date},
{machine}.
One mesh in numpy arrays, simplified to {share:.0%} of its triangles with the defaults of each tool.
[Benchmarks](benchmarks.md#inputs) describes the inputs.

* *Seconds* of the call, median of {repeats} runs; drystone uses all cores, the others one. PyMeshLab
  takes a texture from files alone: its time with texture is that of the filter;
* *MiB*: what the process grew by during the call, at its peak;
* *RMS*, *Largest*: distances both ways, as `drystone compare` measures them, in 1e-4 of the
  diagonal;
* *Colour*: root mean square of the difference of colours, 0 to 255, result to input and input to
  result;
* *Open edges*: of the result; the input's are in the heading.

Rows compare like for like that keep the same: those with texture with *drystone*, those without
with *drystone, positions alone*. *New textures* does more than any other row: it paints images for
the result, so that seams do not hold the mesh.
"""


def load(path):
    """Vertices, faces, uv, face_uv, face_material of an OBJ of triangles; names of its materials."""
    vertices, uv, corners, material, names = [], [], [], [], []
    current = -1
    for line in open(path, encoding="latin-1"):
        if line.startswith("v "):
            vertices.append(line.split()[1:4])
        elif line.startswith("vt "):
            uv.append(line.split()[1:3])
        elif line.startswith("usemtl"):
            name = line.split(None, 1)[1].strip()
            if name not in names:
                names.append(name)
            current = names.index(name)
        elif line.startswith("f "):
            words = line.split()[1:]
            corners += [[word.split("/")[:2] for word in (words[0], words[i], words[i + 1])] for i in range(1, len(words) - 1)]
            material += [current] * (len(words) - 2)
    has_uv = bool(uv)
    ids = np.array([[[int(part or 0) for part in (corner + ["0"])[:2]] for corner in face] for face in corners]) - 1
    return {
        "vertices": np.array(vertices, float),
        "faces": np.ascontiguousarray(ids[:, :, 0]),
        **({"uv": np.array(uv, float), "face_uv": np.ascontiguousarray(ids[:, :, 1])} if has_uv else {}),
        **({"face_material": np.array(material)} if names else {}),
    }, names


def library_of(source):
    """Name of the first material library of an OBJ, or None."""
    lines = (line for line in open(source, encoding="latin-1") if line.startswith("mtllib"))
    return next((line.split(None, 1)[1].strip() for line in lines), None)


def images_of(source, names):
    """The image of each material, as arrays by material; none where a material has none."""
    from PIL import Image

    library = library_of(source)
    if library is None:
        return {}
    folder = Path(source).parent
    text = (folder / library).read_text(encoding="latin-1")
    image = {part.split("\n")[0].strip(): part.split("map_Kd")[1].split("\n")[0].strip()
             for part in text.split("newmtl ")[1:] if "map_Kd" in part}  # fmt: skip
    if not names or not set(names) <= image.keys():
        return {}
    return {number: np.asarray(Image.open(folder / image[name]).convert("RGB")) for number, name in enumerate(names)}


def write_images(folder, found):
    """Writes new images and their materials; returns the names of these and the library."""
    from PIL import Image

    names = [f"baked{number}" for number in range(sum(key.startswith("texture_") for key in found))]
    for number, name in enumerate(names):
        Image.fromarray(found[f"texture_{number}"]).save(folder / f"{name}.png")
    (folder / "baked.mtl").write_text("".join(f"newmtl {name}\nmap_Kd {name}.png\n" for name in names))
    return names, "baked.mtl"


def split(mesh):
    """Vertices, faces and uv with one texture coordinate a vertex, as tools without seams take them."""
    pairs, places = np.unique(
        np.stack([mesh["faces"], mesh["face_uv"]], -1).reshape(-1, 2), axis=0, return_inverse=True
    )
    return mesh["vertices"][pairs[:, 0]], places.reshape(-1, 3), mesh["uv"][pairs[:, 1]]


def by_drystone(mesh, count):
    import drystone

    found = drystone.simplify_mesh(**mesh, face_count=count)
    return {k: v for k, v in found._asdict().items() if k in ("vertices", "faces", "uv", "face_uv", "face_material") and v is not None}


def by_drystone_baked(mesh, count):
    import drystone

    found = drystone.simplify_mesh(**mesh, face_count=count, textures="bake")
    images = {f"texture_{number}": image for number, image in enumerate(found.textures)}
    kept = {k: getattr(found, k) for k in ("vertices", "faces", "uv", "face_uv", "face_material")}
    return {k: v for k, v in kept.items() if v is not None} | images


def by_drystone_bare(mesh, count):
    return by_drystone({key: mesh[key] for key in ("vertices", "faces")}, count)


def by_fast_simplification(mesh, count):
    import fast_simplification

    points, faces = mesh["vertices"], mesh["faces"]
    points, faces = fast_simplification.simplify(points, faces, target_count=count)
    return {"vertices": points, "faces": faces}


def by_pyfqmr(mesh, count):
    import pyfqmr

    simplifier = pyfqmr.Simplify()
    simplifier.setMesh(mesh["vertices"], mesh["faces"])
    simplifier.simplify_mesh(target_count=count)
    vertices, faces, _ = simplifier.getMesh()
    return {"vertices": vertices, "faces": faces}


def by_trimesh(mesh, count):
    import trimesh

    found = trimesh.Trimesh(mesh["vertices"], mesh["faces"], process=False).simplify_quadric_decimation(face_count=count)
    return {"vertices": found.vertices, "faces": found.faces}


def by_open3d(mesh, count):
    import open3d

    utility = open3d.utility
    made = open3d.geometry.TriangleMesh(utility.Vector3dVector(mesh["vertices"]), utility.Vector3iVector(mesh["faces"]))
    found = made.simplify_quadric_decimation(count)
    return {"vertices": np.asarray(found.vertices), "faces": np.asarray(found.triangles)}


def by_pyvista(mesh, count):
    import pyvista

    made = pyvista.PolyData.from_regular_faces(mesh["vertices"], mesh["faces"])
    found = made.decimate(1 - count / len(mesh["faces"]))
    return {"vertices": np.asarray(found.points), "faces": found.regular_faces}


def by_pyvista_uv(mesh, count):
    import pyvista

    points, faces, uv = split(mesh)
    made = pyvista.PolyData.from_regular_faces(points, faces)
    made.active_texture_coordinates = uv
    found = made.decimate(1 - count / len(faces), attribute_error=True, tcoords=True)
    ids = found.regular_faces
    return {"vertices": np.asarray(found.points), "faces": ids, "uv": np.asarray(found.active_texture_coordinates), "face_uv": ids}


def by_pymeshlab(mesh, count):
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh["vertices"], mesh["faces"]))
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=count)
    found = meshes.current_mesh()
    return {"vertices": found.vertex_matrix(), "faces": found.face_matrix()}


def loaded_by_pymeshlab(mesh):
    """The mesh with its texture, which PyMeshLab takes from files alone."""
    import pymeshlab
    from PIL import Image

    count = int(mesh["face_material"].max()) + 1 if "face_material" in mesh else 1
    with tempfile.TemporaryDirectory() as name:
        folder, names = Path(name), [f"material{number}" for number in range(count)]
        for material in names:
            Image.new("RGB", (4, 4)).save(folder / f"{material}.png")
        (folder / "a.mtl").write_text("".join(f"newmtl {material}\nmap_Kd {material}.png\n" for material in names))
        write_obj(folder / "a.obj", mesh, names, "a.mtl")
        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(str(folder / "a.obj"))
    return meshes


def by_pymeshlab_uv(meshes, count):
    meshes.meshing_decimation_quadric_edge_collapse_with_texture(targetfacenum=count)
    return meshes


def saved_by_pymeshlab(meshes):
    """The result with its materials, which PyMeshLab gives to files alone."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "a.obj"
        meshes.save_current_mesh(str(path))
        mesh, names = load(path)
        text = (path.with_name(library_of(path))).read_text()
    image = {part.split()[0]: part.split("map_Kd")[1].split()[0] for part in text.split("newmtl ")[1:] if "map_Kd" in part}
    number = np.array([int(image[name].removeprefix("material").removesuffix(".png")) for name in names])
    return mesh | {"face_material": number[mesh["face_material"]]}


# Name of the row, distribution, call, and what is kept of a texture and of materials.
TOOLS = [
    ("drystone", "drystone", by_drystone, "seams, materials"),
    ("drystone, new textures", "drystone", by_drystone_baked, "new textures"),
    ("PyMeshLab, with texture", "pymeshlab", by_pymeshlab_uv, "seams, materials"),
    ("PyVista (VTK), with texture", "pyvista", by_pyvista_uv, "of split vertices"),
    ("drystone, positions alone", "drystone", by_drystone_bare, "–"),
    ("PyMeshLab", "pymeshlab", by_pymeshlab, "–"),
    ("PyVista (VTK)", "pyvista", by_pyvista, "–"),
    ("Open3D", "open3d", by_open3d, "–"),
    ("fast-simplification", "fast-simplification", by_fast_simplification, "–"),
    ("trimesh", "trimesh", by_trimesh, "–"),
    ("pyfqmr", "pyfqmr", by_pyfqmr, "–"),
]
# Rows of meshes with texture coordinates alone.
NEED_TEXTURE = {by_pymeshlab_uv, by_pyvista_uv, by_drystone_bare, by_drystone_baked}


def write_obj(path, mesh, names, library):
    """Writes arrays as an OBJ."""
    with open(path, "w") as file:
        if "uv" in mesh and library:
            file.write(f"mtllib {library}\n")
        np.savetxt(file, mesh["vertices"], fmt="v %.9g %.9g %.9g")
        if "uv" not in mesh:
            np.savetxt(file, mesh["faces"] + 1, fmt="f %d %d %d")
            return
        np.savetxt(file, mesh["uv"], fmt="vt %.7g %.7g")
        lines = np.stack([mesh["faces"], mesh["face_uv"]], -1).reshape(-1, 6) + 1
        material = mesh.get("face_material", np.zeros(len(lines), int))
        for number in np.unique(material):
            if names:
                file.write(f"usemtl {names[number]}\n")
            np.savetxt(file, lines[material == number], fmt="f %d/%d %d/%d %d/%d")


def child(tool, arrays, count, out):
    """One run in a process of its own: seconds, growth in bytes; the result goes to `out`."""
    mesh = dict(np.load(arrays))
    call = TOOLS[tool][2]
    prepare = loaded_by_pymeshlab if call is by_pymeshlab_uv else dict
    small = {"vertices": np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), "faces": np.array([[0, 1, 2], [0, 2, 3]])}
    small |= {"uv": small["vertices"][:, :2], "face_uv": small["faces"]} if "uv" in mesh else {}
    small |= {"face_material": np.zeros(2, int)} if "face_material" in mesh else {}
    if call is by_drystone_baked:
        image = np.zeros((8, 8, 3), np.uint8)
        small["texture"] = {0: image} if "face_material" in mesh else image
    try:
        # Imports are not timed.
        call(prepare(small), 2)
    except Exception:
        pass
    if call is by_drystone_baked:
        images = dict(np.load(Path(arrays).with_name("images.npz")))
        images = {int(number): image for number, image in images.items()}
        mesh["texture"] = images if "face_material" in mesh else images[0]
    prepared = prepare(mesh)
    with open("/proc/self/clear_refs", "w") as peak:
        peak.write("5")
    before, began = resident(), time.perf_counter()
    found = call(prepared, count)
    seconds = time.perf_counter() - began
    print(json.dumps({"seconds": seconds, "bytes": resident("VmHWM") - before}))
    if call is by_pymeshlab_uv:
        found = saved_by_pymeshlab(found)
    np.savez(out, **found)


def resident(field="VmRSS"):
    line = next(line for line in open("/proc/self/status") if line.startswith(field))
    return int(line.split()[1]) * 1024


def measured(tool, arrays, count, folder):
    """Median of the runs of a tool, or None if it is not there or fails."""
    runs = []
    for _ in range(REPEATS):
        command = [sys.executable, str(Path(__file__).resolve()), "--child", str(tool), str(arrays), str(count), str(folder / "out.npz")]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            print(f"{TOOLS[tool][0]}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
            return None
        runs.append(json.loads(done.stdout.splitlines()[-1]))
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]}


def rows(name, source, folder):
    """The heading and the table of a mesh."""
    import drystone

    mesh, names = load(source)
    arrays = folder / "arrays.npz"
    np.savez(arrays, **mesh)
    count = round(RATIO * len(mesh["faces"]))
    library, images = library_of(source), images_of(source, names)
    np.savez(folder / "images.npz", **{str(number): image for number, image in images.items()})
    before = drystone.inspect(source).topology
    yield f"\n## {name}: {len(mesh['faces']):,} triangles, {before.boundary_edges:,} open edges\n"
    yield "| Tool | Version | Keeps | Triangles | Seconds | MiB | RMS | Largest | Colour | Open edges |"
    yield "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    for number, (tool, package, call, keeps) in enumerate(TOOLS):
        if call in NEED_TEXTURE and "uv" not in mesh or call is by_drystone_baked and not images:
            continue
        try:
            version = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
        run = measured(number, arrays, count, folder)
        if run is None:
            yield f"| {tool} | {version} | {keeps} | – | – | – | – | – | fails | – |"
            continue
        found = dict(np.load(folder / "out.npz"))
        # A tool that loses the materials has lost the colours, unless there is one material.
        has_names = "face_material" in found or len(names) < 2
        result = folder / "out.obj"
        for entry in Path(source).resolve().parent.iterdir():
            if not (folder / entry.name).exists():
                (folder / entry.name).symlink_to(entry)
        if call is by_drystone_baked:
            write_obj(result, found, *write_images(folder, found))
        else:
            write_obj(result, found, names if has_names else [], library if has_names else None)
        compared = drystone.compare(source, result, samples=SAMPLES)
        scale = 1e4 / compared.geometry.diagonal
        both, texture = compared.geometry.symmetric, compared.texture
        colour = "–" if texture is None else f"{texture.colour_rms:.1f} / {texture.colour_backward_rms:.1f}"
        open_edges = compared.topology.after.boundary_edges
        yield (
            f"| {tool} | {version} | {keeps} | {len(found['faces']):,} | {run['seconds']:.2f} | {run['bytes'] / 2**20:.0f} "
            f"| {both.rms * scale:.2f} | {both.max * scale:.1f} | {colour} | {open_edges:,} |"
        )


def main():
    if sys.argv[1:2] == ["--child"]:
        return child(int(sys.argv[2]), sys.argv[3], int(sys.argv[4]), sys.argv[5])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="+", metavar="NAME=IN.obj")
    options = parser.parse_args()
    import drystone

    date = datetime.date.today().isoformat()
    print(HEAD.format(version=drystone.__version__, date=date, machine=measure.machine(), share=RATIO, repeats=REPEATS))
    for word in options.meshes:
        name, _, path = word.partition("=")
        with tempfile.TemporaryDirectory() as folder:
            for line in rows(name, path, Path(folder)):
                print(line, flush=True)


if __name__ == "__main__":
    main()
