"""What a person can do on the teaching page, one value per action: a session is a list of these, and nothing else.

Every event can be written as a JSON object and read back (see ``vision.teaching.session_file``). Features and grasps
have identifiers that never change, so that renaming one does not touch the events that follow. Views are counted
from 0 in the order of ``views.json``; pixels are those of the distortion-free view, a whole number being the centre
of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.spatial.transform import RigidTransform

from vision.extraction import ExtractionThresholds
from vision.features import Extractor
from vision.geometry.camera import rigid_transform
from vision.model.grasp import GraspKind
from vision.model.vision_model import Role

Matrix = tuple[tuple[float, ...], ...]
"""A pose as four rows of four numbers."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that a person did.

    Attributes:
        time_s: seconds since the session began, for people who read it; a replay takes no notice.
    """

    time_s: float = 0.0


@dataclass(frozen=True)
class DescribePart(Event):
    """Say what is taught: name, outline diameter, and the rotations about z that look the same (None: all do)."""

    name: str
    diameter_m: float
    symmetry_fold: int | None = None


@dataclass(frozen=True)
class AddFeature(Event):
    """Begin a new feature."""

    feature_id: str
    name: str
    role: Role


@dataclass(frozen=True)
class RenameFeature(Event):
    """Call a feature something else."""

    feature_id: str
    name: str


@dataclass(frozen=True)
class RemoveFeature(Event):
    """Give a feature up, with its marks."""

    feature_id: str


@dataclass(frozen=True)
class SetRole(Event):
    """Make a feature salient or supporting."""

    feature_id: str
    role: Role


@dataclass(frozen=True)
class SetCopies(Event):
    """Say how many equal features are evenly spaced around the axis; one of them is marked."""

    feature_id: str
    copies: int


@dataclass(frozen=True)
class SetExtractor(Event):
    """Choose the extractor that is tried first; None takes what the system proposes."""

    feature_id: str
    extractor: Extractor | None


@dataclass(frozen=True)
class AddPoint(Event):
    """Click near the contour of a feature, in one view."""

    feature_id: str
    view: int
    x: float
    y: float


@dataclass(frozen=True)
class MovePoint(Event):
    """Drag a point to another place."""

    feature_id: str
    view: int
    index: int
    x: float
    y: float


@dataclass(frozen=True)
class RemovePoint(Event):
    """Delete one point."""

    feature_id: str
    view: int
    index: int


@dataclass(frozen=True)
class ClearMarks(Event):
    """Delete all points of a feature in one view."""

    feature_id: str
    view: int


@dataclass(frozen=True)
class ChooseCandidate(Event):
    """Take an ellipse that an extractor found; points along it replace the feature's marks in that view.

    The ellipse is (centre x, centre y, semi-major axis, semi-minor axis, angle of the major axis in radians).
    """

    feature_id: str
    view: int
    extractor: Extractor
    ellipse: tuple[float, ...]


@dataclass(frozen=True)
class PlaceGrasp(Event):
    """Place grasp coordinates (Fig. 2 b), or move those of this identifier; see ``GraspCoordinates``."""

    grasp_id: str
    name: str
    T_part_tcp: Matrix
    width_m: float
    kind: GraspKind
    copies: int = 1


@dataclass(frozen=True)
class RemoveGrasp(Event):
    """Take grasp coordinates away."""

    grasp_id: str


@dataclass(frozen=True)
class SetBore(Event):
    """Point out the bore for peg-in-hole: origin in the centre of the entry rim, z into the bore."""

    T_part_bore: Matrix
    diameter_m: float
    depth_m: float


@dataclass(frozen=True)
class RemoveBore(Event):
    """Say that the part has no bore after all."""


@dataclass(frozen=True)
class SetThresholds(Event):
    """Choose the thresholds of the extractors."""

    thresholds: ExtractionThresholds


@dataclass(frozen=True)
class Undo(Event):
    """Take the last change back."""


@dataclass(frozen=True)
class Redo(Event):
    """Make the change again that was taken back last."""


EVENT_TYPES: tuple[type[Event], ...] = (
    DescribePart,
    AddFeature,
    RenameFeature,
    RemoveFeature,
    SetRole,
    SetCopies,
    SetExtractor,
    AddPoint,
    MovePoint,
    RemovePoint,
    ClearMarks,
    ChooseCandidate,
    PlaceGrasp,
    RemoveGrasp,
    SetBore,
    RemoveBore,
    SetThresholds,
    Undo,
    Redo,
)


def matrix_of(pose: RigidTransform) -> Matrix:
    """A pose as events carry it."""
    return tuple(tuple(float(v) + 0.0 for v in row) for row in pose.as_matrix())


def pose_of(matrix: Matrix) -> RigidTransform:
    """The pose that an event carries.

    Raises:
        InputError: when the matrix is not a rigid motion.
    """
    return rigid_transform(matrix, "pose")
