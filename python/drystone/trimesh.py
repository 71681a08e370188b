"""Simplifies meshes of trimesh; imports it when it is called."""

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from drystone.arrays import Mesh, simplify_mesh
from drystone.errors import UsageError

if TYPE_CHECKING:
    from trimesh import Trimesh


def simplify(mesh: "Trimesh", **options: Any) -> "Trimesh":
    """Simplifies a `trimesh.Trimesh`; options are those of `drystone.simplify_mesh`.

    Keeps texture coordinates and materials, or colours of vertices or faces; vertices are split at seams again. A
    warning says so if alpha of vertices is left out. With `textures="bake"`, the new material shows a new image. The report is
    `result.metadata["drystone"]`.
    """
    import trimesh
    from trimesh.visual import ColorVisuals, TextureVisuals

    if not isinstance(mesh, trimesh.Trimesh):
        raise TypeError(f"expected a trimesh.Trimesh, found {type(mesh).__name__}; a scene has several")
    visual = mesh.visual
    uv = colors = labels = palette = None
    if isinstance(visual, TextureVisuals):
        uv, labels = visual.uv, getattr(visual, "face_materials", None)
    elif isinstance(visual, ColorVisuals) and visual.kind == "vertex":
        colors = visual.vertex_colors[:, :3]
        if (visual.vertex_colors[:, 3] < 255).any():
            warnings.warn("colours of vertices: their alpha is left out", stacklevel=2)
    elif isinstance(visual, ColorVisuals) and visual.kind == "face":
        palette, labels = np.unique(visual.face_colors, axis=0, return_inverse=True)
        labels = labels.ravel()
    if options.get("textures") == "bake" and "texture" not in options:
        options["texture"] = _images_of(visual, labels)
    done = simplify_mesh(mesh.vertices, mesh.faces, uv=uv, vertex_colors=colors, face_material=labels, **options)
    new: Any = None
    if done.textures is not None:
        new = TextureVisuals(uv=done.uv, image=_only_image(done))
    elif isinstance(visual, TextureVisuals):
        new = TextureVisuals(uv=done.uv, material=visual.material, face_materials=done.face_material)
    result = trimesh.Trimesh(done.vertices, done.faces, visual=new, process=False, metadata=dict(mesh.metadata))
    if done.vertex_colors is not None:
        result.visual = ColorVisuals(result, vertex_colors=done.vertex_colors)
    elif palette is not None:
        result.visual = ColorVisuals(result, face_colors=palette[done.face_material])
    result.metadata["drystone"] = done.report
    return result


def _images_of(visual: Any, labels: Any) -> Any:
    """The image of the material, or those of the materials that faces have."""
    material = getattr(visual, "material", None)
    if labels is not None and material is not None and hasattr(material, "materials"):
        return {int(label): _image_of(material.materials[int(label)]) for label in np.unique(labels)}
    return _image_of(material)


def _image_of(material: Any) -> Any:
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
