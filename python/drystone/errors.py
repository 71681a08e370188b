"""Exceptions: each class of the command line's exit codes, which is also the builtin exception that fits."""

import errno as _errno
import os
import re
from typing import Any

from drystone.report import Report


class DrystoneError(Exception):
    """Any error of drystone. `exit_code` is the code that the command line ends with."""

    exit_code: int = 1

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class UsageError(DrystoneError, ValueError):
    """An option is not possible, or does not fit another one."""

    exit_code = 2


class BudgetError(UsageError):
    """The memory is too small for the job; `needed` bytes would do, None if that is not known."""

    def __init__(self, message: str, needed: int | None = None) -> None:
        super().__init__(message, needed)
        self.needed = needed


class InputError(DrystoneError, ValueError):
    """The input is no valid mesh.

    `path` and `line` name the place in a file (`line` is None where there is none). For arrays, `row` is the row at
    fault.
    """

    exit_code = 4

    def __init__(self, message: str, path: str | None = None, line: int | None = None, row: int | None = None) -> None:
        super().__init__(message, path, line, row)
        self.path = path
        self.line = line
        self.row = row


class MissingInputError(InputError, FileNotFoundError):
    """The input `path` does not exist."""

    def __new__(cls, message: str = "", path: str | None = None, *_: int | None) -> "MissingInputError":
        return OSError.__new__(cls, _errno.ENOENT, message, path)

    def __init__(self, message: str = "", path: str | None = None, line: int | None = None, row: int | None = None):
        self.path, self.line, self.row = path, line, row

    def __str__(self) -> str:
        return str(self.strerror)

    def __reduce__(self) -> tuple[Any, ...]:
        return (MissingInputError, (self.strerror, self.path, self.line, self.row))


class ChangedError(DrystoneError):
    """The input or the options differ from those of the unfinished job."""

    exit_code = 5


class DamagedError(DrystoneError):
    """The file `path` of the work folder is not as it was written."""

    exit_code = 8

    def __init__(self, message: str, path: str | None = None) -> None:
        super().__init__(message, path)
        self.path = path


class LimitError(DrystoneError, OverflowError):
    """The mesh has more vertices or faces than drystone can number, or a GLB would be larger than its format allows."""


class TargetMissed(UserWarning):
    """The result has more triangles than asked for; the report's `floor` says what holds them."""


class TargetMissedError(DrystoneError):
    """As `TargetMissed`, with `strict=True`; `report` has the figures of the result.

    The result is written, or, of `simplify_mesh`, it is `mesh`.
    """

    exit_code = 3

    def __init__(self, message: str, report: Report | None = None, mesh: Any = None) -> None:
        super().__init__(message, report, mesh)
        self.report = report
        self.mesh = mesh


class BoundBrokenError(DrystoneError):
    """`measure=True` found a distance above `max_error`. The result is written; `report` has its figures."""

    def __init__(self, message: str, report: Report | None = None) -> None:
        super().__init__(message, report)
        self.report = report


class StoppedError(DrystoneError):
    """A `Stop` stopped the call. One that has a work folder goes on when it is called again."""

    exit_code = 130


class TaskError(DrystoneError):
    """The task `task`, which others were to do, has no result after all tries.

    `exit_code` is that of the task runner if it failed, else 1. The command line exits with 1 in both cases.
    """

    def __init__(self, message: str, task: int | None = None, exit_code: int = 1) -> None:
        super().__init__(message, task, exit_code)
        self.task = task
        self.exit_code = exit_code


class IoError(DrystoneError, OSError):
    """A file could not be read or written; `errno` and `filename` are those of OSError.

    Also a FileNotFoundError, a PermissionError or another subclass of OSError, where one fits `errno`.
    """

    def __new__(cls, message: str = "", number: int | None = None, path: str | None = None) -> "IoError":
        kind = _io_class(number) if cls is IoError else cls
        return OSError.__new__(kind, number, message, path)

    def __init__(self, message: str = "", number: int | None = None, path: str | None = None) -> None:
        """The attributes were set by `__new__`, as OSError does."""

    def __str__(self) -> str:
        return str(self.strerror)

    def __reduce__(self) -> tuple[Any, ...]:
        kind = IoError if type(self).__name__ not in globals() else type(self)
        return (kind, (self.strerror, self.errno, self.filename))


class NoSpaceError(IoError):
    """A disk is full, or has too little space to begin. `errno` is ENOSPC."""

    exit_code = 7


class LockedError(IoError, BlockingIOError):
    """Another process works in the work folder `path`."""

    exit_code = 6

    @property
    def path(self) -> str | None:
        """The work folder."""
        return None if self.filename is None else str(self.filename)


_io_classes: dict[type[OSError], type[IoError]] = {}


def _io_class(number: int | None) -> type[IoError]:
    """IoError, or the subclass of it and of the builtin exception of an error number."""
    builtin = OSError if number is None else type(OSError(number, ""))
    if builtin is OSError:
        return IoError
    if builtin not in _io_classes:
        _io_classes[builtin] = type(f"Io{builtin.__name__}", (IoError, builtin), {"__module__": __name__})
    return _io_classes[builtin]


def from_native(
    kind: str, message: str, path: bytes | str | None, number: int | None, exit_code: int | None = None
) -> DrystoneError:
    """The exception for an error of the native half.

    `number` is a line, an error number, bytes, or a task; `exit_code` that of a task runner.
    """
    message = with_keywords(message, kind in ("usage", "budget"))
    there = None if path is None else os.fsdecode(path)
    match kind:
        case "usage":
            return UsageError(message)
        case "budget":
            return BudgetError(message, number)
        case "input":
            kind_of_input = InputError if there is None or os.path.exists(there) else MissingInputError
            return kind_of_input(message, there, number)
        case "io":
            return IoError(message, number, there)
        case "no_space":
            return NoSpaceError(message, _errno.ENOSPC, there)
        case "changed":
            return ChangedError(message)
        case "locked":
            return LockedError(message, _errno.EWOULDBLOCK, there)
        case "damaged":
            return DamagedError(message, there)
        case "limit":
            return LimitError(message)
        case "task":
            return TaskError(message, number, exit_code or 1)
        case "stopped":
            return StoppedError("stopped")
        case "forked":
            return DrystoneError("this process was forked while a job ran, which goes on in the other one alone")
        case "internal":
            words = "internal error, please report it; the work folder stays, and the same call resumes"
            error = DrystoneError(f"{words}: {message}")
            error.exit_code = 101
            return error
        case _:
            return DrystoneError(message)


def with_keywords(message: str, is_of_arguments: bool) -> str:
    """Spells options as keywords: `'--max-error <LENGTH>'` and `--max-error` become `` `max_error` ``."""

    def keyword(match: re.Match[str]) -> str:
        name = match[1].replace("-", "_")
        return f"`{_KEYWORDS.get(name, name)}`"

    if is_of_arguments:
        # Paths may have dashes, too; what the command line quotes or sets apart is an option.
        message = re.sub(r"'--([a-z][a-z-]*)(?: <[^>]*>)?'", keyword, message)
        message = re.sub(r"(?:^|(?<= ))--(?!features\b|release\b)([a-z][a-z-]*)(?=[ :,.;]|$)", keyword, message)
    return re.sub(r"`(faces|metric_option)(?=[`:])", lambda match: f"`{_KEYWORDS[match[1]]}", message)


_KEYWORDS = {"faces": "face_count", "metric_option": "metric_options"}
