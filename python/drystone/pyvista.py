"""Simplifies meshes of PyVista; imports it when it is called."""

from typing import TYPE_CHECKING, Any

import numpy as np

from drystone.arrays import simplify_mesh
from drystone.errors import UsageError

if TYPE_CHECKING:
    from pyvista import PolyData


def simplify(mesh: "PolyData", *, material: str | None = None, colors: str | None = None, **options: Any) -> "PolyData":
    """Simplifies a `pyvista.PolyData`; options are those of `drystone.simplify_mesh`.

    Keeps the active texture coordinates; vertices are split at seams again. `material` names an array of integers of
    the cells: lines between its values are kept. `colors` names an array (n, 3) of the points. Other arrays are left
    out. The texture of a plotter goes with the result as with the mesh; new ones are made by `drystone.simplify_mesh`.
    """
    import pyvista

    if not isinstance(mesh, pyvista.PolyData):
        raise TypeError(f"expected a pyvista.PolyData, found {type(mesh).__name__}; see its extract_surface()")
    if options.get("textures", "keep") != "keep":
        raise UsageError("a PolyData has no texture of its own: call drystone.simplify_mesh for `textures='bake'`")
    surface = mesh if mesh.is_all_triangles else mesh.triangulate()
    uv = surface.active_texture_coordinates
    done = simplify_mesh(
        np.asarray(surface.points),
        surface.regular_faces,
        uv=None if uv is None else np.asarray(uv),
        face_material=None if material is None else np.asarray(surface.cell_data[material]),
        vertex_colors=None if colors is None else np.asarray(surface.point_data[colors]),
        **options,
    )
    result = pyvista.PolyData.from_regular_faces(done.vertices, done.faces)
    if done.uv is not None:
        result.active_texture_coordinates = done.uv
    if material is not None:
        result.cell_data[material] = done.face_material
    if colors is not None:
        result.point_data[colors] = done.vertex_colors
    return result
