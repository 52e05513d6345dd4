"""What happened in an episode, and the file that keeps it.

A sweep is a directory with ``sweep.json`` (its configuration), ``inputs.json`` (digests of the files that it began
with) and ``episodes.jsonl`` (one line per finished episode, appended and synced, so that a killed sweep loses nothing
but the episodes that were running).
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any

from benchmark.strict_json import MAY_BE_MISSING, decode
from vision.errors import FileFormatError, InputError

SCHEMA = 1
STAGES = ("drop", "render", "vision", "motion", "total")


def vision_stage(compared: str) -> str:
    """The stage in which a localizer works that was compared with the episode's own, by its name."""
    return f"vision of {compared}"


@dataclass(frozen=True)
class PoseErrors:
    """Error of an estimated pose; see ``benchmark.episodes.metrics.pose_errors``.

    Attributes:
        translation_mm: distance of the part origins.
        tilt_deg: angle between the part axes.
        inplane_deg: rotation about the axis that remains, modulo the symmetry; None for a continuous symmetry.
        rotation_deg: geodesic angle, least over the symmetries.
        mssd_mm: maximum symmetry-aware surface distance.
    """

    translation_mm: float
    tilt_deg: float
    inplane_deg: float | None
    rotation_deg: float
    mssd_mm: float

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise InputError(f"pose error {name}", got=value, expected="a finite number >= 0")


@dataclass(frozen=True)
class NormalizedError:
    """Error of an estimated pose in units of its own covariance; see ``benchmark.episodes.metrics.normalized_error``.

    Attributes:
        squared: error^T covariance^-1 error (NEES); chi-square distributed where the covariance is right.
        components: the degrees of freedom: 6, or 5 where the rotation about the part's axis is not known or has no
            meaning.
    """

    squared: float
    components: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.squared) and self.squared >= 0):
            raise InputError("normalized squared error", got=self.squared, expected="a finite number >= 0")
        if self.components not in (5, 6):
            raise InputError("components of a pose error", got=self.components, expected="5 or 6")


@dataclass(frozen=True)
class PoseOffset:
    """The way from the true pose of a piece to the estimated one; of the poses that look the same, to the nearest.

    Unlike the size of the errors it tells how far the estimates of two sweeps lie apart.

    Attributes:
        translation_mm: x, y and z in the frame of the true piece.
        rotation_deg: rotation vector in that frame; without a turn about the axis where the estimate does not know
            it or the part has none.
    """

    translation_mm: tuple[float, ...]
    rotation_deg: tuple[float, ...]

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if len(value) != 3 or not all(map(math.isfinite, value)):
                raise InputError(f"pose offset {name}", got=value, expected="three finite numbers")


@dataclass(frozen=True)
class LocalizerResult:
    """What one localizer made of one piece.

    Attributes:
        extracted: the salient ellipse was found, as ``benchmark.episodes.metrics.EXTRACTION_IOU`` defines it.
        matched: the pose was found, as ``benchmark.episodes.metrics.MATCH_MSSD_FRACTION`` defines it.
        errors: of the pose assigned to the piece, None where there is none.
        normalized: the same against the covariance that came with the pose; None where there is no pose, no usable
            covariance, or the record is older than this field.
        offset: from the true pose to the one assigned; None where there is none, or the record is older than this
            field.
        probability: with which the localizer says that this pose is right; None where it does not say, there is no
            pose, or the record is older than this field.
    """

    extracted: bool
    matched: bool
    errors: PoseErrors | None = None
    normalized: NormalizedError | None = field(default=None, metadata=MAY_BE_MISSING)
    offset: PoseOffset | None = field(default=None, metadata=MAY_BE_MISSING)
    probability: float | None = field(default=None, metadata=MAY_BE_MISSING)

    def __post_init__(self) -> None:
        if self.matched and self.errors is None:
            raise InputError("result of a matched piece", got="no errors", expected="the errors of its pose")


@dataclass(frozen=True)
class PieceRecord:
    """One piece of a scene.

    Attributes:
        index: of the piece in its scene.
        part: name of its type.
        visibility: the visible share of its silhouette, 0 to 1, mean over the views.
        in_bin: False when it bounced out; it is then counted apart.
        results: by localizer, one of ``benchmark.config.LOCALIZERS`` or the user's own.
        failed_stage: where the run's localizer lost the piece, None when it did not.
    """

    index: int
    part: str
    visibility: float
    in_bin: bool
    results: dict[str, LocalizerResult]
    failed_stage: str | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.visibility <= 1:
            raise InputError("visibility of a piece", got=self.visibility, expected="a share from 0 to 1")


@dataclass(frozen=True)
class PickRecord:
    """One pick.

    Attributes:
        attempted: a localised piece was there to be picked; False when nothing was localised. A piece for which no
            collision-free way was found counts as attempted and failed.
        piece: index of the piece, None when the estimate belongs to no piece or nothing was attempted.
        succeeded: the piece ended up where it should.
        failed_stage: such as ``plan``, ``grip``, ``lift``, ``place``; None on success.
        grasp: name of the grasp.
        rejected: where no grasp was found, how many fell for which reason; empty too in a record that is older than
            this field.
    """

    attempted: bool
    piece: int | None
    succeeded: bool
    failed_stage: str | None = None
    grasp: str | None = None
    rejected: dict[str, int] = field(default_factory=dict, metadata=MAY_BE_MISSING)


