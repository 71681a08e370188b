"""Array files: meshes as arrays of fixed records, between numpy and the native half.

`docs/reference/input.md` has the layout. Arrays are converted and written in blocks, so that no whole copy of them is
made.
"""

import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drystone.errors import InputError

_MAGIC = b"drystone"
_FIXED = struct.Struct("<8s8Q")
_ROWS = 1 << 18
_NONE = 0xFFFFFFFF
_CORNERS_MAX = 512
_COORDINATE_MAX = float(np.finfo(np.float32).max)


class Writer(Protocol):
    """What takes bytes, as a file does."""

    def write(self, data: Any, /) -> object: ...


@dataclass(frozen=True)
class ArrayMesh:
    """A mesh as arrays: checked shapes, values as the caller gave them.

    `vertices` (n, 3); `faces` (m, k), -1 behind polygons of fewer corners; `uv` (j, 2) and `face_uv` (m, k), -1 for
    none; `labels` (m,) of 32-bit numbers; `colors` (n, 3). All but the first two may be None.
    """

    vertices: NDArray[Any]
    faces: NDArray[Any]
    uv: NDArray[Any] | None = None
    face_uv: NDArray[Any] | None = None
    labels: NDArray[Any] | None = None
    colors: NDArray[Any] | None = None

    def write(self, file: Writer, images: Sequence[tuple[int, str]] = ()) -> None:
        """Writes an array file; `images` are labels and names of files. Checks every number on the way.

        Raises InputError with the row at fault.
        """
        # What is too large becomes infinite, and is refused then.
        with np.errstate(all="ignore"):
            file.write(self._header(images))
            self._write_vertices(file)
            if self.uv is not None:
                for start, block in _blocks(self.uv):
                    values = np.asarray(block, dtype="<f8")
                    _refuse_rows("uv", start, _is_bad(values), "expected numbers between -3.4e38 and 3.4e38")
                    file.write(np.ascontiguousarray(values).data)
            self._write_faces(file)

    def _header(self, images: Sequence[tuple[int, str]]) -> bytes:
        text = b"".join(b"%d %s\n" % (label, os.fsencode(name)) for label, name in images)
        flags = (self.colors is not None) + 2 * (self.uv is not None) + 4 * (self.labels is not None)
        texcoords = 0 if self.uv is None else len(self.uv)
        counts = (len(self.vertices), texcoords, len(self.faces), flags, self.faces.shape[1], len(images), len(text))
        header = _FIXED.pack(_MAGIC, 1, *counts) + text
        return header + bytes(-len(header) % 8)

    def _write_vertices(self, file: Writer) -> None:
        colors = self.colors
        for start, block in _blocks(self.vertices):
            values = np.asarray(block, dtype="<f8")
            _refuse_rows("vertices", start, _is_bad(values), "expected numbers between -3.4e38 and 3.4e38")
            if colors is None:
                file.write(np.ascontiguousarray(values).data)
                continue
            records = np.empty(len(values), dtype=[("at", "<f8", 3), ("color", "<f4", 3)])
            records["at"] = values
            records["color"] = colors[start : start + len(values)]
            _refuse_rows("vertex_colors", start, ~np.isfinite(records["color"]), "expected finite numbers")
            file.write(records.data)

    def _write_faces(self, file: Writer) -> None:
        corners = self.faces.shape[1]
        for start, block in _blocks(self.faces):
            labelled, textured = self.labels is not None, self.face_uv is not None
            words = np.empty((len(block), corners * (1 + textured) + labelled), dtype="<u4")
            counts = _check_faces(block, start, len(self.vertices))
            words[:, :corners] = np.where(_behind(counts, corners), _NONE, block)
            if self.face_uv is not None and self.uv is not None:
                ids = self.face_uv[start : start + len(block)]
                words[:, corners : 2 * corners] = _checked_uv(ids, start, counts, len(self.uv))
            if self.labels is not None:
                words[:, -1] = self.labels[start : start + len(block)]
            file.write(words.data)


def _checked_uv(ids: NDArray[Any], start: int, counts: NDArray[Any] | None, limit: int) -> NDArray[Any]:
    is_none = ids == -1
    if counts is not None:
        is_none = is_none | _behind(counts, ids.shape[1])
    bad = ((ids < 0) | (ids >= limit)) & ~is_none
    _refuse_ids("face_uv", start, ids, bad, f"there are {limit:,} uv")
    return np.asarray(np.where(is_none, _NONE, ids))


