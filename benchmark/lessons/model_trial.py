"""Tries a taught model before it is saved: in fresh scenes of the simulated cell, or in the taught pictures.

Made for the teaching page, which runs it in a process of its own and draws every outcome as it comes; what is raised
by ``report`` ends the trial.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmark.config import EpisodeConfig, episode_seed
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.episodes.evaluation import Verdict
from benchmark.episodes.metrics import hull_points, match_limit_mm, pose_errors
from benchmark.meshes.mesh_file import MeshReference
from benchmark.records.episode_record import EpisodeRecord
from benchmark.world.cell import WorkCell
from benchmark.world.part import Symmetry
from vision.drawing.strokes import Colour, Image, Strokes, enlarge, model_strokes, paint, plain_strokes
from vision.errors import InputError
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import EllipseLocalizer, Localization
from vision.model.contour import ModelContour
from vision.model.model_file import save_model
from vision.model.vision_model import VisionModel
from vision.pose.estimate import PoseEstimate
from vision.teaching.editor.services import PieceOutcome, SceneOutcome

Report = Callable[[SceneOutcome], None]

PIECES = 4
SENSOR = "lab"
LOCALIZER = "focal"
VIEWS_TOGETHER = 3
MISSED_COLOUR: Colour = (255, 220, 60)
FALSE_COLOUR: Colour = (255, 70, 70)
_TEXT_HEIGHT_PX = 26


def try_model(
    model: VisionModel, part: str, scenes: int, seed: int, report: Report | None = None
) -> tuple[SceneOutcome, ...]:
    """Drop pieces into the bin, photograph and localise them, again and again, as a sweep does but without picks.

    Args:
        model: as taught, saved or not.
        part: name of the part, or its mesh file.
        scenes: how many scenes.
        seed: decides on everything in them; the scenes are those of a sweep of this seed.
        report: called with each scene when it is done.

    Raises:
        InputError: an unknown part, or a mesh that cannot be one.
        ResourceError: the machine cannot draw.
    """
    mesh = MeshReference.parse(part)
    name = part if mesh is None else mesh.path.stem
    outcomes = []
    with tempfile.TemporaryDirectory(prefix="focalpick-trial-") as models:
        # The episode reads the model from a file, so what is tried is what would be saved.
        save_model(replace(model, part=name), Path(models) / f"{name}.json")
        for scene in range(scenes):
            config = EpisodeConfig(
                parts=(part,),
                pieces=PIECES,
                scene=scene,
                seed=episode_seed(seed, part, scene),
                sensor=SENSOR,
                localizer=LOCALIZER,
                task="none",
                models=models,
            )
            witness = _Witness(model)
            outcomes.append(_outcome(scene + 1, run_episode(config, witness), witness))
            if report is not None:
                report(outcomes[-1])
    return tuple(outcomes)


def try_in_views(
    model: VisionModel, views: Sequence[View], scenes: int, seed: int, report: Report | None = None
) -> tuple[SceneOutcome, ...]:
    """Look for the part in the pictures that it was taught in, a few at a time: all there is without a mesh.

    Args:
        model: as taught.
        views: the pictures, whose world is the part's frame; with distortion-free lenses.
        scenes: how many times.
        seed: decides on the pictures that are taken together; they show the same face of the part.
        report: called with each outcome when it is done.

    Raises:
        InputError: fewer than two pictures of either face.
    """
    faces = [[v for v in views if side * v.T_world_camera.translation[2] > 0] for side in (1, -1)]
    faces = [face for face in faces if len(face) >= 2]
    if not faces:
        raise InputError("views", got=len(views), expected="at least two of one face of the part")
    rng = np.random.default_rng(seed)
    reach = model.diameter_m
    localizer = EllipseLocalizer([model])
    outcomes = []
    for scene in range(scenes):
        face = faces[scene % len(faces)]
        chosen = sorted(rng.permutation(len(face))[:VIEWS_TOGETHER])
        taken = [face[i] for i in chosen]
        localization = localizer.localize(taken, Workspace((-reach,) * 3, (reach,) * 3))
        outcomes.append(_outcome_of_taught(scene + 1, model, taken, localization))
        if report is not None:
            report(outcomes[-1])
    return tuple(outcomes)


class _Witness(EpisodeObserver):
    """Keeps what the picture of a scene needs."""

    def __init__(self, model: VisionModel) -> None:
        self.model = model
        self.views: list[View] = []

    def begin(self, cell: WorkCell, config: EpisodeConfig) -> None:  # noqa: ARG002
        self._cell = cell

    def looked(self, index: int, view: View) -> None:  # noqa: ARG002
        self.views.append(view.undistorted())

    def localized(self, localization: Localization, verdict: Verdict) -> None:
        self.estimates, self.owner = localization.estimates, verdict.owner
        self.truth = self._cell.truth()


def _outcome(number: int, record: EpisodeRecord, witness: _Witness) -> SceneOutcome:
    pieces, missed = [], []
    for piece in record.pieces:
        if not piece.in_bin:
            continue
        result = piece.results[LOCALIZER]
        if result.matched and result.errors is not None:
            errors = result.errors
            pieces.append(PieceOutcome(number, "hit", piece.visibility, errors.translation_mm, errors.tilt_deg))
        else:
            pieces.append(PieceOutcome(number, "miss", piece.visibility))
            missed.append(witness.truth[piece.index])
    owned = [owner is not None for owner in witness.owner]
    pieces += [PieceOutcome(number, "false alarm") for mine in owned if not mine]
    picture = _draw(witness.model, witness.views, witness.estimates, owned, missed)
    return SceneOutcome(number, tuple(pieces), picture)


def _outcome_of_taught(
    number: int, model: VisionModel, views: Sequence[View], localization: Localization
) -> SceneOutcome:
    """The part stands at the origin of its own frame; its salient circles stand for its surface."""
    truth = RigidTransform.identity()
    points = hull_points(np.vstack([f.circle.sample(36) for f in model.salient]))
    symmetry = Symmetry(model.symmetry_fold)
    errors = [pose_errors(e.T_world_part, truth, symmetry, points) for e in localization.estimates]
    good = [e.mssd_mm < match_limit_mm(model.diameter_m) for e in errors]
    best = int(np.argmin([e.mssd_mm for e in errors])) if any(good) else None
    pieces = [
        PieceOutcome(number, "hit", 1.0, e.translation_mm, e.tilt_deg)
        if i == best
        else PieceOutcome(number, "false alarm")
        for i, e in enumerate(errors)
    ]
    if best is None:
        pieces.insert(0, PieceOutcome(number, "miss", 1.0))
    owned = [i == best for i in range(len(errors))]
    missed = [truth] if best is None else []
    return SceneOutcome(number, tuple(pieces), _draw(model, views, localization.estimates, owned, missed))


def _draw(
    model: VisionModel,
    views: Sequence[View],
    estimates: Sequence[PoseEstimate],
    owned: Sequence[bool],
    missed: Sequence[RigidTransform],
) -> Image:
    """The first view with the model on every pose: green where right, red where false, yellow where missed."""
    view = views[0]
    contour = ModelContour.of(model, view.camera.fx / float(np.linalg.norm(view.T_world_camera.translation)))
    strokes = Strokes((), np.zeros((0, 3), np.uint8))
    for estimate, right in zip(estimates, owned, strict=True):
        drawn = model_strokes(contour, estimate.T_world_part.as_matrix(), view)
        strokes += drawn if right else plain_strokes(drawn.lines, FALSE_COLOUR)
    for pose in missed:
        strokes += plain_strokes(model_strokes(contour, pose.as_matrix(), view).lines, MISSED_COLOUR)
    picture = paint(enlarge(view.image, 1), strokes)
    for text, colour, at in _legend(sum(owned), len(owned) - sum(owned), len(missed)):
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, colour, 1, cv2.LINE_AA)
    return picture


def _legend(hits: int, false_alarms: int, misses: int) -> Iterator[tuple[str, Colour, tuple[int, int]]]:
    lines = (
        (f"{hits} found", (90, 255, 90), True),
        (f"{misses} missed", MISSED_COLOUR, misses > 0),
        (f"{false_alarms} false", FALSE_COLOUR, false_alarms > 0),
    )
    for row, (text, colour) in enumerate((text, colour) for text, colour, shown in lines if shown):
        yield text, colour, (10, _TEXT_HEIGHT_PX * (row + 1))