@dataclass(frozen=True)
class AttemptRecord:
    """One attempt of the robot's.

    Attributes:
        goal: what was attempted, such as ``pick``.
        piece: index of the piece, None when the estimate belongs to no piece or there was none.
        succeeded: the piece ended up where it should.
        stage: where the attempt ended, such as ``plan``, ``grip``, ``lift`` or ``place``; None on success.
        cause: why, in a few words.
        grasp: name of the grasp.
        rejected: where no way was found, how many candidates fell for which reason.
        seconds: simulated time in s by what the robot did, since the attempt before.
        stray_force_n: largest force between the robot and a body that it was not to touch.
        stray_body: that body.
        touch_force_n: largest force between the robot and a piece.
        penetration_mm: deepest contact of the robot.
        speed_share: largest measured joint speed in free air over its limit.
        acceleration_share: the same of the acceleration.
        jerk_share: the same of the jerk.
        tries: how often an insertion began.
        wrist_n: largest force in N that the wrist felt during an insertion.
        depth_mm: how deep the peg ended in the bore; None where it was not on its axis, or for other goals.
    """

    goal: str
    piece: int | None
    succeeded: bool
    stage: str | None = None
    cause: str = ""
    grasp: str | None = None
    rejected: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    stray_force_n: float = 0.0
    stray_body: str = ""
    touch_force_n: float = 0.0
    penetration_mm: float = 0.0
    speed_share: float = 0.0
    acceleration_share: float = 0.0
    jerk_share: float = 0.0
    tries: int = 1
    wrist_n: float = 0.0
    depth_mm: float | None = None


@dataclass(frozen=True)
class EpisodeRecord:
    """One finished episode.

    Attributes:
        key: ``EpisodeConfig.key``.
        parts: the part types of the scene.
        scene: ``EpisodeConfig.scene``.
        seed: ``EpisodeConfig.seed``.
        config_hash: ``EpisodeConfig.config_hash``.
        environment: ``benchmark.records.environment.environment_stamp``; older records have fewer entries.
        pieces: one record for each piece.
        picks: in the order in which they were made.
        false_positives: by localizer, the number of poses that belong to no piece.
        false_probabilities: by localizer, with which it says of those poses that they are right, where it says so;
            empty too in a record that is older than this field.
        timings_s: wall time in seconds under the names in ``STAGES``, and ``vision_stage`` of what was compared.
        error: one line that says why the episode did not finish; None when it did.
        attempts: of the task, in the order in which they were made; empty in a record that is older than this field.
        places: where every piece was in the end: ``tray``, ``bin`` or ``lost``; empty where no task was done, or the
            record is older than this field.
    """

    key: str
    parts: tuple[str, ...]
    scene: int
    seed: int
    config_hash: str
    environment: dict[str, str] = field(default_factory=dict)
    pieces: tuple[PieceRecord, ...] = ()
    picks: tuple[PickRecord, ...] = ()
    false_positives: dict[str, int] = field(default_factory=dict)
    timings_s: dict[str, float] = field(default_factory=dict)
    error: str | None = None
    false_probabilities: dict[str, tuple[float, ...]] = field(default_factory=dict, metadata=MAY_BE_MISSING)
    attempts: tuple[AttemptRecord, ...] = field(default=(), metadata=MAY_BE_MISSING)
    places: tuple[str, ...] = field(default=(), metadata=MAY_BE_MISSING)


def to_json(record: EpisodeRecord) -> str:
    """The record as one line of JSON, without the newline."""
    return json.dumps({"schema": SCHEMA, **asdict(record)}, allow_nan=False, separators=(",", ":"))


def from_json(line: str, source: str = "record") -> EpisodeRecord:
    """The record back from its line.

    Args:
        line: what ``to_json`` made.
        source: names the line in error messages, for example ``"episodes.jsonl line 3"``.

    Raises:
        FileFormatError: naming the source and the field.
    """
    fields = parse_object(line, source)
    return decode(EpisodeRecord, fields, source)


def parse_object(text: str, source: str) -> dict[str, Any]:
    """A JSON object of this schema version, without its ``schema`` field.

    Raises:
        FileFormatError: not JSON, not an object, or of another version.
    """
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError) as error:
        got = f"{_clip(text)} ({error})"
        raise FileFormatError(source, got=got, expected="JSON", do="Delete it or restore the file.") from None
    if not isinstance(fields, dict):
        raise FileFormatError(source, got=_clip(text), expected="a JSON object")
    version = fields.pop("schema", None)
    if version != SCHEMA:
        do = "Use the focalpick that wrote the file, or run the sweep into a new directory."
        raise FileFormatError(f"{source}: field schema", got=version, expected=SCHEMA, do=do)
    return fields


def _clip(text: str, length: int = 40) -> str:
    return repr(text if len(text) <= length else text[:length] + "...")
