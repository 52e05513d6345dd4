"""Thresholds that a sweep must reach, for continuous integration.

A thresholds file is TOML: a section ``[METHOD.PART]`` limits the success rates and errors of a localizer on a
part, ``[picks.PART]`` the picks, ``[episodes]`` what may go wrong altogether::

    min_visibility = 0.5            # over which pieces; 0.5 when left out

    [focal.hub]
    matching_rate_low = 0.6         # lower bound of the 95 % interval, at least
    translation_mm_mean = 1.0       # at most
    coverage_min = 0.9              # share of true poses inside the 95 % ellipsoid, at least
    coverage_max = 0.99             # and at most
    false_poses_max = 0.02          # share of the reported poses that belong to no piece, at most

    [picks.hub]
    rate_low = 0.5
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.episodes.metrics import HALF_VISIBLE
from benchmark.report.published import PARTS
from benchmark.report.tables import METHODS, QUANTITIES, STAGES, Table
from vision.errors import FileFormatError, InputError
from vision.files.regular import check_regular

RATE_KEYS = tuple(f"{stage}_rate_low" for stage in STAGES)
ERROR_KEYS = tuple(f"{quantity}_{name}" for quantity in QUANTITIES for name in ("mean", "median"))
COVERAGE_KEYS = ("coverage_min", "coverage_max")
FALSE_POSES_KEY = "false_poses_max"
METHOD_KEYS = (*RATE_KEYS, *ERROR_KEYS, *COVERAGE_KEYS, FALSE_POSES_KEY)
PICK_KEYS = ("rate_low",)
EPISODE_KEYS = ("failed", "missing")


@dataclass(frozen=True)
class Limit:
    """One threshold: ``name`` as in the file, for example ``focal.hub.matching_rate_low``."""

    section: str
    part: str
    key: str
    value: float

    @property
    def name(self) -> str:
        """The dotted key of the file."""
        return ".".join(filter(None, (self.section, self.part, self.key)))

    @property
    def is_floor(self) -> bool:
        """Whether the value is a least one (rates) and not a greatest one (errors, counts)."""
        return self.key.endswith(("_low", "_min"))


@dataclass(frozen=True)
class Thresholds:
    """A thresholds file.

    Attributes:
        min_visibility: rates and errors are taken over pieces at least this visible.
        limits: in the order of the file; ``episodes.failed`` and ``episodes.missing`` are 0 when left out.
    """

    min_visibility: float
    limits: tuple[Limit, ...]


@dataclass(frozen=True)
class Verdict:
    """What became of one threshold.

    Attributes:
        limit: the threshold.
        value: what was measured, None for an empty sample.
        n: size of the sample.
        passed: whether the threshold is met; an empty sample meets none.
    """

    limit: Limit
    value: float | None
    n: int
    passed: bool

    @property
    def shortfall(self) -> float | None:
        """By how much it is missed, positive; None when it is met or nothing was measured."""
        return None if self.passed or self.value is None else abs(self.value - self.limit.value)

    def __str__(self) -> str:
        relation = "at least" if self.limit.is_floor else "at most"
        wanted = f"{relation} {self.limit.value:g}"
        if self.value is None:
            return f"{self.limit.name}: nothing measured (n = 0), wanted {wanted}"
        missed = "" if self.shortfall is None else f", missed by {self.shortfall:.3g}"
        return f"{self.limit.name}: {self.value:.3g} (n = {self.n}), wanted {wanted}{missed}"


def read_thresholds(path: Path) -> Thresholds:
    """Read a thresholds file.

    Raises:
        InputError: it cannot be read, or is no regular file.
        FileFormatError: not TOML, an unknown section or key (the message lists the valid ones), or no number.
    """
    try:
        content = tomllib.loads(check_regular(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"thresholds {path}", got=error.strerror, expected="a readable TOML file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"thresholds {path}", got=str(error), expected="TOML") from None
    where = f"thresholds {path}: key"
    min_visibility = _number(content.pop("min_visibility", HALF_VISIBLE), where, "min_visibility")
    if not 0 <= min_visibility <= 1:
        raise FileFormatError(f"{where} min_visibility", got=min_visibility, expected="a share from 0 to 1")
    episode_limits = {"failed": 0.0, "missing": 0.0}
    limits: list[Limit] = []
    for section, body in content.items():
        found = _section(section, body, where)
        if section == "episodes":
            episode_limits |= {limit.key: limit.value for limit in found}
        else:
            limits += found
    limits += [Limit("episodes", "", key, value) for key, value in episode_limits.items()]
    return Thresholds(min_visibility, tuple(limits))


def _section(section: str, body: object, where: str) -> list[Limit]:
    if not isinstance(body, dict):
        expected = "min_visibility, [METHOD.PART], [picks.PART] or [episodes]"
        raise FileFormatError(f"{where} {section}", got="an unknown key", expected=expected)
    if section == "episodes":
        return _limits(section, "", body, EPISODE_KEYS, where)
    keys = PICK_KEYS if section == "picks" else METHOD_KEYS
    limits = []
    for part, values in body.items():
        if not isinstance(values, dict):
            expected = f"a section [{section}.PART] with {', '.join(keys)}"
            raise FileFormatError(f"{where} {section}.{part}", got=f"{values!r}", expected=expected)
        limits += _limits(section, part, values, keys, where)
    return limits


def _limits(section: str, part: str, values: dict[str, object], keys: Sequence[str], where: str) -> list[Limit]:
    for key in values:
        if key not in keys:
            dotted = ".".join(filter(None, (section, part, key)))
            raise FileFormatError(f"{where} {dotted}", got="an unknown key", expected=f"one of {', '.join(keys)}")
    return [
        Limit(section, part, key, _number(value, where, f"{section}.{part}.{key}")) for key, value in values.items()
    ]


def _number(value: object, where: str, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value:
        raise FileFormatError(f"{where} {name}", got=repr(value), expected="a number")
    return float(value)


def check(table: Table, thresholds: Thresholds) -> list[Verdict]:
    """Hold a sweep against its thresholds; the table must have been built with ``thresholds.min_visibility``.

    Raises:
        FileFormatError: a method or part that the benchmark and the sweep do not know.
    """
    for limit in thresholds.limits:
        _check_names(limit, table)
    return [_judge(limit, table, thresholds.min_visibility) for limit in thresholds.limits]


def _check_names(limit: Limit, table: Table) -> None:
    if limit.section == "episodes":
        return
    sections = tuple(dict.fromkeys([*METHODS, *table.methods, "picks"]))
    parts = tuple(dict.fromkeys([*PARTS, *table.parts]))
    for name, known in ((limit.section, sections), (limit.part, parts)):
        if name not in known:
            raise FileFormatError(f"threshold {limit.name}", got=name, expected=f"one of {', '.join(known)}")


def _judge(limit: Limit, table: Table, min_visibility: float) -> Verdict:
    value, n = _measure(limit, table, min_visibility)
    passed = value is not None and (value >= limit.value if limit.is_floor else value <= limit.value)
    return Verdict(limit, value, n, passed)


def _measure(limit: Limit, table: Table, min_visibility: float) -> tuple[float | None, int]:
    """The measured value that a limit speaks of, and the size of its sample."""
    if limit.section == "episodes":
        counts = {"failed": len(table.failed), "missing": table.planned - table.recorded}
        return float(counts[limit.key]), table.planned
    if limit.part not in table.parts or (limit.section != "picks" and limit.section not in table.methods):
        return None, 0
    if limit.section == "picks":
        rate = table.picks[limit.part]
        return rate.low, rate.n
    if limit.key in RATE_KEYS:
        stage = limit.key.removesuffix("_rate_low")
        rate = table.find_success(limit.part, limit.section, stage, min_visibility).rate
        return rate.low, rate.n
    if limit.key == FALSE_POSES_KEY:
        share = table.find_false_poses(limit.part, limit.section)
        return share.rate, share.n
    row = table.find_accuracy(limit.part, limit.section, min_visibility)
    if limit.key in COVERAGE_KEYS:
        return row.coverage.rate, row.coverage.n
    quantity, _, statistic = limit.key.rpartition("_")
    return getattr(row.errors[quantity], statistic), row.errors[quantity].n
