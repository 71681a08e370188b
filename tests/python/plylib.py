"""Writes a mesh as PLY in each encoding, in the form of MeshLab, apart from drystone."""

from pathlib import Path

import numpy as np

ENCODINGS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}


def write(path, mesh, textures=(), encoding="binary_little_endian", number="double"):
    """A mesh of `objlib.read` as PLY; `textures` maps the names of materials to those of images."""
    names = list(dict(textures).values())
    images = {material: names.index(image) for material, image in dict(textures).items()}
    head = ["ply", f"format {encoding} 1.0"]
    head += [f"comment TextureFile {name}" for name in names]
    head += [f"element vertex {len(mesh.position)}"] + [f"property {number} {axis}" for axis in "xyz"]
    if mesh.colour is not None:
        head += [f"property double {channel}" for channel in ("red", "green", "blue")]
    head += [f"element face {len(mesh.face)}", "property list uchar int vertex_indices"]
    if len(mesh.texcoord):
        head += [f"property list uchar {number} texcoord", "property int texnumber"]
    vertices = [mesh.position] + ([] if mesh.colour is None else [mesh.colour])
    with open(path, "wb") as out:
        out.write(("\n".join(head) + "\nend_header\n").encode())
        order = ENCODINGS[encoding]

        def put(kind, values):
            if order is None:
                out.write((" ".join(repr(v) for v in np.asarray(values).tolist()) + " ").encode())
            else:
                out.write(np.asarray(values).astype(order + kind).tobytes())

        def end():
            if order is None:
                out.write(b"\n")

        real = {"double": "f8", "float": "f4"}[number]
        for place in range(len(mesh.position)):
            put(real, vertices[0][place])
            if mesh.colour is not None:
                put("f8", vertices[1][place])
            end()
        for place, face in enumerate(mesh.face):
            put("u1", [3])
            put("i4", face)
            if len(mesh.texcoord):
                has_uv = mesh.face_uv[place].min() >= 0
                put("u1", [6 if has_uv else 0])
                if has_uv:
                    put(real, mesh.texcoord[mesh.face_uv[place]].reshape(-1))
                put("i4", [images.get(mesh.material[place], 0 if not images else -1)])
            end()


def header(path):
    """The lines of a PLY's header."""
    return Path(path).read_bytes().split(b"end_header\n")[0].decode().splitlines()
