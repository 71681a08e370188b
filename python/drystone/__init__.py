"""Simplifies textured triangle meshes larger than memory.

>>> import drystone
>>> report = drystone.simplify("city.obj", "out/city.obj", ratio=0.1)   # doctest: +SKIP
>>> report.faces.output                                                 # doctest: +SKIP
169112

Meshes in files, of any size: `simplify`, `tile`, `plan`, `inspect`, `check`, `compare`, `status`; the options are those
of the command line. Meshes in numpy arrays: `simplify_mesh`. Errors: `drystone.errors`.
"""

import logging
from typing import TYPE_CHECKING, Any

from drystone import errors
from drystone._native import BUILD as build
from drystone._native import VERSION as __version__
from drystone._native import Stop
from drystone.errors import (
    BoundBrokenError,
    BudgetError,
    ChangedError,
    DamagedError,
    DrystoneError,
    InputError,
    IoError,
    LimitError,
    LockedError,
    MissingInputError,
    NoSpaceError,
    StoppedError,
    TargetMissed,
    TargetMissedError,
    TaskError,
    UsageError,
)
from drystone.files import check, compare, inspect, plan, simplify, status, tile
from drystone.progress import Event
from drystone.report import (
    Check,
    Comparison,
    Finished,
    Inspection,
    Plan,
    Report,
    Status,
    TilePlan,
    TileReport,
    TilesetCheck,
)

if TYPE_CHECKING:
    from drystone.arrays import Mesh, simplify_mesh

__all__ = [
    "BoundBrokenError",
    "BudgetError",
    "ChangedError",
    "Check",
    "Comparison",
    "DamagedError",
    "DrystoneError",
    "Event",
    "Finished",
    "InputError",
    "Inspection",
    "IoError",
    "LimitError",
    "LockedError",
    "Mesh",
    "MissingInputError",
    "NoSpaceError",
    "Plan",
    "Report",
    "Status",
    "Stop",
    "StoppedError",
    "TargetMissed",
    "TargetMissedError",
    "TaskError",
    "TilePlan",
    "TileReport",
    "TilesetCheck",
    "UsageError",
    "__version__",
    "build",
    "check",
    "compare",
    "errors",
    "inspect",
    "plan",
    "simplify",
    "simplify_mesh",
    "status",
    "tile",
]

# A program that sets up no logging sees none.
logging.getLogger("drystone").addHandler(logging.NullHandler())


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    """Imports what needs numpy when it is asked for: the command, and calls on files, do without."""
    if name in ("Mesh", "simplify_mesh"):
        from drystone import arrays

        return getattr(arrays, name)
    raise AttributeError(f"module 'drystone' has no attribute {name!r}")
