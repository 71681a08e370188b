"""Calls on meshes in files, of any size."""

import json
import logging
import os
import warnings as _warnings
from collections.abc import Iterable, Sequence
from typing import Any, Literal, Unpack, overload

from drystone import _native
from drystone import errors
from drystone.errors import BoundBrokenError, TargetMissed, TargetMissedError
from drystone.hands import Hands, starter
from drystone.options import (
    FILE_KEYS,
    TILE_KEYS,
    FileOptions,
    PathLike,
    Resume,
    Size,
    TileOptions,
    flags,
    paths,
    refuse_unknown,
    texts,
)
from drystone.progress import Listener, Progress
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

logger = logging.getLogger("drystone")


def simplify(
    input: PathLike | Sequence[PathLike],
    output: PathLike,
    *,
    ratio: float | str | None = None,
    face_count: int | str | None = None,
    max_error: float | None = None,
    exclude: str | Sequence[str] = (),
    memory: Size | None = None,
    threads: int | None = None,
    work: PathLike | None = None,
    resume: Resume = "auto",
    keep_work: bool = False,
    no_sync: bool = False,
    task_runner: str | None = None,
    hands: Hands | None = None,
    tasks: int | None = None,
    task_tries: int | None = None,
    force: bool = False,
    report: PathLike | Sequence[PathLike] = (),
    measure: bool = False,
    samples: int | None = None,
    seed: int | None = None,
    strict: bool = False,
    progress: Progress = None,
    stop: _native.Stop | None = None,
    **options: Unpack[FileOptions],
) -> Report:
    """Simplifies meshes in files into one file, within a memory budget. The same call resumes a job that was stopped.

    `input` is an OBJ or a PLY, a folder of them, or several; `output` ends in .obj, .ply or .glb. Give `ratio` (the
    share of triangles to keep), `face_count`, `max_error` (the largest distance, in the mesh's unit), or a number of
    triangles and `max_error`. `report` names .json and .html files to write; `measure` compares the result with the
    input, at `samples` points. Everything else is as on the command line: `drystone simplify --help`.

    A missed target is a warning, `TargetMissed`; with `strict` an exception. Raises the exceptions of
    `drystone.errors`.
    """
    refuse_unknown("simplify", options, FILE_KEYS)
    given = dict(
        options,
        ratio=ratio,
        face_count=face_count,
        max_error=max_error,
        exclude=texts(exclude),
        memory=memory,
        threads=threads,
        work=_path(work),
        resume=resume,
        keep_work=keep_work,
        no_sync=no_sync,
        task_runner=task_runner,
        tasks=tasks,
        task_tries=task_tries,
        force=force,
        report=paths(report),
        measure=measure,
        samples=samples,
        seed=seed,
    )
    arguments = ["simplify", *_output(output), *flags(given), "--", *paths(input)]
    code, value = call(arguments, progress, stop, hands)
    found = Report.from_dict(value)
    judge(found, code, strict)
    return found


def tile(
    input: PathLike | Sequence[PathLike],
    output: PathLike,
    *,
    exclude: str | Sequence[str] = (),
    memory: Size | None = None,
    threads: int | None = None,
    work: PathLike | None = None,
    resume: Resume = "auto",
    keep_work: bool = False,
    no_sync: bool = False,
    task_runner: str | None = None,
    hands: Hands | None = None,
    tasks: int | None = None,
    task_tries: int | None = None,
    force: bool = False,
    progress: Progress = None,
    stop: _native.Stop | None = None,
    **options: Unpack[TileOptions],
) -> TileReport:
    """Makes a pyramid of tiles that a browser streams (3D Tiles 1.1) in the folder `output`.

    The same call resumes a job that was stopped. Options: `drystone tile --help`.
    """
    refuse_unknown("tile", options, TILE_KEYS)
    given = dict(
        options,
        exclude=texts(exclude),
        memory=memory,
        threads=threads,
        work=_path(work),
        resume=resume,
        keep_work=keep_work,
        no_sync=no_sync,
        task_runner=task_runner,
        tasks=tasks,
        task_tries=task_tries,
        force=force,
    )
    _, value = call(["tile", *_output(output), *flags(given), "--", *paths(input)], progress, stop, hands)
    _warn(value["warnings"])
    return TileReport.from_dict(value)


