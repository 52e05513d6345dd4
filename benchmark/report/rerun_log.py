"""Records an episode for the rerun viewer: the cell in motion, the pictures with what was found, and the outcome."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import rerun as rr
from scipy.spatial.transform import RigidTransform

from benchmark.config import EpisodeConfig
from benchmark.episodes.cells import workspace
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.episodes.evaluation import Verdict
from benchmark.localizers.registry import make_localizer
from benchmark.models import load_model
from benchmark.records.episode_record import AttemptRecord, EpisodeRecord, PieceRecord
from benchmark.report.rerun_blueprint import (
    CHARTS,
    ERRORS,
    EVENTS,
    LOCALIZED,
    OUTCOME,
    episode_blueprint,
    stage_entity,
    view_entity,
)
from benchmark.report.rerun_scene import STAGE, TIME, Motion, log_geometry
from benchmark.world.cell import WorkCell
from vision.drawing.explain import explain_view
from vision.drawing.strokes import (
    SALIENT_COLOUR,
    Colour,
    Image,
    Strokes,
    ellipse_strokes,
    fragment_strokes,
    model_strokes,
    region_strokes,
)
from vision.errors import InputError
from vision.extraction import Extraction
from vision.geometry.camera import View
from vision.localizer import EllipseLocalizer, Localization
from vision.model.contour import ModelContour
from vision.model.vision_model import VisionModel
from vision.pose.estimate import PoseEstimate

APPLICATION = "focalpick"
TRUTH_COLOUR: Colour = (255, 255, 255)
FALSE_COLOUR: Colour = (255, 70, 70)
_JPEG_QUALITY = 92
_LINE_PX = 0.7  # half the width
_OUTLINE_M_PER_DIAMETER = 0.006
_FRUSTUM_SHARE = 0.2  # of the distance to the bin


def record_episode(config: EpisodeConfig, path: Path) -> EpisodeRecord:
    """Run an episode and record it.

    Two recordings of one configuration on one machine hold the same data: neither wall times nor dates are in them.

    Args:
        config: what to run.
        path: the .rrd file to write.

    Raises:
        InputError: the file cannot be written, or an unknown part or localizer.
        ResourceError: something that the machine lacks.
    """
    name = f"{config.key}-{config.config_hash[:12]}"
    # The properties that rerun would send by itself hold the time of the recording.
    recording = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    try:
        recording.save(path)
    except (OSError, RuntimeError) as error:
        do = "Choose another --rrd."
        raise InputError(f"recording {path}", got=error, expected="a file that can be written", do=do) from None
    observer = RerunLog(recording)
    try:
        record = run_episode(config, observer)
        observer.finish(record)
    finally:
        recording.disconnect()
    return record


class RerunLog(EpisodeObserver):
    """Logs an episode as it happens; call `finish` with its record at the end."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        """Log to a recording, which stays the caller's to close."""
        self._recording = recording
        self._stage = 0
        self._events: list[tuple[str, float]] = []
        self._views: list[View] = []
        self._extractions: list[Extraction] = []

    def begin(self, cell: WorkCell, config: EpisodeConfig) -> None:
        """Log what does not change."""
        self._cell, self._config = cell, config
        self._motion = Motion(cell.model, cell.data)
        self._localizer = _explained(config)
        self._recording.send_blueprint(episode_blueprint(cell.config, config.views))
        self._recording.send_recording_name(f"{config.key}, seed {config.seed}")
        self._recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_geometry(self._recording, cell.model, cell.data)

    def step(self) -> None:
        """Sample the motion."""
        self._motion.sample(self._stage)

    def looked(self, index: int, view: View) -> None:
        """Log the picture, where the robot believes it was taken, and what the extractors make of it."""
        self._next_stage(f"{view.name} taken")
        flat = view.undistorted()
        self._views.append(flat)
        entity = view_entity(index)
        camera = flat.camera
        self._recording.log(
            entity,
            rr.Pinhole(
                image_from_camera=camera.matrix,
                resolution=(camera.width_px, camera.height_px),
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=_FRUSTUM_SHARE * self._cell.config.camera_distance_m,
            ),
            _transform(flat.T_world_camera),
        )
        self._recording.log(f"{entity}/image", _jpeg(flat.image))
        extraction = self._localizer.extraction(flat, workspace(self._cell.config))
        self._extractions.append(extraction)
        if extraction.segmentation is not None:
            self._draw(f"{entity}/regions", region_strokes(extraction.segmentation.regions))
        if extraction.grouping is not None:
            self._draw(f"{entity}/fragments", fragment_strokes(extraction.grouping))

    def localized(self, localization: Localization, verdict: Verdict) -> None:
        """Log ellipses and poses, the errors of these, and the panels of every stage."""
        self._next_stage(f"{len(localization.estimates)} poses estimated")
        for index, features in enumerate(localization.features):
            for extractor in ("region", "group"):
                mine = [feature for feature in features if feature.extractor == extractor]
                self._draw(f"{view_entity(index)}/ellipses/{extractor}", ellipse_strokes(mine))
        for index, view in enumerate(self._views):
            self._draw(f"{view_entity(index)}/models", self._superimposed(localization.estimates, view))
            self.draw_stages(index, view, self._extractions[index], localization.estimates, self._localizer.models)
        self._log_poses(localization.estimates, verdict)
        self._recording.log(ERRORS, _markdown(errors_text(verdict)))
        self._log_charts(verdict.pieces)

    def attempted(self, attempt: AttemptRecord) -> None:
        """Note how an attempt ended."""
        self._next_stage(f"{attempt.goal} {'succeeded' if attempt.succeeded else f'failed at {attempt.stage}'}")

    def finish(self, record: EpisodeRecord) -> None:
        """Log the motion, the outcome and the recording's properties."""
        self._motion.send(self._recording)
        self._recording.log(OUTCOME, _markdown(outcome_text(record, self._events)))
        properties = {"part": "+".join(record.parts), "seed": str(record.seed), "outcome": summary(record)}
        for name, value in properties.items():
            self._recording.send_property(name, rr.AnyValues(value=value))

    def _next_stage(self, event: str) -> None:
        self._stage += 1
        self._events.append((event, self._cell.data.time))
        self._recording.set_time(TIME, duration=self._cell.data.time)
        self._recording.set_time(STAGE, sequence=self._stage)
        self._recording.log(EVENTS, rr.TextLog(event, level=rr.TextLogLevel.INFO))

    def _draw(self, entity: str, strokes: Strokes) -> None:
        lines = rr.LineStrips2D(strokes.lines, colors=strokes.colours, radii=rr.Radius.ui_points(_LINE_PX))
        self._recording.log(entity, lines)

    def draw_stages(
        self,
        index: int,
        view: View,
        extraction: Extraction,
        estimates: Sequence[PoseEstimate],
        models: Sequence[VisionModel],
    ) -> None:
        """Log the panels that ``focalpick explain`` writes, for one of the views."""
        for panel in explain_view(view, extraction, estimates, models, zoom=1):
            self._recording.log(stage_entity(index, panel.name), _jpeg(panel.image))

    def _superimposed(self, estimates: tuple[PoseEstimate, ...], view: View) -> Strokes:
        strokes = Strokes((), np.zeros((0, 3), np.uint8))
        for estimate in estimates:
            T_world_part = estimate.T_world_part.as_matrix()
            strokes += model_strokes(self._contour(estimate.part), T_world_part, view)
        return strokes

    def _contour(self, part: str) -> ModelContour:
        model = load_model(part, self._config.models)
        return ModelContour.of(model, self._cell.camera.fx / self._cell.config.camera_distance_m)

    def _log_poses(self, estimates: tuple[PoseEstimate, ...], verdict: Verdict) -> None:
        """The taught circles at the true poses, in white, and at the estimated ones, which should hide them."""
        for index, (part, pose) in enumerate(zip(self._cell.config.piece_parts, self._cell.truth(), strict=True)):
            self._log_outline(f"{LOCALIZED}/truth/{index}", part, pose, TRUTH_COLOUR, 0.6, f"piece {index}")
        for index, (estimate, owner) in enumerate(zip(estimates, verdict.owner, strict=True)):
            colour, label = (FALSE_COLOUR, "no piece") if owner is None else (SALIENT_COLOUR, f"piece {owner}")
            pose = estimate.T_world_part
            self._log_outline(f"{LOCALIZED}/estimates/{index}", estimate.part, pose, colour, 1.0, label)

    def _log_outline(
        self, entity: str, part: str, T_world_part: RigidTransform, colour: Colour, thickness: float, label: str
    ) -> None:
        contour = self._contour(part)
        circles = [contour.points[contour.circle == number] for number in np.unique(contour.circle)]
        width_m = thickness * _OUTLINE_M_PER_DIAMETER * 2 * contour.reach_m
        lines = rr.LineStrips3D(
            [np.concatenate([circle, circle[:1]]) for circle in circles],
            colors=colour,
            radii=width_m / 2,
            labels=[label] * len(circles),
            show_labels=False,
        )
        self._recording.log(entity, lines, _transform(T_world_part))

    def _log_charts(self, pieces: tuple[PieceRecord, ...]) -> None:
        """Errors of the pieces that were found, by the number of the piece."""
        # The localizer's own result stands last, after those of its extractors alone.
        results = {piece.index: list(piece.results.values())[-1] for piece in pieces}
        errors = {index: result.errors for index, result in results.items() if result.errors}
        if not errors:
            return
        for name in ("translation_mm", "tilt_deg"):
            chart = rr.BarChart([getattr(e, name) for e in errors.values()], abscissa=list(errors))
            self._recording.log(f"{CHARTS}/{name}", chart)


