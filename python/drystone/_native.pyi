from collections.abc import Callable, Sequence
from pathlib import Path
from typing import final

__all__ = ["BUILD", "StageTasks", "Stop", "VERSION", "call", "decode_image", "main"]

VERSION: str
BUILD: str

_Listener = Callable[[str, int, int, str, str | None], object]

@final
class Stop:
    """Stops a job from another thread: pass it as `stop=`, and call `set()`."""

    def __new__(cls) -> Stop: ...
    def set(self) -> None:
        """Asks every job that has this token to stop."""

    def is_set(self) -> bool:
        """Whether the token is set."""

@final
class StageTasks:
    """Tasks of a stage that are to be done."""

    @property
    def stage(self) -> Path: ...
    @property
    def count(self) -> int: ...
    def is_stopped(self) -> bool:
        """Whether the job is to stop."""

    def end(self, is_done: bool, error: BaseException | None = None) -> None:
        """No more tasks will be done: all of them are, maybe not all, or the exception ends the job."""

def call(
    arguments: Sequence[str],
    listener: _Listener | None = None,
    stop: Stop | None = None,
    start: Callable[[StageTasks], object] | None = None,
) -> tuple[int, str]: ...
def main(arguments: Sequence[str]) -> int: ...
def decode_image(path: str) -> tuple[int, int, bytearray]: ...
