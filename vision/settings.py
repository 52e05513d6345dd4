"""Settings are checked where they are made: a search with NaN for a threshold would find nothing and not say why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real

from vision.errors import InputError


@dataclass(frozen=True)
class Allowed:
    """The numbers that a setting may be.

    Attributes:
        low: smallest one.
        high: largest one; infinity stands for any finite number.
        above: whether ``low`` itself is too small.
        whole: whether it must be a whole number.
        infinite: whether it may be infinite, which switches a limit off.
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    whole: bool = False
    infinite: bool = False

    def holds(self, value: object) -> bool:
        """Whether a value is such a number."""
        if isinstance(value, bool) or not isinstance(value, Integral if self.whole else Real):
            return False
        number = float(value)
        if math.isinf(number) and not self.infinite:
            return False
        return (self.low < number if self.above else self.low <= number) and number <= self.high

    def __str__(self) -> str:
        kind = "a whole number" if self.whole else "a number" if self.infinite else "a finite number"
        low = "" if math.isinf(self.low) else f" {'>' if self.above else '>='} {self.low:g}"
        return f"{kind}{low}" + ("" if math.isinf(self.high) else f"{' and' if low else ''} <= {self.high:g}")


POSITIVE = Allowed(0.0, above=True)
NOT_NEGATIVE = Allowed(0.0)
SHARE = Allowed(0.0, 1.0)


def count(least: int = 0) -> Allowed:
    """Whole numbers from the least one on."""
    return Allowed(least, whole=True)


def check(parameters: object, **allowed: Allowed) -> None:
    """Hold settings to what they may be.

    Args:
        parameters: has the settings as attributes; one whose default is a tuple must be a tuple with at least one
            number, each of which is checked.
        **allowed: by the name of the setting.

    Raises:
        InputError: a setting is something else; the message names it.
    """
    for name, numbers in allowed.items():
        value = getattr(parameters, name)
        several = isinstance(getattr(type(parameters), name, None), tuple)
        good = (
            isinstance(value, tuple) and value and all(map(numbers.holds, value)) if several else numbers.holds(value)
        )
        if not good:
            expected = f"a tuple with at least one number, each {numbers}" if several else str(numbers)
            raise InputError(f"{name} of {type(parameters).__name__}", got=value, expected=expected)
