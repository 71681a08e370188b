"""Records: frozen dataclasses with the names and the values of a JSON object.

A field that is a dict is `field(hash=False)`: records compare it, and their hash leaves it out.
"""

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any, Self


@dataclasses.dataclass(frozen=True)
class Record:
    """A JSON object as a dataclass. Lists are tuples; a name that Python reserves has an underscore behind it."""

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The record of a JSON object that has exactly its fields."""
        hints = _hints(cls)
        names = {name.rstrip("_") for name in hints}
        if values.keys() != names:
            raise TypeError(f"{cls.__name__}: fields differ: {sorted(values.keys() ^ names)}")
        return cls(**{name: _convert(hint, values[name.rstrip("_")]) for name, hint in hints.items()})

    def to_dict(self) -> dict[str, Any]:
        """The JSON object."""
        return {name.rstrip("_"): _plain(getattr(self, name)) for name in _hints(type(self))}


_known: dict[type, dict[str, Any]] = {}


def _hints(cls: type) -> dict[str, Any]:
    if cls not in _known:
        _known[cls] = typing.get_type_hints(cls)
    return _known[cls]


def _convert(hint: Any, value: Any) -> Any:
    if value is None:
        return None
    kind = typing.get_origin(hint)
    if kind in (typing.Union, types.UnionType):
        inner = [argument for argument in typing.get_args(hint) if argument is not type(None)]
        return _convert(inner[0], value)
    if kind is tuple:
        parts = typing.get_args(hint)
        return tuple(_convert(parts[0], part) for part in value)
    if isinstance(hint, type) and issubclass(hint, Record):
        return hint.from_dict(value)
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if isinstance(value, dict):
        return dict(value)
    return value
