"""Who has tasks of a job done: a function of the caller."""

import threading
from collections.abc import Callable
from typing import TypeAlias

from drystone._native import StageTasks

Hands: TypeAlias = Callable[[str, int, Callable[[], bool]], object]
"""Called once for each stage of a job, in a thread of its own, with the path of the stage's file, the number of its
tasks and a function that says whether the job is to stop.

It has `drystone task STAGE INDEX` run for each index from 0, on any machine, and returns once all tasks have ended; it
may return a list of those that failed. If it raises, the job stops, and the exception comes out. `drystone.dask.Runner` is one."""


def starter(hands: Hands | None) -> Callable[[StageTasks], None] | None:
    """What the native half calls with the tasks of a stage."""
    if hands is None:
        return None
    if not callable(hands):
        raise TypeError(f"hands: expected a function, found {type(hands).__name__}")

    def work(tasks: StageTasks) -> None:
        try:
            failed = hands(str(tasks.stage), tasks.count, tasks.is_stopped)
        except BaseException as error:
            tasks.end(False, error)
        else:
            tasks.end(not failed)

    def start(tasks: StageTasks) -> None:
        threading.Thread(target=work, args=(tasks,), name="drystone hands", daemon=True).start()

    return start