def errors_text(verdict: Verdict) -> str:
    """A Markdown table with a row for each piece and a column for each method."""
    methods = list(verdict.pieces[0].results) if verdict.pieces else []
    rows = [["piece", "part", "visible", *methods], ["---"] * (3 + len(methods))]
    for piece in verdict.pieces:
        visible = f"{piece.visibility:.0%}" if piece.in_bin else "fell out"
        rows.append([str(piece.index), piece.part, visible, *(_result(piece, method) for method in methods)])
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    spare = ", ".join(f"{name} {count}" for name, count in verdict.false_positives.items())
    return "\n".join([*lines, "", f"Poses that belong to no piece: {spare}."])


def outcome_text(record: EpisodeRecord, events: Sequence[tuple[str, float]]) -> str:
    """What the episode was and how it ended, as Markdown.

    Args:
        record: of the episode.
        events: what happened, and at which simulated time in seconds.
    """
    picks = [_pick_text(pick.attempted, pick.succeeded, pick.failed_stage, pick.grasp) for pick in record.picks]
    return "\n".join(
        [
            f"## {'+'.join(record.parts)}, scene {record.scene}",
            f"**{summary(record)}**",
            "",
            *(f"- {text}" for text in picks),
            f"- Seed {record.seed}",
            "",
            "| simulated time | |",
            "| ---: | --- |",
            *(f"| {time_s:.2f} s | {event} |" for event, time_s in events),
        ]
    )


