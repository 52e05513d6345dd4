"""A vision model as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from vision.features import RegionAttributes
from vision.model.vision_model import CircleFeature, VisionModel

EXTRACTOR_TITLES = {"region": "region growing", "group": "edge grouping"}
NOTHING = "-"


def print_model(model: VisionModel, console: Console) -> None:
    """Print the tables: features, patterns, attributes of the regions, grasps and bore, thresholds.

    Args:
        model: the model.
        console: where to print.
    """
    fold = model.symmetry_fold
    turns = "every rotation looks the same" if fold is None else f"{fold} rotations look the same"
    console.print(Text(f"{model.part}: outline {1e3 * model.diameter_m:.1f} mm, {turns}", style="bold"))
    console.print()
    for table in (_features(model), _patterns(model), _attributes(model), _handling(model), _thresholds(model)):
        console.print(table)


def _features(model: VisionModel) -> RichTable:
    rows = [
        (
            f.name,
            f.role,
            "front" if f.circle.normal[2] > 0 else "back",
            f"{2e3 * f.circle.radius_m:.2f}",
            _millimetres(f.circle.centre),
            str(f.copies),
            EXTRACTOR_TITLES[f.extractor],
            f"{100 * f.support:.0f} %",
        )
        for f in (*model.salient, *model.supporting)
    ]
    columns = ("feature", "role", "seen from", "dia. mm", "centre mm", "copies", "extractor", "edges seen")
    return _table("Features", columns, rows)


def _patterns(model: VisionModel) -> RichTable:
    rows = [
        (
            p.name,
            "front" if p.normal[2] > 0 else "back",
            _range_of(1e3 * p.points[:, 2]),
            _range_of(1e3 * np.hypot(*p.points[:, :2].T)),
            str(len(p.points)),
        )
        for p in model.patterns
    ]
    columns = ("pattern", "seen from", "height mm", "distance from axis mm", "points")
    return _table("Patterns on the faces", columns, rows)


def _attributes(model: VisionModel) -> RichTable:
    names = [f.name for f in fields(RegionAttributes)]
    rows = [(f.name, *(_range(f, name) for name in names)) for f in model.features if f.attributes]
    return _table("Attributes of the regions inside", ("feature", *(n.replace("_", " ") for n in names)), rows)


def _handling(model: VisionModel) -> RichTable:
    rows: list[tuple[str, ...]] = [
        (g.name, g.kind, f"{1e3 * g.width_m:.1f}", _millimetres(g.T_part_tcp.translation), str(g.copies), NOTHING)
        for g in model.grasps
    ]
    if model.bore is not None:
        bore = model.bore
        where = _millimetres(bore.T_part_bore.translation)
        rows.append(("bore", "bore", f"{1e3 * bore.diameter_m:.1f}", where, "1", f"{1e3 * bore.depth_m:.1f}"))
    columns = ("grasp", "kind", "width mm", "centre mm", "copies", "depth mm")
    return _table("Grasp coordinates and bore", columns, rows)


def _thresholds(model: VisionModel) -> RichTable:
    values = model.thresholds
    own = type(values)()
    rows = [
        (f.name.replace("_", " "), f"{getattr(values, f.name):g}", f"{getattr(own, f.name):g}")
        for f in fields(values)
    ]
    return _table("Thresholds of the extractors", ("threshold", "model", "default"), rows)


def _range(feature: CircleFeature, name: str) -> str:
    found = dict(feature.attributes).get(name)
    if found is None:
        return NOTHING
    digits = 0 if found.high >= 100 else 2
    return f"{found.low:.{digits}f} .. {found.high:.{digits}f}"


def _range_of(values: np.ndarray) -> str:
    low, high = (f"{v + 0.0:.2f}" for v in np.round([values.min(), values.max()], 2))
    return low if low == high else f"{low} .. {high}"


def _millimetres(point: np.ndarray) -> str:
    return " ".join(f"{v + 0.0:.2f}" for v in np.round(1e3 * point, 2))


def _table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> RichTable:
    table = RichTable(
        title=Text(title, style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        header_style="bold",
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for i, column in enumerate(columns):
        words = all(not row[i].lstrip("-")[:1].isdigit() for row in rows)
        table.add_column(column, justify="left" if words else "right")
    for row in rows:
        table.add_row(*row)
    return table
