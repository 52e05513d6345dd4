"""Read-only arrays: whoever gets a value, in this process or in another one, cannot change it for others."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

_HOLDERS = (np.ndarray, tuple, dict)

T = TypeVar("T")
Class = TypeVar("Class", bound=type)


def read_only(value: T) -> T:
    """An array as a read-only view; a tuple or a dict with all its arrays so; anything else as it is.

    Nothing is copied, so that whoever made an array can still write to it. A value that is made of arrays of unknown
    origin has to copy them first.
    """
    frozen: Any = value
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            frozen = value.view()
            frozen.setflags(write=False)
    elif isinstance(value, tuple):
        frozen = type(value)._make(map(read_only, value)) if hasattr(value, "_make") else tuple(map(read_only, value))
    elif isinstance(value, dict):
        frozen = {key: read_only(each) for key, each in value.items()}
    return frozen


def frozen_arrays(cls: Class) -> Class:
    """Make the arrays in the fields of a dataclass :func:`read_only`, also in its copies and after unpickling.

    Stands below ``@dataclass(frozen=True, eq=False)``. The class's own ``__post_init__`` goes first; it has no part
    in copying and unpickling, so that these give the same bits.
    """
    own = vars(cls).get("__post_init__")

    def freeze(self: Any) -> None:
        if own is not None:
            own(self)
        _restore(self, vars(self))

    for name, method in {"__post_init__": freeze, "__getstate__": _fields, "__setstate__": _restore}.items():
        setattr(cls, name, method)
    return cls


def _fields(self: Any) -> dict[str, Any]:
    """What is pickled: not what was computed from it."""
    return {field.name: getattr(self, field.name) for field in fields(self)}


def _restore(self: Any, state: dict[str, Any]) -> None:
    # Values are made by the thousand: numbers and texts are not worth a call.
    vars(self).update({name: read_only(v) if isinstance(v, _HOLDERS) else v for name, v in state.items()})