OF_PLAN = {"machines", "shared_bandwidth", "exclude", "memory", "threads", "work"}
TARGETS = {"ratio", "face_count", "max_error"}
# These make no difference to a plan: it takes them so that one dict of options serves both calls.
OF_RUN = {"resume", "keep_work", "no_sync", "task_runner", "hands", "tasks", "task_tries", "force"}
OF_RESULT = {"report", "measure", "samples", "seed", "strict"}
OF_TILES = {"tile_faces", "tile_side", "image", "compress", "textures_outside"}


@overload
def plan(
    input: PathLike | Sequence[PathLike],
    *,
    tile: Literal[False] = False,
    ratio: float | str | None = None,
    face_count: int | str | None = None,
    max_error: float | None = None,
    exclude: str | Sequence[str] = (),
    memory: Size | None = None,
    threads: int | None = None,
    work: PathLike | None = None,
    machines: int | None = None,
    shared_bandwidth: Size | None = None,
    resume: Resume = "auto",
    keep_work: bool = False,
    no_sync: bool = False,
    task_runner: str | None = None,
    hands: Hands | None = None,
    tasks: int | None = None,
    task_tries: int | None = None,
    force: bool = False,
    report: PathLike | Sequence[PathLike] = (),
    measure: bool = False,
    samples: int | None = None,
    seed: int | None = None,
    strict: bool = False,
    progress: Progress = None,
    stop: _native.Stop | None = None,
    **options: Unpack[FileOptions],
) -> Plan: ...
@overload
def plan(
    input: PathLike | Sequence[PathLike],
    *,
    tile: Literal[True],
    tile_faces: int | None = None,
    tile_side: int | None = None,
    image: str | None = None,
    compress: Literal["meshopt", "none"] | None = None,
    textures_outside: Literal["refer", "copy"] | None = None,
    exclude: str | Sequence[str] = (),
    memory: Size | None = None,
    threads: int | None = None,
    work: PathLike | None = None,
    machines: int | None = None,
    shared_bandwidth: Size | None = None,
    resume: Resume = "auto",
    keep_work: bool = False,
    no_sync: bool = False,
    task_runner: str | None = None,
    hands: Hands | None = None,
    tasks: int | None = None,
    task_tries: int | None = None,
    force: bool = False,
    progress: Progress = None,
    stop: _native.Stop | None = None,
) -> TilePlan: ...
def plan(
    input: PathLike | Sequence[PathLike],
    *,
    tile: bool = False,
    progress: Progress = None,
    stop: _native.Stop | None = None,
    **options: Any,
) -> Plan | TilePlan:
    """Predicts what `simplify`, or with `tile=True` what `tile`, takes: memory, scratch space, time.

    Reads the input once and writes nothing. Takes the options of `simplify`, also those that make no difference to a
    plan; with `tile=True`, those of `tile` that shape its levels.
    """
    of_kind = OF_TILES if tile else FILE_KEYS | TARGETS | OF_RESULT
    refuse_unknown("plan", options, of_kind | OF_PLAN | OF_RUN)
    given = {name: value for name, value in options.items() if name not in ("hands", "strict")}
    for name, read in {"exclude": texts, "work": _path, "report": paths}.items():
        if name in given:
            given[name] = read(given[name])
    arguments = ["plan", *(["--tile"] if tile else []), *flags(given), "--", *paths(input)]
    _, value = call(arguments, progress, stop, options.get("hands"))
    _warn(value["warnings"])
    return TilePlan.from_dict(value) if tile else Plan.from_dict(value)


def inspect(
    input: PathLike | Sequence[PathLike],
    *,
    exclude: str | Sequence[str] = (),
    memory: Size | None = None,
    threads: int | None = None,
    work: PathLike | None = None,
    progress: Progress = None,
    stop: _native.Stop | None = None,
) -> Inspection:
    """Counts what a mesh holds: bounds, materials, seams, borders, faults. Works within the memory."""
    given = {"exclude": texts(exclude), "memory": memory, "threads": threads, "work": _path(work)}
    _, value = call(["inspect", *flags(given), "--", *paths(input)], progress, stop)
    return Inspection.from_dict(value)


