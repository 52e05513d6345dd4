"""JSON that was read from a file, checked value by value; errors name the path to what is wrong."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.errors import FileFormatError, InputError
from vision.files.regular import check_regular

Array = NDArray[np.float64]

_UNIT_TOLERANCE = 1e-6  # numbers are written with nine significant digits


def read_text(path: Path, what: str, do: str) -> str:
    """The text of a UTF-8 file.

    Args:
        path: of the file.
        what: names its content in errors.
        do: the remedy where there is no such file.

    Raises:
        InputError: when it cannot be read, or is no regular file.
        FileFormatError: when it is not UTF-8.
    """
    try:
        return check_regular(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(what, got=f"{path} ({error})", expected="a readable file", do=do) from error
    except UnicodeDecodeError as error:
        raise FileFormatError(str(path), got=f"not UTF-8 ({error})", expected=f"a {what} in JSON") from error


def parse(text: str, source: str, what: str) -> JsonValue:
    """The root of a JSON text.

    Args:
        text: JSON.
        source: names the text in errors.
        what: it should hold.

    Raises:
        FileFormatError: when it is not JSON.
    """
    try:
        return JsonValue(json.loads(text), source)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(source, got=f"invalid JSON ({error})", expected=f"a {what}") from error


@dataclass(frozen=True)
class JsonValue:
    """A value in the document, and the path that leads to it."""

    value: Any
    source: str
    path: str = ""

    def check(self, condition: bool, expected: str) -> None:
        """Raise a FileFormatError that names this value, unless the condition holds."""
        if not condition:
            got = repr(self.value)
            where = f"{self.source}: {self.path}" if self.path else self.source
            raise FileFormatError(where, got=got if len(got) <= 80 else f"{got[:77]}...", expected=expected)

    def check_header(self, what: str, file_format: str, version: int) -> None:
        """Say of a foreign file that it is foreign, not which keys it lacks."""
        self.check(isinstance(self.value, dict), f"a {what}: a JSON object")
        for key, expected in (("format", file_format), ("version", version)):
            found = self.value.get(key)
            JsonValue(found, self.source, key).check(
                type(found) is type(expected) and found == expected, json.dumps(expected)
            )

    def members(self, *keys: str) -> dict[str, JsonValue]:
        """The members of an object that has exactly these keys."""
        mine = self.mapping()
        for key in keys:
            if key not in mine:
                raise FileFormatError(f"{self.source}: {self._inner(key)}", got="no such key", expected="this key")
        for key in mine:
            if key not in keys:
                got, expected = "an unknown key", f"one of {', '.join(keys)}"
                raise FileFormatError(f"{self.source}: {self._inner(key)}", got=got, expected=expected)
        return mine

    def mapping(self) -> dict[str, JsonValue]:
        """The members of an object."""
        self.check(isinstance(self.value, dict), "an object")
        return {k: JsonValue(v, self.source, self._inner(k)) for k, v in self.value.items()}

    def items(self) -> list[JsonValue]:
        """The items of a list."""
        self.check(isinstance(self.value, list), "a list")
        return [JsonValue(v, self.source, f"{self.path}[{i}]") for i, v in enumerate(self.value)]

    def text(self) -> str:
        """A text that is not empty."""
        self.check(isinstance(self.value, str) and self.value != "", "a text that is not empty")
        return str(self.value)

    def choice(self, choices: Sequence[str]) -> Any:
        """One of some texts."""
        self.check(isinstance(self.value, str) and self.value in choices, f"one of {', '.join(choices)}")
        return self.value

    def number(self) -> float:
        """A finite number."""
        number = isinstance(self.value, int | float) and not isinstance(self.value, bool)
        self.check(number and abs(self.value) <= sys.float_info.max, "a finite number")
        return float(self.value)

    def positive(self) -> float:
        """A number > 0."""
        self.check(self.number() > 0, "a number > 0")
        return float(self.value)

    def share(self) -> float:
        """A number from 0 to 1."""
        self.check(0 <= self.number() <= 1, "a number from 0 to 1")
        return float(self.value)

    def count(self, least: int = 1) -> int:
        """A whole number, not below the least one."""
        whole = isinstance(self.value, int) and not isinstance(self.value, bool)
        self.check(whole and self.value >= least, f"a whole number >= {least}")
        return int(self.value)

    def vector(self, n: int) -> Array:
        """(n,) numbers."""
        numbers = self.items()
        self.check(len(numbers) == n, f"{n} numbers")
        return np.array([item.number() for item in numbers])

    def unit(self, n: int) -> Array:
        """(n,) numbers of length 1."""
        vector = self.vector(n)
        # Compared before the norm is taken: large numbers would overflow in it.
        near = bool((np.abs(vector) < 2).all()) and abs(float(np.linalg.norm(vector)) - 1) < _UNIT_TOLERANCE
        self.check(near, f"{n} numbers of length 1")
        return vector

    def _inner(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key