def _check_faces(block: NDArray[Any], start: int, limit: int) -> NDArray[Any] | None:
    """Corners of each face; None if all have as many as there are columns."""
    bad = (block < 0) | (block >= limit)
    if not bad.any():
        return None
    is_end = block == -1
    counts = np.where(is_end.any(axis=1), is_end.argmax(axis=1), block.shape[1])
    behind = _behind(counts, block.shape[1])
    _refuse_rows("faces", start, behind & (block != -1), "expected nothing but -1 behind the first -1")
    bad &= ~behind
    _refuse_ids("faces", start, block, bad, f"there are {limit:,} vertices")
    _refuse_rows("faces", start, np.less(counts, 3)[:, None], "expected at least 3 vertices before the first -1")
    return np.asarray(counts)


def _behind(counts: NDArray[Any] | None, corners: int) -> Any:
    """Places behind the last corner of each face."""
    return False if counts is None else np.arange(corners) >= counts[:, None]


def _blocks(array: NDArray[Any]) -> Iterator[tuple[int, NDArray[Any]]]:
    for start in range(0, len(array), _ROWS):
        yield start, array[start : start + _ROWS]


def _is_bad(values: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(~(np.abs(values) <= _COORDINATE_MAX))


def _refuse_rows(name: str, start: int, bad: NDArray[Any], words: str) -> None:
    if bad.any():
        row = start + int(bad.any(axis=1).argmax())
        raise InputError(f"{name}[{row}]: {words}", row=row)


def _refuse_ids(name: str, start: int, ids: NDArray[Any], bad: NDArray[Any], words: str) -> None:
    if bad.any():
        row, column = np.unravel_index(int(bad.argmax()), bad.shape)
        raise InputError(f"{name}[{start + row}]: refers to {int(ids[row, column])}; {words}", row=start + int(row))


def read(path: str) -> tuple[ArrayMesh, list[tuple[int, str]]]:
    """The mesh of an array file of triangles, and the labels and names of its images."""
    with open(path, "rb") as file:
        _, _, vertices, texcoords, faces, flags, corners, _, text_bytes = _FIXED.unpack(file.read(_FIXED.size))
        text = file.read(text_bytes)
        file.seek(-(_FIXED.size + text_bytes) % 8, os.SEEK_CUR)
        images = [line.partition(b" ") for line in text.split(b"\n") if line]
        colors = None
        if flags & 1:
            records = np.fromfile(file, dtype=[("at", "<f8", 3), ("color", "<f4", 3)], count=vertices)
            at, colors = np.ascontiguousarray(records["at"]), np.ascontiguousarray(records["color"])
        else:
            at = np.fromfile(file, dtype="<f8", count=3 * vertices).reshape(-1, 3)
        uv = np.fromfile(file, dtype="<f8", count=2 * texcoords).reshape(-1, 2) if flags & 2 else None
        words = corners * (1 + bool(flags & 2)) + bool(flags & 4)
        records = np.fromfile(file, dtype="<u4", count=words * faces).reshape(-1, words)
    face_uv = _ids(records[:, corners : 2 * corners], texcoords) if flags & 2 else None
    labels = np.ascontiguousarray(records[:, -1]) if flags & 4 else None
    mesh = ArrayMesh(at, _ids(records[:, :corners], vertices), uv, face_uv, labels, colors)
    return mesh, [(int(label), os.fsdecode(name)) for label, _, name in images]


def _ids(words: NDArray[Any], limit: int) -> NDArray[Any]:
    """Indices as 32-bit numbers, or 64-bit ones if there are too many; -1 for none."""
    if limit <= 2**31:
        return np.ascontiguousarray(words).view(np.int32)
    ids = words.astype(np.int64)
    ids[ids == _NONE] = -1
    return ids


def refuse_masked(name: str, values: Any) -> None:
    """Raises InputError for an array of which some numbers are masked: they would be used as they are."""
    if np.ma.isMaskedArray(values) and np.ma.is_masked(values):
        raise InputError(f"{name}: some of its numbers are masked")


def checked(name: str, values: Any, columns: int | None, kinds: str) -> NDArray[Any]:
    """An array of rows of `columns` numbers (None: at least 3), or of single ones if `columns` is 0."""
    refuse_masked(name, values)
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name}: {error}") from error
    shape = {0: "(n,)", None: "(n, 3) or more columns"}.get(columns, f"(n, {columns})")
    fits = array.ndim == 1 if columns == 0 else array.ndim == 2 and (columns or max(array.shape[-1], 3)) == array.shape[1]
    if array.size == 0 and array.ndim < 2 and columns != 0:
        array, fits = array.reshape(0, columns or 3), True
    if not fits:
        raise InputError(f"{name}: expected an array of shape {shape}, found {array.shape}")
    if columns is None and array.shape[1] > _CORNERS_MAX:
        raise InputError(f"{name}: expected at most {_CORNERS_MAX} columns, found {array.shape[1]}")
    if array.size > 0 and array.dtype.kind not in kinds:
        expected = "integers" if "f" not in kinds else "numbers"
        raise InputError(f"{name}: expected {expected}, found {array.dtype}")
    return array
