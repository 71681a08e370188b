"""Simplifies meshes of Open3D; imports it when it is called."""

from typing import TYPE_CHECKING, Any

import numpy as np

from drystone.arrays import simplify_mesh

if TYPE_CHECKING:
    from open3d.geometry import TriangleMesh


def simplify(mesh: "TriangleMesh", **options: Any) -> "TriangleMesh":
    """Simplifies an `open3d.geometry.TriangleMesh`; options are those of `drystone.simplify_mesh`.

    Keeps triangle_uvs, triangle_material_ids, vertex_colors and textures; with `textures="bake"`, the textures are new.
    """
    import open3d

    if not isinstance(mesh, open3d.geometry.TriangleMesh):
        raise TypeError(f"expected an open3d.geometry.TriangleMesh, found {type(mesh).__name__}")
    faces = np.asarray(mesh.triangles)
    has_uv, has_ids = mesh.has_triangle_uvs(), mesh.has_triangle_material_ids()
    ids = np.asarray(mesh.triangle_material_ids) if has_ids else None
    if options.get("textures") == "bake" and "texture" not in options:
        images = {number: _turned(image) for number, image in enumerate(mesh.textures) if not image.is_empty()}
        used = images.keys() if ids is None else set(ids.tolist())
        options["texture"] = {n: image for n, image in images.items() if n in used} if has_ids else images.get(0)
    done = simplify_mesh(
        np.asarray(mesh.vertices),
        faces,
        uv=np.asarray(mesh.triangle_uvs) if has_uv else None,
        face_uv=np.arange(3 * len(faces)).reshape(-1, 3) if has_uv else None,
        face_material=ids,
        vertex_colors=np.asarray(mesh.vertex_colors) if mesh.has_vertex_colors() else None,
        **options,
    )
    utility = open3d.utility
    result = open3d.geometry.TriangleMesh(
        utility.Vector3dVector(done.vertices), utility.Vector3iVector(done.faces.astype(np.int32, copy=False))
    )
    if done.uv is not None and done.face_uv is not None:
        result.triangle_uvs = utility.Vector2dVector(done.uv[done.face_uv].reshape(-1, 2))
    if done.face_material is not None:
        result.triangle_material_ids = utility.IntVector(done.face_material.astype(np.int32))
    if done.vertex_colors is not None:
        result.vertex_colors = utility.Vector3dVector(done.vertex_colors.astype(np.float64))
    make: Any = open3d.geometry.Image
    textures = mesh.textures if done.textures is None else [make(_turned(image)) for image in done.textures]
    result.textures = list(textures)
    return result


def _turned(image: Any) -> Any:
    """An image upside down: Open3D keeps the lowest row first, drystone the highest."""
    return np.ascontiguousarray(np.asarray(image)[::-1])
