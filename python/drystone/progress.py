"""Progress of a job: to a bar of tqdm, to lines on stderr, or to a function."""

import importlib
import logging
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

logger = logging.getLogger("drystone")

_SECONDS_BETWEEN_LINES = 1.0


@dataclass(frozen=True)
class Event:
    """What a job does.

    `done` of `total` units of a phase; `total` is 0 where it is unknown. A `message` tells something beside that, such
    as what is resumed.
    """

    phase: str
    done: int
    total: int
    unit: str
    message: str | None = None


class Tqdm(Protocol):
    """A class that makes bars, as `tqdm.tqdm` does."""

    def __call__(self, *, total: int | None, desc: str, unit: str, unit_scale: bool) -> Any: ...


Progress: TypeAlias = bool | Callable[[Event], object] | Tqdm | None
"""None or False: silent. True: a bar of tqdm if it is installed, else lines on stderr if that is a terminal. A class
such as `tqdm.notebook.tqdm`: a bar for each phase. A function: called with each `Event`, in the thread that called
drystone, at the beginning and end of each phase and at most ten times a second between. If it raises, the job stops,
and the exception comes out."""


class Listener:
    """Hands the events of the native half to what `progress` names, and its messages to the log."""

    def __init__(self, progress: Progress) -> None:
        self._shown: Callable[[Event], object] | None = None
        self._bars: _Bars | None = None
        if progress is True:
            # A program without console has no stderr.
            progress = (_tqdm_class() or _lines_if_terminal()) if sys.stderr is not None else None
        if isinstance(progress, type):
            self._bars = _Bars(progress)
            self._shown = self._bars.show
        elif callable(progress):
            self._shown = progress  # type: ignore[assignment]
        elif progress is not None and progress is not False:
            raise TypeError(f"progress: expected a bool, a class or a function, found {type(progress).__name__}")

    def __call__(self, phase: str, done: int, total: int, unit: str, message: str | None) -> None:
        if message is not None:
            logger.info("%s", message)
        if self._shown is not None:
            self._shown(Event(phase, done, total, unit, message))

    def close(self) -> None:
        """Ends the last bar."""
        if self._bars is not None:
            self._bars.close()


class _Bars:
    """A bar for each phase."""

    def __init__(self, make: type) -> None:
        self._make: Callable[..., Any] = make
        self._bar: Any = None
        self._phase = ""

    def show(self, event: Event) -> None:
        if event.message is not None:
            return
        if self._bar is None or event.phase != self._phase or event.done < self._bar.n:
            self.close()
            self._phase = event.phase
            self._bar = self._make(total=event.total or None, desc=event.phase, unit=event.unit, unit_scale=True)
        self._bar.update(event.done - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def _tqdm_class() -> Any:
    try:
        return importlib.import_module("tqdm.auto").tqdm
    except ImportError:
        return None


def _lines_if_terminal() -> Callable[[Event], object] | None:
    if sys.stderr is None or not sys.stderr.isatty():
        return None
    phase, told = "", 0.0

    def show(event: Event) -> None:
        nonlocal phase, told
        is_due = event.phase != phase or time.monotonic() - told >= _SECONDS_BETWEEN_LINES
        if is_due or event.message is not None:
            phase, told = event.phase, time.monotonic()
            amounts = f": {event.done:,} of {event.total:,} {event.unit}" if event.total else ""
            print(event.message or f"{event.phase}{amounts}", file=sys.stderr)

    return show
