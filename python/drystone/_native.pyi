from collections.abc import Callable, Sequence
from typing import final

__all__ = ["BUILD", "Stop", "VERSION", "call", "decode_image", "main"]

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

def call(arguments: Sequence[str], listener: _Listener | None = None, stop: Stop | None = None) -> tuple[int, str]: ...
def main(arguments: Sequence[str]) -> int: ...
def decode_image(path: str) -> tuple[int, int, bytearray]: ...