def summary(record: EpisodeRecord) -> str:
    """The outcome in one line."""
    found = sum(piece.failed_stage is None for piece in record.pieces)
    text = f"{found} of {len(record.pieces)} pieces localised"
    if not record.picks:
        return text
    return f"{text}, {sum(pick.succeeded for pick in record.picks)} of {len(record.picks)} picked"


def _pick_text(attempted: bool, succeeded: bool, failed_stage: str | None, grasp: str | None) -> str:
    if not attempted:
        return "No pick: nothing was localised"
    by = f" by {grasp}" if grasp else ""
    return f"Pick{by}: {'succeeded' if succeeded else f'failed at {failed_stage}'}"


def _result(piece: PieceRecord, method: str) -> str:
    result = piece.results[method]
    if result.errors is not None:
        return f"{result.errors.translation_mm:.2f} mm, {result.errors.tilt_deg:.2f}°"
    return "not matched" if result.extracted else "not found"


def _markdown(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def _transform(pose: RigidTransform) -> rr.Transform3D:
    return rr.Transform3D(translation=pose.translation, quaternion=pose.rotation.as_quat())


def _explained(config: EpisodeConfig) -> EllipseLocalizer:
    """The localizer whose stages are drawn: that of the episode; the focal one where that has no such stages."""
    models = [load_model(part, config.models) for part in config.parts]
    localizer = make_localizer(config.localizer, models, tuple)
    return localizer if isinstance(localizer, EllipseLocalizer) else EllipseLocalizer(models)


def _jpeg(image: Image) -> rr.EncodedImage:
    """A picture, compressed: recordings stay small, and a JPEG of this quality looks the same."""
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    return rr.EncodedImage(contents=encoded.tobytes(), media_type="image/jpeg")
