"""Options of the calls, and the arguments of the command line that they become.

The words here are those of `drystone simplify --help`; `docs/reference/options.md` has each with its choices and limits.
"""

import numbers
import os
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any, Literal, TypeAlias, TypedDict

PathLike: TypeAlias = str | bytes | os.PathLike[str] | os.PathLike[bytes]
Size: TypeAlias = int | str
"""Bytes, or a text such as "1GiB"."""
Resume: TypeAlias = Literal["auto", "require", "never"]


class SimplifyOptions(TypedDict, total=False):
    """Options that shape the result of a simplification; those that are left out have the command line's defaults."""

    topology: Literal["simplify", "keep"]
    """Whether holes, handles and components may go."""
    borders: Literal["simplify", "lock"]
    """How to simplify open borders."""
    weld: Literal["exact", "off"]
    """Whether to merge vertices at the same position."""
    pieces: Literal["keep", "drop"]
    """What to do with connected components smaller than the error."""
    doubles: Literal["keep", "drop"]
    """What to do with copies and back sides of faces."""
    seams: Literal["stitch", "follow", "lock"]
    """How to simplify texture seams."""
    uv_weight: float
    """Weight of texture drift, 0 to 1000."""
    texels: float
    """With `textures="bake"`: texels, as a share of those that the input shows."""
    atlas: int
    """With `textures="bake"`: largest side of an image in texels, a power of two from 256 to 16384."""
    cluster_faces: int
    """Approximate triangles per cluster. Changes memory a lot and the result slightly."""
    passes: int
    """Passes over shifted clusters."""
    metric: Literal["qem", "qem-attributes", "qem-1997", "oblique", "curvature", "terrain", "sharpness"]
    """Cost of a collapse."""
    metric_options: Mapping[str, float | str]
    """Parameters of the metric, such as `{"border": 2.0}`."""
    remesh: str
    """Remesh first, such as "cvd" or "cvd:cells=5000"."""
    optimize: bool
    """Afterwards, move the vertices of slivers to the middle of their neighbours."""
    one_by_one: bool
    """Collapse one edge at a time, always the cheapest."""


class FileOptions(SimplifyOptions, total=False):
    """Options of a simplification from files to a file."""

    normals: Literal["auto", "drop"]
    """How to write normals."""
    up: Literal["z", "y"]
    """Which axis points up, for a GLB."""
    textures: Literal["copy", "link", "reference", "bake"]
    """How to write texture images."""
    textures_outside: Literal["refer", "copy"]
    """What to do with images that an MTL names outside its own folder."""
    image: str
    """With `textures="bake"`: format of the images: "png", "jpeg" or "jpeg:QUALITY"."""


class TileOptions(TypedDict, total=False):
    """Options that shape a pyramid of tiles."""

    tile_faces: int
    """Triangles of a tile at most."""
    tile_side: int
    """Largest side of a tile's image in texels, a power of two from 256 to 4096."""
    image: str
    """Format of the images: "jpeg", "png", or "webp" and "ktx2" if they are built in; ":QUALITY" may follow."""
    compress: Literal["meshopt", "none"]
    """How vertices and triangles are stored."""
    error_factor: float
    """Geometric error of a tile, as a multiple of the larger of its texel and its deviation."""
    up: Literal["z", "y"]
    """Which axis of the input points up."""
    origin: Sequence[float]
    """Longitude, latitude, height of the input's (0, 0, 0)."""
    crs: str
    """Coordinate reference system of the input, such as "EPSG:32650"."""
    offset: Sequence[float]
    """Added to the coordinates of the input before `crs` is applied."""
    textures_outside: Literal["refer", "copy"]
    """What to do with images that an MTL names outside its own folder."""


SIMPLIFY_KEYS = frozenset(SimplifyOptions.__annotations__)
FILE_KEYS = frozenset(FileOptions.__annotations__)
TILE_KEYS = frozenset(TileOptions.__annotations__)

_FLAGS = {"face_count": "faces", "metric_options": "metric-option"}
_JOINED = ("origin", "offset")
_SWITCHES = frozenset(["force", "keep_work", "measure", "no_sync", "one_by_one", "optimize", "vertices"])


def refuse_unknown(call: str, options: Mapping[str, Any], known: Set[str]) -> None:
    """Raises what Python raises for a keyword that a function does not have."""
    for name in options:
        if name not in known:
            raise TypeError(f"{call}() got an unexpected keyword argument {name!r}")


def flags(options: Mapping[str, Any]) -> Iterator[str]:
    """Arguments of the command line for options by keyword; None, and a switch that is off, are left out."""
    for name, value in options.items():
        flag = "--" + _FLAGS.get(name, name).replace("_", "-")
        if value is None:
            continue
        if name in _SWITCHES:
            if value:
                yield flag
        elif name in _JOINED and not isinstance(value, str):
            yield f"{flag}={','.join(_text(name, part) for part in value)}"
        elif isinstance(value, Mapping):
            yield from (f"{flag}={key}={_text(name, part)}" for key, part in value.items())
        elif isinstance(value, (list, tuple)):
            yield from (f"{flag}={_text(name, part)}" for part in value)
        else:
            yield f"{flag}={_text(name, value)}"


def paths(value: PathLike | Sequence[PathLike]) -> list[str]:
    """One path or several as text, absolute: a job goes on where it began if the current folder changes.

    `..` stays: after a link, it leads elsewhere than the text says.
    """
    return [os.path.join(os.getcwd(), path) for path in texts(value)]


def texts(value: PathLike | Sequence[PathLike]) -> list[str]:
    """One text or several."""
    if isinstance(value, (str, bytes, os.PathLike)):
        return [os.fsdecode(value)]
    return [os.fsdecode(text) for text in value]


def _text(name: str, value: Any) -> str:
    """A value as the command line takes it; whole numbers may be floats."""
    if isinstance(value, bool):
        raise TypeError(f"{name}: expected a number or a text, found {value}")
    if isinstance(value, numbers.Integral):
        return str(int(value))
    if isinstance(value, numbers.Real):
        number = float(value)
        return str(int(number)) if number.is_integer() and abs(number) < 2**53 else repr(number)
    if isinstance(value, (str, bytes, os.PathLike)):
        return os.fsdecode(value)
    raise TypeError(f"{name}: expected a number, a text or a path, found {type(value).__name__}")
