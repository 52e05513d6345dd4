"""Strict reading of JSON into dataclasses: no missing, no unknown and no mistyped field goes by unnoticed."""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from typing import Any, TypeVar

from vision.errors import FileFormatError, InputError

T = TypeVar("T")

MAY_BE_MISSING = types.MappingProxyType({"may_be_missing": True})
"""Metadata of a field that files of older versions do not have; where it is missing, it has its default."""


LARGEST_INT = 2**63 - 1
"""JSON knows no limit; what computes with the numbers does."""


def decode(cls: type[T], value: object, source: str) -> T:
    """A dataclass from what ``json.loads`` gives for its ``asdict``.

    Args:
        cls: a dataclass of str, int, float, bool, None, Literal, tuple[X, ...], dict[str, X] and such dataclasses.
        value: the parsed JSON.
        source: names the file and line in error messages.

    Raises:
        FileFormatError: naming the source and the field.
    """
    return typing.cast(T, _decode(cls, value, source, ""))


def _decode(expected: Any, value: object, source: str, path: str) -> object:
    origin, arguments = typing.get_origin(expected), typing.get_args(expected)
    if dataclasses.is_dataclass(expected):
        return _decode_dataclass(typing.cast(type, expected), value, source, path)
    if origin in (types.UnionType, typing.Union):
        (inner,) = (a for a in arguments if a is not type(None))
        return None if value is None else _decode(inner, value, source, path)
    if origin is tuple and isinstance(value, list):
        return tuple(_decode(arguments[0], v, source, f"{path}[{i}]") for i, v in enumerate(value))
    if origin is dict and isinstance(value, dict):
        return {k: _decode(arguments[1], v, source, f"{path}.{k}") for k, v in value.items()}
    if origin is typing.Literal and value in arguments:
        return value
    if type(value) is int and abs(value) > LARGEST_INT:
        raise _error(source, path, f"{str(value)[:12]}... ({len(str(value))} digits)", "a number of at most 64 bits")
    if expected is float and type(value) in (int, float) and math.isfinite(typing.cast(float, value)):
        return float(typing.cast(float, value))
    if expected in (str, int, bool) and type(value) is expected:
        return value
    name = expected.__name__ if isinstance(expected, type) and origin is None else str(expected)
    raise _error(source, path, f"{value!r:.40}", name)


def _decode_dataclass(cls: type, value: object, source: str, path: str) -> object:
    if not isinstance(value, dict):
        raise _error(source, path, f"{value!r:.40}", f"an object with the fields of {cls.__name__}")
    hints = typing.get_type_hints(cls)
    optional = {f.name for f in dataclasses.fields(cls) if f.metadata == MAY_BE_MISSING}
    for name in hints.keys() - value.keys() - optional:
        raise _error(source, f"{path}.{name}", "nothing", "a value")
    for name in value.keys() - hints.keys():
        raise _error(source, f"{path}.{name}", "an unknown field", f"one of {', '.join(hints)}")
    given = {name: hint for name, hint in hints.items() if name in value}
    fields = {name: _decode(hint, value[name], source, f"{path}.{name}") for name, hint in given.items()}
    try:
        return cls(**fields)
    except FileFormatError:
        raise
    except InputError as error:
        raise _error(source, f"{path} ({error.what})", error.got, error.expected) from None


def _error(source: str, path: str, got: object, expected: object) -> FileFormatError:
    return FileFormatError(f"{source}: field {path.lstrip('.') or '(top)'}", got=got, expected=expected)