def check(
    mesh: PathLike,
    against: PathLike | None = None,
    *,
    progress: Progress = None,
    stop: _native.Stop | None = None,
) -> Check | TilesetCheck:
    """Counts cracks, topology faults and folded texture of a mesh, or the faults of a folder of tiles.

    With `against`, the mesh or the input that it was made from, `new` has the faults that are new; tiles are measured.
    Holds a mesh in memory.
    """
    _, value = call(["check", *flags({"against": _path(against)}), "--", *paths(mesh)], progress, stop)
    return TilesetCheck.from_dict(value) if "tiles" in value else Check.from_dict(value)


def compare(
    original: PathLike,
    result: PathLike,
    *,
    samples: int | None = None,
    seed: int | None = None,
    vertices: bool = False,
    texel: float | None = None,
    report: PathLike | Sequence[PathLike] = (),
    memory: Size | None = None,
    threads: int | None = None,
    work: PathLike | None = None,
    progress: Progress = None,
    stop: _native.Stop | None = None,
) -> Comparison:
    """Measures what a simplification changed: distances, colours, topology, shapes. Works within the memory.

    At `samples` points by area, or at the `vertices`; colours as texels of the length `texel` show them.
    """
    given = {
        "samples": samples,
        "seed": seed,
        "vertices": vertices,
        "texel": texel,
        "report": paths(report),
        "memory": memory,
        "threads": threads,
        "work": _path(work),
    }
    arguments = ["compare", *flags(given), "--", *paths(original), *paths(result)]
    _, value = call(arguments, progress, stop)
    _warn(value["warnings"])
    return Comparison.from_dict(value)


def status(work: PathLike) -> Status | Finished:
    """What the job in a work folder has done, also while it runs. `work` of `simplify_mesh` is one, too."""
    (folder,) = paths(work)
    of_arrays = os.path.join(folder, "job")
    if not os.path.exists(os.path.join(folder, "manifest.bin")) and os.path.isdir(of_arrays):
        folder = of_arrays
    _, value = call(["status", "--", folder], None, None)
    return Finished.from_dict(value) if "output" in value else Status.from_dict(value)


def _broken_bound(report: Report) -> str:
    message = f"`max_error: {report.options.max_error}` is broken"
    if report.comparison is None:
        return message
    geometry = report.comparison.geometry
    ways = [(geometry.forward, "from the result to the input"), (geometry.backward, "from the input to the result")]
    way, words = max(ways, key=lambda way: way[0].max)
    place = f", at {' '.join(map(str, way.worst[0].position))}" if way.worst else ""
    return f"{message}: the distance {words} is {way.max:.6g}{place}"


def judge(report: Report, code: int, strict: bool, mesh: Any = None) -> None:
    """Raises or warns of what a finished run missed, and logs its warnings; `mesh` is a result that is in no file."""
    _warn(report.warnings)
    if code == 1:
        raise BoundBrokenError(_broken_bound(report), report)
    if report.status == "target-missed":
        message = f"{report.faces.output:,} triangles are left; the target was {report.faces.target:,}"
        if strict:
            raise TargetMissedError(message, report, mesh)
        _warnings.warn(message, TargetMissed, stacklevel=3)


def _path(path: PathLike | None) -> str | None:
    return None if path is None else paths(path)[0]


def _output(path: PathLike) -> list[str]:
    return [f"--output={text}" for text in paths(path)]


def _warn(messages: Iterable[str]) -> None:
    for message in messages:
        logger.warning("%s", errors.with_keywords(message, True))


def call(
    arguments: list[str], progress: Progress, stop: _native.Stop | None, hands: Hands | None = None
) -> tuple[int, Any]:
    """Runs a command; returns its exit code and its JSON."""
    start = starter(hands)
    listener = Listener(progress)
    try:
        code, text = _native.call(arguments, listener, stop, start)
    finally:
        listener.close()
    return code, json.loads(text)
