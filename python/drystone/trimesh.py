"""Simplifies meshes of trimesh; imports it when it is called."""

from typing import TYPE_CHECKING, Any

import numpy as np

from drystone.arrays import Mesh, simplify_mesh
from drystone.errors import UsageError

if TYPE_CHECKING:
    from trimesh import Trimesh


def simplify(mesh: "Trimesh", **options: Any) -> "Trimesh":
    """Simplifies a `trimesh.Trimesh`; options are those of `drystone.simplify_mesh`.

    Keeps texture coordinates and their material, or colours of vertices; vertices are split at seams again. With
    `textures="bake"`, the new material shows a new image. The report is `result.metadata["drystone"]`.
    """
    import trimesh
    from trimesh.visual import ColorVisuals, TextureVisuals

    if not isinstance(mesh, trimesh.Trimesh):
        raise TypeError(f"expected a trimesh.Trimesh, found {type(mesh).__name__}; a scene has several")
    visual = mesh.visual
    uv = visual.uv if isinstance(visual, TextureVisuals) else None
    colors = visual.vertex_colors[:, :3] if isinstance(visual, ColorVisuals) and visual.kind == "vertex" else None
    if options.get("textures") == "bake" and "texture" not in options:
        options["texture"] = _image_of(visual)
    done = simplify_mesh(mesh.vertices, mesh.faces, uv=uv, vertex_colors=colors, **options)
    new: Any = None
    if done.textures is not None:
        new = TextureVisuals(uv=done.uv, image=_only_image(done))
    elif done.uv is not None:
        new = TextureVisuals(uv=done.uv, material=visual.material)
    result = trimesh.Trimesh(done.vertices, done.faces, visual=new, process=False)
    if done.vertex_colors is not None:
        result.visual = ColorVisuals(result, vertex_colors=done.vertex_colors)
    result.metadata["drystone"] = done.report
    return result


def _image_of(visual: Any) -> Any:
    material = getattr(visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is None:
        raise UsageError("`textures='bake'`: the mesh has no image")
    return image


def _only_image(done: Mesh) -> Any:
    from PIL import Image

    if done.textures is None or len(done.textures) != 1:
        count = len(done.textures or ())
        raise UsageError(f"the new texture takes {count} images, and a Trimesh has one: give fewer `texels` or a larger `atlas`")
    return Image.fromarray(np.ascontiguousarray(done.textures[0]))
