"""The files of a job on arrays: the input, the job's own folder, the result.

```
FOLDER/input-HASH.drystone      the arrays; HASH is that of their content
FOLDER/image-HASH.png           each texture
FOLDER/job/                     the work folder
FOLDER/result-HASH.drystone     and the baked images beside it
FOLDER/….HOST.PROCESS.partial   what that process of that machine writes
```
Names follow from contents, so that two calls in one folder never write the same file with different contents: the second
finds the work folder locked, or made for other arrays.
"""

import errno
import hashlib
import os
import re
import shutil
import socket
import sys
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from drystone import _native, array_file, errors
from drystone.array_file import ArrayMesh
from drystone.options import PathLike, paths

_MADE = "made-by-drystone"
_ARRAYS = {"vertex": "vertices", "texture coordinate": "uv", "face": "faces"}


class ArrayJob:
    """A job in a temporary folder, which goes whatever happens, or in the user's, which keeps what can be resumed."""

    def __init__(self, work: PathLike | None) -> None:
        self._is_temporary = work is None
        self._process = os.getpid()
        self._written: list[str] = []
        with _as_errors():
            if work is None:
                self._folder = tempfile.mkdtemp(prefix="drystone-")
                return
            (self._folder,) = paths(work)
            _make_folder(self._folder)
            self._remove_stale()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None) -> None:
        # A child that was forked leaves the files to the process that began.
        if os.getpid() != self._process:
            return
        if self._is_temporary:
            shutil.rmtree(self._folder, ignore_errors=True)
        elif kind in (None, errors.ChangedError) or not os.path.exists(self.path("job")):
            self._remove_written()

    def path(self, name: str) -> str:
        """Path of a file of the job."""
        return os.path.join(self._folder, name)

    def write(self, mesh: ArrayMesh, images: list[tuple[int, NDArray[np.uint8]]]) -> str:
        """Writes the input; returns its path."""
        with _as_errors():
            names = []
            for label, pixels in images:
                with self._named("image-", ".png") as file:
                    _write_png(file, pixels)
                names.append((label, os.path.basename(self._written[-1])))
            with self._named("input-", ".drystone") as file:
                mesh.write(file, names)
            return self._written[-1]

    def read(self, result: str) -> tuple[ArrayMesh, list[tuple[int, NDArray[np.uint8]]]]:
        """The result, and the label and pixels of each of its images."""
        with _as_errors(result):
            mesh, images = array_file.read(result)
            self._written += [result, *(self.path(name) for _, name in images)]
            return mesh, [(label, _read_image(self.path(name))) for label, name in images]

    def of_arrays(self, words: str) -> str:
        """A message of the native half, with the caller's arrays in place of the job's files."""
        file = re.escape(self.path("input-")) + r"[0-9a-f]+\.drystone"
        words = re.sub(f"an input was {file}, is {file}", "the arrays were others", words)
        words = re.sub(f"{file}: ({'|'.join(_ARRAYS)}) ([0-9]+)", lambda row: f"{_ARRAYS[row[1]]}[{row[2]}]", words)
        return re.sub(file, "the mesh", words)

    @contextmanager
    def _named(self, prefix: str, suffix: str) -> Iterator["_HashedFile"]:
        """A new file that is named for its content once it is complete."""
        descriptor, partial = tempfile.mkstemp(f".{_host()}.{os.getpid()}.partial", prefix, self._folder)
        try:
            with _as_errors(partial), open(descriptor, "wb") as file:
                hashed = _HashedFile(file)
                yield hashed
            name = self.path(f"{prefix}{hashed.hash.hexdigest()}{suffix}")
            os.replace(partial, name)
        except BaseException:
            os.unlink(partial)
            raise
        self._written.append(name)

    def _remove_stale(self) -> None:
        """Removes what a process of this machine that was killed left half written."""
        of_host = re.compile(rf"(?:input|image)-\w+\.{re.escape(_host())}\.([0-9]+)\.partial")
        for name in os.listdir(self._folder):
            partial = of_host.fullmatch(name)
            if partial and not _is_alive(int(partial[1])):
                os.unlink(self.path(name))

    def _remove_written(self) -> None:
        """Removes the files of the job, and the folders that it made and that are empty then."""
        folders = {os.path.dirname(name) for name in self._written} - {self._folder}
        for name in self._written:
            if os.path.lexists(name):
                os.unlink(name)
        for folder in sorted(folders, key=len, reverse=True):
            _remove_if_empty(folder)
        if os.listdir(self._folder) == [_MADE]:
            os.unlink(self.path(_MADE))
            _remove_if_empty(self._folder)


