"""What to run: one episode, or a sweep of them. Pure values; equal values have equal hashes on every machine."""

from __future__ import annotations

import hashlib
import json
import math
import os
import zlib
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Literal, get_args

from benchmark.seeds import SCENES
from benchmark.strict_json import LARGEST_INT, MAY_BE_MISSING
from vision.errors import InputError

Task = Literal["pick", "clear", "insert", "none"]
SENSORS = ("ideal", "lab", "shopfloor")
LOCALIZERS = ("focal", "focal-region", "focal-group", "paper", "previous", "oracle")
LADDER: dict[str, str] = {
    "previous": "the predecessor: region growing alone",
    "paper": "the paper's system",
    "paper-fit": "+ poses are fitted to edges",
    "paper-both": "+ our extractors, both for every feature",
    "edges-confirm": "+ edges confirm, in the place of extracted supporting features",
    "depth-search": "+ depth search",
    "hiding": "+ parts found hide what is behind them",
    "patterns": "+ patterns",
    "focal": "+ arcs: our localizer",
    "focal-region": "focal with region growing alone",
    "focal-group": "focal with edge grouping alone",
}
"""The localizers of the preset ladder, and what each adds to the one above it; the last two are held to ``focal``."""
TASKS: tuple[str, ...] = get_args(Task)
VIEWS = (2, 3)
MOST_PIECES = 12
MOST_CLEARANCE_MM = 5.0
MOST_SCENES = 100_000
MOST_EPISODES = 1_000_000
MOST_WORKERS = 1024
TAUGHT_VIEWS = (2, 5)


