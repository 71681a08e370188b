"""Meshes in numpy arrays."""

import numbers
import os
import warnings
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drystone import _native, array_file
from drystone.array_file import ArrayMesh
from drystone.array_job import ArrayJob
from drystone.errors import ChangedError, InputError, LimitError, MissingInputError, UsageError
from drystone.files import call, judge
from drystone.options import SIMPLIFY_KEYS, PathLike, Resume, SimplifyOptions, Size, flags, paths, refuse_unknown
from drystone.progress import Progress
from drystone.report import Report

_NONE = 0xFFFFFFFF


class Mesh(NamedTuple):
    """A simplified mesh: `vertices, faces, *_ = drystone.simplify_mesh(…)`.

    `vertices` (n, 3) of float64; `faces` (m, 3) of int32, or int64 beyond 2³¹ vertices; `uv`, `face_uv`,
    `face_material` and `vertex_colors` in the form that came in, None for what did not; `textures`, the baked images,
    (height, width, 3) of uint8, one for each value of `face_material`.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[Any]
    uv: NDArray[np.float64] | None
    face_uv: NDArray[Any] | None
    face_material: NDArray[Any] | None
    vertex_colors: NDArray[Any] | None
    textures: tuple[NDArray[np.uint8], ...] | None
    report: Report


def simplify_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    uv: ArrayLike | None = None,
    face_uv: ArrayLike | None = None,
    face_material: ArrayLike | None = None,
    vertex_colors: ArrayLike | None = None,
    texture: Any = None,
    textures: Literal["keep", "bake"] = "keep",
    ratio: float | str | None = None,
    face_count: int | str | None = None,
    max_error: float | None = None,
    memory: Size | None = None,
    threads: int | None = None,
    work: PathLike | None = None,
    resume: Resume = "auto",
    strict: bool = False,
    progress: Progress = None,
    stop: _native.Stop | None = None,
    **options: Unpack[SimplifyOptions],
) -> Mesh:
    """Simplifies a mesh in arrays.

    `vertices` (n, 3) of numbers; `faces` (m, 3) of indices, or (m, k) with -1 behind polygons of fewer corners. `uv`
    (n, 2), one for each vertex; or (j, 2) with `face_uv`, the indices of each face's corners in it, -1 for none, as an
    OBJ has them. `face_material` (m,) of integers: lines between materials are kept. `vertex_colors` (n, 3).

    `textures="bake"` makes new textures that show what `texture` shows: an image (height, width, 3 or 4) of uint8 or
    of PIL, or a mapping of one for each value of `face_material`. Then seams do not hold the mesh. A warning says so if
    alpha below 255 is left out.

    Give `ratio`, `face_count` or `max_error`, as for `simplify`; the options are the same. The result is that of the
    command line for an OBJ of the same numbers in the same order. The arrays are read once, at the beginning; the
    intermediate files go to a temporary folder, or to `work`: then the same call resumes a job that was stopped, and
    `drystone.status(work)` says how far it is.

    >>> import numpy as np, drystone
    >>> x, y = np.meshgrid(np.arange(21.0), np.arange(21.0))
    >>> vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(441)])
    >>> corner = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel()
    >>> faces = corner[:, None] + np.array([[0, 1, 22, 21]])
    >>> mesh = drystone.simplify_mesh(vertices, faces, face_count=2)
    >>> mesh.vertices.shape, mesh.faces.shape
    ((4, 3), (2, 3))
    """
    refuse_unknown("simplify_mesh", options, SIMPLIFY_KEYS)
    form = _Form(vertices, faces, uv, face_uv, face_material, vertex_colors)
    images = form.images(texture, textures)
    if any((pixels[:, :, 3:] < 255).any() for _, pixels in images):
        warnings.warn("texture: its alpha is left out; the new texture is opaque", stacklevel=2)
    images = [(label, pixels[:, :, :3]) for label, pixels in images]
    with ArrayJob(work) as job:
        source = job.write(form.mesh, images)
        result = job.path(os.path.basename(source).replace("input-", "result-", 1))
        given = dict(
            options,
            ratio=ratio,
            face_count=face_count,
            max_error=max_error,
            memory=memory,
            threads=threads,
            work=job.path("job"),
            resume=resume,
            textures="bake" if textures == "bake" else None,
            no_sync=work is None,
            force=True,
        )
        arguments = ["simplify", f"--output={result}", *flags(given), "--", source]
        try:
            code, value = call(arguments, progress, stop)
        except MissingInputError:
            raise
        except (ChangedError, InputError, LimitError) as error:
            raise type(error)(job.of_arrays(str(error))) from None
        mesh, baked = job.read(result)
    value["warnings"] = [job.of_arrays(words) for words in value["warnings"]]
    value |= {"input": "the mesh", "inputs": ["the mesh"], "output": "the result"}
    value["options"]["work"] = None if work is None else paths(work)[0]
    report = Report.from_dict(value)
    found = form.result(mesh, baked, textures, report)
    judge(report, code, strict, found)
    return found


class _Form:
    """The arrays of a call, and how the result becomes arrays of the same form."""

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        uv: ArrayLike | None,
        face_uv: ArrayLike | None,
        face_material: ArrayLike | None,
        vertex_colors: ArrayLike | None,
    ) -> None:
        at = array_file.checked("vertices", vertices, 3, "fiu")
        corners = array_file.checked("faces", faces, None, "iu")
        self.is_uv_of_vertices = uv is not None and face_uv is None
        coordinates = None if uv is None else array_file.checked("uv", uv, 2, "fiu")
        if self.is_uv_of_vertices and coordinates is not None and len(coordinates) != len(at):
            raise InputError(f"uv: expected one for each of {len(at):,} vertices, found {len(coordinates):,}")
        if face_uv is not None and uv is None:
            raise UsageError("`face_uv` refers to `uv`, which is missing")
        ids = None if face_uv is None else array_file.checked("face_uv", face_uv, None, "iu")
        if ids is not None and ids.shape != corners.shape:
            raise InputError(f"face_uv: expected the shape of faces, {corners.shape}, found {ids.shape}")
        self.material_type: np.dtype[Any] | None = None
        self.materials: NDArray[Any] | None = None
        labels = None if face_material is None else self._labels(face_material, len(corners))
        self.color_type: np.dtype[Any] | None = None
        colors = None
        if vertex_colors is not None:
            colors = array_file.checked("vertex_colors", vertex_colors, 3, "fiu")
            if len(colors) != len(at):
                raise InputError(f"vertex_colors: expected one for each of {len(at):,} vertices, found {len(colors):,}")
            self.color_type = colors.dtype
        if self.is_uv_of_vertices:
            ids = corners
        self.mesh = ArrayMesh(at, corners, coordinates, ids, labels, colors)

    def _labels(self, face_material: ArrayLike, face_count: int) -> NDArray[Any]:
        """Materials as 32-bit numbers."""
        values = array_file.checked("face_material", face_material, 0, "iu")
        if len(values) != face_count:
            raise InputError(f"face_material: expected one for each of {face_count:,} faces, found {len(values):,}")
        self.material_type = values.dtype
        if len(values) > 0 and (values.min() < 0 or values.max() >= _NONE):
            self.materials, values = np.unique(values, return_inverse=True)
        return values

    def images(self, texture: Any, textures: str) -> list[tuple[int, NDArray[np.uint8]]]:
        """Label and pixels of each texture that is baked."""
        if not isinstance(textures, str) or textures not in ("keep", "bake"):
            raise UsageError("`textures`: expected 'keep' or 'bake'; images are `texture`")
        if textures == "keep":
            if texture is not None:
                raise UsageError("`texture` needs `textures='bake'`; otherwise the texture stays as it is")
            return []
        if texture is None or self.mesh.uv is None:
            raise UsageError("`textures='bake'` needs `texture` and `uv`")
        if not isinstance(texture, Mapping):
            if self.mesh.labels is not None:
                raise UsageError("with `face_material`, `texture` maps each of its values to an image")
            labels = np.broadcast_to(np.uint32(0), len(self.mesh.faces))
            self.mesh = ArrayMesh(**{**vars(self.mesh), "labels": labels})
            return [(0, _pixels(texture))]
        if self.mesh.labels is None:
            raise UsageError("`texture` maps values of `face_material`, which is missing")
        used = np.unique(self.mesh.labels)
        materials = used if self.materials is None else self.materials
        label_of = dict(zip(materials.tolist(), used.tolist()))
        for material in texture:
            if not isinstance(material, numbers.Integral):
                raise UsageError(f"`texture`: expected values of `face_material`, found {material!r}")
        if missing := [material for material in label_of if material not in texture]:
            raise UsageError(f"`texture` has no image for material {missing[0]}")
        return [(label, _pixels(texture[material])) for material, label in label_of.items()]

    def result(
        self,
        mesh: ArrayMesh,
        images: list[tuple[int, NDArray[np.uint8]]],
        textures: str,
        report: Report,
    ) -> Mesh:
        """The result in the form of the input."""
        at, faces, uv, face_uv, labels, colors = (
            mesh.vertices,
            mesh.faces,
            mesh.uv,
            mesh.face_uv,
            mesh.labels,
            mesh.colors,
        )
        if self.mesh.uv is not None and uv is None:
            # No corner has any.
            uv, face_uv = np.zeros((0, 2)), np.full_like(faces, -1)
        if self.is_uv_of_vertices and uv is not None and len(uv) and face_uv is not None:
            at, faces, uv, colors = _split(at, faces, uv, face_uv, colors)
            face_uv = None
        pictures = None
        material = None
        if textures == "bake":
            pictures = tuple(image for _, image in images)
            number = {label: number for number, (label, _) in enumerate(images)}
            if labels is not None:
                known = np.unique(labels)
                material = np.array([number.get(int(label), -1) for label in known])[np.searchsorted(known, labels)]
        elif labels is not None and self.material_type is not None:
            material = (labels if self.materials is None else self.materials[labels]).astype(self.material_type)
        if colors is not None and self.color_type is not None:
            colors = _of_type(colors, self.color_type)
        return Mesh(at, faces, uv, face_uv, material, colors, pictures, report)


def _split(
    at: NDArray[Any], faces: NDArray[Any], uv: NDArray[Any], face_uv: NDArray[Any], colors: NDArray[Any] | None
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any] | None]:
    """Splits vertices at seams, so that each has one texture coordinate."""
    pairs = faces.astype(np.int64).ravel() * len(uv) + face_uv.ravel()
    known, places = np.unique(pairs, return_inverse=True)
    vertex, texcoord = np.divmod(known, len(uv))
    split = places.reshape(faces.shape).astype(faces.dtype)
    return at[vertex], split, uv[texcoord], None if colors is None else colors[vertex]


def _of_type(colors: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """Colours as numbers of a kind, within its range."""
    if kind.kind == "f":
        return colors.astype(kind, copy=False)
    info = np.iinfo(kind)
    whole = np.rint(colors.astype(np.float64))
    within = np.where((whole > info.min) & (whole < info.max), whole, 0).astype(kind)
    return np.where(whole >= info.max, info.max, np.where(whole <= info.min, info.min, within)).astype(kind)


def _pixels(image: Any) -> NDArray[np.uint8]:
    """The colours of an image of numpy or PIL, and its alpha if it has some."""
    array_file.refuse_masked("texture", image)
    convert = getattr(image, "convert", None)
    mode = str(getattr(image, "mode", ""))
    if callable(convert) and mode.startswith(("I", "F")):
        raise InputError(f"texture: expected 8 bits a channel, found an image of mode {mode}")
    if callable(convert):
        has_alpha = mode.endswith(("A", "a")) or "transparency" in getattr(image, "info", {})
        image = convert("RGBA" if has_alpha else "RGB")
    pixels = np.asarray(image)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or pixels.dtype != np.uint8 or pixels.size == 0:
        raise InputError(f"texture: expected uint8 of shape (height, width, 3), found {pixels.dtype} of {pixels.shape}")
    return pixels