class _HashedFile:
    """A file, and the hash of what was written to it."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self.hash = hashlib.blake2b(digest_size=16)

    def write(self, data: Any) -> None:
        self.hash.update(data)
        self._file.write(data)


@contextmanager
def _as_errors(path: str | None = None) -> Iterator[None]:
    """Raises an OSError as the exception of drystone that fits; one of a write names no file, which is `path` then."""
    try:
        yield
    except errors.DrystoneError:
        raise
    except OSError as error:
        kind = "no_space" if error.errno in (errno.ENOSPC, getattr(errno, "EDQUOT", None)) else "io"
        name = path if error.filename is None else os.fsdecode(error.filename)
        place = "" if name is None else f"{name}: "
        raise errors.from_native(kind, f"{place}{error.strerror or error}", name, error.errno) from error


def _make_folder(folder: str) -> None:
    """Makes a folder, with a mark that it is no one else's, unless it is there."""
    try:
        os.makedirs(folder)
    except FileExistsError:
        if os.path.isdir(folder):
            return
        raise
    open(os.path.join(folder, _MADE), "w").close()


def _host() -> str:
    """Name of this machine, as a part of a file's name without dots."""
    return re.sub("[^0-9A-Za-z-]", "-", socket.gethostname())


def _is_alive(process: int) -> bool:
    """Whether a process of this machine runs, or may run."""
    if sys.platform == "win32":
        return _is_alive_on_windows(process)
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _is_alive_on_windows(process: int) -> bool:
    """As `_is_alive`. There, `os.kill` with 0 sends Ctrl-C."""
    import ctypes

    query, still_active, invalid_parameter = 0x1000, 259, 87
    windows: Any = ctypes
    kernel = windows.WinDLL("kernel32", use_last_error=True)
    kernel.OpenProcess.restype = ctypes.c_void_p
    handle = kernel.OpenProcess(query, False, ctypes.c_uint32(process))
    if not handle:
        # No process has this number; one that may not be looked at has another error.
        return bool(windows.get_last_error() != invalid_parameter)
    try:
        code = ctypes.c_uint32()
        has_code = kernel.GetExitCodeProcess(ctypes.c_void_p(handle), ctypes.byref(code))
        return not has_code or code.value == still_active
    finally:
        kernel.CloseHandle(ctypes.c_void_p(handle))


def _remove_if_empty(folder: str) -> None:
    try:
        os.rmdir(folder)
    except OSError:
        pass


def _read_image(path: str) -> NDArray[np.uint8]:
    with _as_errors(path):
        height, width, pixels = _native.decode_image(path)
    return np.frombuffer(pixels, dtype=np.uint8).reshape(height, width, 3)


def _write_png(file: _HashedFile, pixels: NDArray[np.uint8]) -> None:
    """Writes a PNG of little compression."""
    height, width, _ = pixels.shape

    def chunk(kind: bytes, content: bytes) -> None:
        check = zlib.crc32(content, zlib.crc32(kind))
        file.write(len(content).to_bytes(4, "big") + kind + content + check.to_bytes(4, "big"))

    file.write(b"\x89PNG\r\n\x1a\n")
    chunk(b"IHDR", width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 2, 0, 0, 0]))
    packer = zlib.compressobj(1)
    rows = max(1, (1 << 20) // (3 * width))
    for start in range(0, height, rows):
        block = pixels[start : start + rows]
        lines = np.zeros((len(block), 1 + 3 * width), dtype=np.uint8)
        lines[:, 1:] = block.reshape(len(block), -1)
        if packed := packer.compress(lines.tobytes()):
            chunk(b"IDAT", packed)
    chunk(b"IDAT", packer.flush())
    chunk(b"IEND", b"")