@dataclass(frozen=True)
class Variant:
    """One setting of the quantities that a study varies; None leaves a quantity as the sweep has it.

    Attributes:
        hand_eye_mm: root mean square length of the camera's mounting error, instead of the sensor's; its angle goes
            with it, see ``benchmark.world.sensor.with_hand_eye_error``.
        click_sigma_px: the parts are taught anew by a simulated person whose clicks err by this standard deviation.
        taught_views: in how many views of a face, 2 to 5, this person marks a feature; given with ``click_sigma_px``.
    """

    hand_eye_mm: float | None = None
    click_sigma_px: float | None = None
    taught_views: int | None = None

    def __post_init__(self) -> None:
        for name in ("hand_eye_mm", "click_sigma_px"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise InputError(name, got=value, expected="a finite number, not negative")
            if value is not None:
                object.__setattr__(self, name, float(value))  # 1 and 1.0 are one variant, and must have one hash
        if (self.click_sigma_px is None) != (self.taught_views is None):
            got = f"click_sigma_px={self.click_sigma_px}, taught_views={self.taught_views}"
            raise InputError("variant", got=got, expected="both or neither")
        if self.taught_views is not None and not TAUGHT_VIEWS[0] <= self.taught_views <= TAUGHT_VIEWS[1]:
            expected = f"a whole number, from {TAUGHT_VIEWS[0]} to {TAUGHT_VIEWS[1]}"
            raise InputError("taught_views", got=self.taught_views, expected=expected)

    @property
    def is_taught(self) -> bool:
        """Whether the variant has vision models of its own."""
        return self.click_sigma_px is not None

    @property
    def name(self) -> str:
        """Names the variant in keys and directories, for example ``hand-eye-0.5mm`` or ``clicks-2px-3views``."""
        quantities = [] if self.hand_eye_mm is None else [f"hand-eye-{self.hand_eye_mm:g}mm"]
        if self.is_taught:
            quantities.append(f"clicks-{self.click_sigma_px:g}px-{self.taught_views}views")
        return "-".join(quantities) or "unchanged"


@dataclass(frozen=True)
class EpisodeConfig:
    """One scene: pieces dropped into the bin, photographed, localised and, with most tasks, picked.

    Attributes:
        parts: names of the part types in the scene, or mesh files; one, or several for a mixed scene.
        pieces: how many pieces are dropped (the paper: 4 to 6).
        scene: index of the scene within its sweep.
        seed: seeds everything random in the episode.
        sensor: name of a sensor preset, one of ``SENSORS``.
        localizer: one of ``LOCALIZERS``, or the user's own as ``benchmark.localizers`` finds it.
        views: number of viewpoints, 2 or 3.
        task: ``pick`` lets the robot pick one piece, ``clear`` all of them, ``insert`` put a peg into a bore,
            ``none`` stops after localisation.
        variant: what is different in this episode of a study; None outside studies.
        models: directory of vision models that come before the shipped ones, None for these alone.
        compared: other localizers that look at the same pictures; nothing is picked by their poses.
        clearance_mm: diametral, between peg and bore, of the task ``insert``; None for 0.5 mm.
    """

    parts: tuple[str, ...]
    pieces: int = 4
    scene: int = 0
    seed: int = 0
    sensor: str = "lab"
    localizer: str = "focal"
    views: int = 3
    task: Task = "pick"
    variant: Variant | None = field(default=None, metadata=MAY_BE_MISSING)
    models: str | None = field(default=None, metadata=MAY_BE_MISSING)
    compared: tuple[str, ...] = field(default=(), metadata=MAY_BE_MISSING)
    clearance_mm: float | None = field(default=None, metadata=MAY_BE_MISSING)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts or not all(isinstance(p, str) and p for p in self.parts):
            raise InputError("parts of a scene", got=self.parts, expected="at least one part name")
        _check_number("scene", self.scene, 0)
        _check_number("seed", self.seed, 0)
        _check_common(self)

    @property
    def kind(self) -> str:
        """The part names joined by ``+``: ``hub``, or ``hub+cover2`` for a mixed scene."""
        return "+".join(self.parts)

    @property
    def key(self) -> str:
        """Names the episode within a sweep, for example ``hub/007``, or ``hub/007/hand-eye-0.5mm`` in a study."""
        scene = f"{self.kind}/{self.scene:03d}"
        return scene if self.variant is None else f"{scene}/{self.variant.name}"

    @property
    def config_hash(self) -> str:
        """SHA-256 of the canonical JSON, 64 hexadecimal digits."""
        return _hash(as_fields(self))


@dataclass(frozen=True)
class SweepConfig:
    """Many episodes: ``scenes`` of each kind in ``parts``.

    Attributes:
        parts: kinds of scene; a kind is a part name, or part names joined by ``+`` for mixed scenes.
        scenes: scenes of each kind (the paper: 35).
        pieces: pieces in each scene, or the fewest.
        most_pieces: each scene's own number, from ``pieces`` to this one, follows from its seed (the paper: 4 to 6);
            None where all scenes have ``pieces``.
        sensor: as in ``EpisodeConfig``.
        localizer: as in ``EpisodeConfig``.
        views: as in ``EpisodeConfig``.
        seed: seeds the whole sweep.
        task: as in ``EpisodeConfig``.
        workers: processes that run episodes; has no influence on any result and no part in the hash.
        variants: what a study varies: every scene is run once in each variant. Empty outside studies.
        models: as in ``EpisodeConfig``.
        compared: as in ``EpisodeConfig``.
        clearance_mm: as in ``EpisodeConfig``.
    """

    parts: tuple[str, ...]
    scenes: int = 35
    pieces: int = 4
    sensor: str = "lab"
    localizer: str = "focal"
    views: int = 3
    seed: int = 0
    task: Task = "pick"
    workers: int = 1
    variants: tuple[Variant, ...] = field(default=(), metadata=MAY_BE_MISSING)
    models: str | None = field(default=None, metadata=MAY_BE_MISSING)
    compared: tuple[str, ...] = field(default=(), metadata=MAY_BE_MISSING)
    clearance_mm: float | None = field(default=None, metadata=MAY_BE_MISSING)
    most_pieces: int | None = field(default=None, metadata=MAY_BE_MISSING)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts or len(set(self.parts)) != len(self.parts) or not all(map(_is_kind, self.parts)):
            raise InputError(
                "parts of a sweep",
                got=",".join(map(str, self.parts)) or "nothing",
                expected="different part names, separated by commas; name+name for mixed scenes",
            )
        _check_number("scenes", self.scenes, 1, MOST_SCENES)
        _check_number("seed", self.seed, 0, LARGEST_INT)
        _check_number("workers", self.workers, 1, MOST_WORKERS)
        object.__setattr__(self, "variants", tuple(self.variants))
        _check_number("episodes (scenes x parts x variants)", self.planned, 1, MOST_EPISODES)
        if len({variant.name for variant in self.variants}) != len(self.variants):
            raise InputError("variants", got=", ".join(v.name for v in self.variants), expected="different ones")
        _check_common(self)
        if self.most_pieces is not None:
            _check_number("most pieces", self.most_pieces, self.pieces, MOST_PIECES)
        if self.most_pieces == self.pieces:
            object.__setattr__(self, "most_pieces", None)  # the same sweep has the same hash

    @property
    def config_hash(self) -> str:
        """SHA-256 of the canonical JSON without ``workers``, 64 hexadecimal digits."""
        return _hash({k: v for k, v in as_fields(self).items() if k != "workers"})

    @property
    def planned(self) -> int:
        """Number of episodes."""
        return self.scenes * len(self.parts) * max(len(self.variants), 1)

    @property
    def pieces_in_words(self) -> str:
        """How many pieces the scenes have: ``4``, or ``4 to 6``."""
        return str(self.pieces) if self.most_pieces is None else f"{self.pieces} to {self.most_pieces}"

    @property
    def part_names(self) -> tuple[str, ...]:
        """Every part type of the sweep, once, in the order of first appearance."""
        return tuple(dict.fromkeys(name for kind in self.parts for name in kind.split("+")))

    def episode(self, kind: str, scene: int, variant: Variant | None = None) -> EpisodeConfig:
        """Scene number ``scene`` of one kind; does not depend on which other kinds are in the sweep.

        The variants of a scene share its seed, so that nothing but what is varied tells them apart.
        """
        seed = episode_seed(self.seed, kind, scene)
        return EpisodeConfig(
            parts=tuple(kind.split("+")),
            pieces=self.pieces if self.most_pieces is None else drawn_pieces(seed, self.pieces, self.most_pieces),
            scene=scene,
            seed=seed,
            sensor=self.sensor,
            localizer=self.localizer,
            views=self.views,
            task=self.task,
            variant=variant,
            models=self.models,
            compared=self.compared,
            clearance_mm=self.clearance_mm,
        )


def episodes(sweep: SweepConfig) -> list[EpisodeConfig]:
    """All episodes of a sweep, round-robin over the kinds so that a part of the sweep is balanced."""
    variants = sweep.variants or (None,)
    return [sweep.episode(k, scene, v) for scene in range(sweep.scenes) for k in sweep.parts for v in variants]


def as_fields(config: EpisodeConfig | SweepConfig) -> dict[str, Any]:
    """The configuration as plain values for JSON, as it is hashed and stored.

    Fields that older versions did not have are left out at their default: old results keep their hash.
    """
    newer = {f.name: f.default for f in fields(config) if f.metadata == MAY_BE_MISSING}
    return {k: v for k, v in asdict(config).items() if k not in newer or getattr(config, k) != newer[k]}


def episode_seed(sweep_seed: int, kind: str, scene: int) -> int:
    """The seed of one episode, 32 bits, from what identifies it and nothing else."""
    from numpy.random import SeedSequence  # numpy is slow to import, and `focalpick --help` reads this module

    entropy = SeedSequence((sweep_seed, zlib.crc32(kind.encode()), scene))
    return int(entropy.generate_state(1)[0])


def drawn_pieces(seed: int, fewest: int, most: int) -> int:
    """How many pieces a scene of this seed has, every number from the fewest to the most being as likely."""
    from numpy.random import default_rng  # see episode_seed

    return int(default_rng((seed, fewest, most)).integers(fewest, most, endpoint=True))


def preset(name: str, **changes: Any) -> SweepConfig:
    """The preset ``name`` with those ``changes`` that are not None.

    Raises:
        InputError: no such preset, or a change that makes no sense.
    """
    if name not in PRESETS:
        raise InputError("preset", got=name, expected=" or ".join(PRESETS))
    return replace(PRESETS[name], **{k: v for k, v in changes.items() if v is not None})


def _is_kind(kind: object) -> bool:
    return isinstance(kind, str) and all(kind.split("+"))


def _hash(fields: dict[str, object]) -> str:
    canonical = json.dumps(fields, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(canonical.encode()).hexdigest()


def _check_number(what: str, value: object, least: int, most: int | None = None) -> None:
    whole = isinstance(value, int) and not isinstance(value, bool)
    if not whole or value < least or (most is not None and value > most):  # type: ignore[operator]
        limits = f"at least {least}" if most is None else f"from {least} to {most}"
        raise InputError(what, got=value, expected=f"a whole number, {limits}")


def _check_common(config: EpisodeConfig | SweepConfig) -> None:
    _check_number("pieces", config.pieces, 1, MOST_PIECES)
    if config.sensor not in SENSORS:
        raise InputError("sensor", got=config.sensor, expected=" or ".join(SENSORS))
    # Whether the user's own localizer exists is asked where it is used: old results stay readable without it.
    if not config.localizer or config.localizer.split() != [config.localizer]:
        expected = f"{', '.join(LOCALIZERS)}, or the name of your own"
        raise InputError("localizer", got=repr(config.localizer), expected=expected)
    object.__setattr__(config, "compared", tuple(config.compared))
    names = (config.localizer, *config.compared)
    if len(set(names)) != len(names):
        raise InputError(
            "compared", got=", ".join(config.compared), expected=f"others than {config.localizer}, each once"
        )
    if config.views not in VIEWS:
        raise InputError("views", got=config.views, expected="2 or 3")
    if config.task not in TASKS:
        raise InputError("task", got=config.task, expected=" or ".join(TASKS))
    if config.clearance_mm is not None and not 0 < config.clearance_mm <= MOST_CLEARANCE_MM:
        expected = f"above 0, at most {MOST_CLEARANCE_MM}, in mm"
        raise InputError("clearance of the peg", got=config.clearance_mm, expected=expected)


def _like_table1(name: str, **changes: Any) -> SweepConfig:
    """The paper's experiment with changes, on the seeds that are registered for ``name``."""
    table1 = SweepConfig(parts=("hub", "cover1", "cover2"), pieces=4, most_pieces=6, workers=os.cpu_count() or 1)
    return replace(table1, seed=SCENES[name].start, **changes)


PRESETS: dict[str, SweepConfig] = {
    "table1": _like_table1("table1", compared=("previous", "paper")),
    "smoke": _like_table1("smoke", scenes=2),
    "ladder": _like_table1("ladder", task="none", compared=tuple(name for name in LADDER if name != "focal")),
    "heap": _like_table1("heap", pieces=8, most_pieces=12),
    "shopfloor": _like_table1("shopfloor", scenes=10, sensor="shopfloor", task="none"),
    "calibration": _like_table1(
        "calibration",
        scenes=10,
        task="none",
        variants=tuple(Variant(hand_eye_mm=error) for error in (0.0, 0.25, 0.5, 1.0, 1.5, 2.0)),
    ),
    "teaching": _like_table1(
        "teaching",
        scenes=5,
        task="none",
        variants=tuple(
            Variant(click_sigma_px=sigma, taught_views=views)
            for views in (5, 4, 3, 2)
            for sigma in (0.0, 1.0, 2.0, 3.0, 5.0)
        ),
    ),
}
