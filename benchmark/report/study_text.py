"""A ``Study`` for people: on the terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Console

from benchmark.config import Variant
from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE, Summary
from benchmark.report.grid import (
    NOTHING,
    Grid,
    grids_as_markdown,
    last_of_each,
    median,
    part_title,
    plus_minus,
    print_grids,
    rate_text,
    share_text,
)
from benchmark.report.study import CalibrationLimit, Crossing, CurvePoint, Study
from benchmark.report.table_text import remarks

TextOf = Callable[[Study, str, Variant], str]


def study_grids(study: Study) -> list[Grid]:
    """The curves as tables, and what follows from them."""
    if not study.is_calibration:
        return [_against_teaching(study, title, text) for title, text in _TEACHING_QUANTITIES]
    limits = study.calibration_limits
    return [_against_calibration(study), *([_limits(limits)] if limits else [])]


def print_study(study: Study, console: Console) -> None:
    """Print everything on a terminal or into a file."""
    print_grids(study_grids(study), _remarks(study), console)


def study_as_markdown(study: Study) -> str:
    """Everything as GitHub-flavoured Markdown."""
    return grids_as_markdown(study_grids(study), _remarks(study))


def _remarks(study: Study) -> list[str]:
    refused = [f"Could not be taught, and so found nothing: {name} ({why})" for name, why in study.refused.items()]
    return remarks(list(study.tables.values())) + refused


def _against_calibration(study: Study) -> Grid:
    points = [(part, point) for part in study.parts for point in study.curve(part, study.method)]
    titles = [part_title(part) for part, _ in points]
    rows = tuple(
        (
            title if i == 0 or titles[i - 1] != title else "",
            f"{point.variant.hand_eye_mm:g}",
            str(point.half_visible.n),
            rate_text(point.half_visible),
            str(point.visible.n),
            rate_text(point.visible),
            share_text(point.false_poses),
            *(
                text(point.errors[name], 2)
                for name in ("translation_mm", "rotation_deg")
                for text in (plus_minus, median)
            ),
        )
        for i, (title, (_, point)) in enumerate(zip(titles, points, strict=True))
    )
    return Grid(
        title=f"Matching and pose error against the hand-eye error: {study.method}",
        columns=(
            "Object",
            "Hand-eye (mm)",
            "n",
            f"≥ {HALF_VISIBLE:.0%} visible",
            "n ",
            f"≥ {BARELY_VISIBLE:.0%} visible",
            "False poses",
            "Transl. (mm)",
            "median",
            "Rotation (°)",
            "median",
        ),
        rows=rows,
        sections=last_of_each(titles),
        quiet=frozenset({"n", "n "}),
        note=f"Sensor {study.config.sensor}. Hand-eye: root mean square length; its angle goes with it, 0.2°/mm.\n"
        f"Errors are over matched pieces at least {BARELY_VISIBLE:.0%} visible.",
    )


def _limits(limits: list[CalibrationLimit]) -> Grid:
    titles = [part_title(limit.part) for limit in limits]
    rows = tuple(
        (
            title if i == 0 or titles[i - 1] != title else "",
            limit.method,
            f"{limit.published.translation_mm_mean:.1f}",
            _crossing(limit.translation),
            f"{limit.published.rotation_deg_mean:.1f}",
            _crossing(limit.rotation),
            _crossing(limit.both),
            NOTHING if limit.matched is None else f"{limit.matched:.0%}",
        )
        for i, (title, limit) in enumerate(zip(titles, limits, strict=True))
    )
    return Grid(
        title="Up to which hand-eye error the mean errors meet the paper's Table 1",
        columns=(
            "Object",
            "Extractor",
            "published (mm)",
            "met up to (mm)",
            "published (°)",
            "met up to (mm) ",
            "both up to (mm)",
            "matched there",
        ),
        rows=rows,
        sections=last_of_each(titles),
        quiet=frozenset({"published (mm)", "published (°)"}),
        note="Interpolated between the errors that were tried; > where the largest of them meets it too.\n"
        f"Focal is held to the better published row. Matched: of pieces at least {BARELY_VISIBLE:.0%} visible.",
    )


def _crossing(crossing: Crossing) -> str:
    if crossing.at is None:
        return "none"
    return f"> {crossing.at:g}" if crossing.is_beyond else f"{crossing.at:.2f}"


def _found(text: Callable[[CurvePoint], str]) -> TextOf:
    """A cell about the pieces that were found with the model of a variant."""

    def cell(study: Study, part: str, variant: Variant) -> str:
        (point,) = (point for point in study.curve(part, study.method) if point.variant == variant)
        return text(point)

    return cell


def _taught(quantity: str) -> TextOf:
    """A cell about the circles of a variant's model."""

    def cell(study: Study, part: str, variant: Variant) -> str:
        errors = study.circles.get((variant, part))
        return NOTHING if errors is None else _with_median(getattr(errors, quantity))

    return cell


def _with_median(errors: Summary) -> str:
    return f"{plus_minus(errors, 3)}, {median(errors, 3)}" if errors.n else NOTHING


_TEACHING_QUANTITIES: tuple[tuple[str, TextOf], ...] = (
    (f"Matching success, pieces at least {HALF_VISIBLE:.0%} visible", _found(lambda p: rate_text(p.half_visible))),
    (f"Matching success, pieces at least {BARELY_VISIBLE:.0%} visible", _found(lambda p: rate_text(p.visible))),
    ("False poses, of those reported", _found(lambda point: share_text(point.false_poses))),
    ("Translation error (mm), and its median", _found(lambda point: _with_median(point.errors["translation_mm"]))),
    ("Tilt error (°), and its median", _found(lambda point: _with_median(point.errors["tilt_deg"]))),
    ("Error of the taught circles' centres (mm), and its median", _taught("centre_mm")),
    ("Error of the taught circles' radii (mm), and its median", _taught("radius_mm")),
)


def _against_teaching(study: Study, title: str, text: TextOf) -> Grid:
    """One quantity: a row for each click error, a column for each number of views."""
    variants = {(v.click_sigma_px or 0.0, v.taught_views or 0): v for v in study.tables}
    clicks, views = sorted({click for click, _ in variants}), sorted({n for _, n in variants})
    rows = []
    for part in study.parts:
        for click in clicks:
            given = [variants.get((click, n)) for n in views]
            cells = [NOTHING if variant is None else text(study, part, variant) for variant in given]
            rows.append((part_title(part) if click == clicks[0] else "", f"{click:g}", *cells))
    labels = [part for part in study.parts for _ in clicks]
    columns = ("Object", "Clicks (px)", *(f"{n} views" for n in views))
    return Grid(f"{title}, against how the parts were taught", columns, tuple(rows), sections=last_of_each(labels))
