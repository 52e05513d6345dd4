"""Writes the measured figures into the documents: `python -m docs.fill --table1 results/table1 ...`.

Each option names a finished sweep and rewrites what stands between the markers that belong to it, `<!-- name -->` and
`<!-- /name -->`; what is not named stays as it is. The studies' figures in docs/images are drawn again too.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE
from benchmark.records.store import read_config, read_records
from benchmark.report.circle_errors import study_circles
from benchmark.report.extractors_text import margin_grids, recovered_grids
from benchmark.report.grid import NOTHING, Grid, grids_as_markdown, part_title, plus_minus, rate_text
from benchmark.report.rate import Rate
from benchmark.report.study import build_study
from benchmark.report.study_figures import save_study_figures
from benchmark.report.study_text import study_as_markdown
from benchmark.report.table_text import coverage_grid
from benchmark.report.tables import AccuracyRow, Table, build_table
from benchmark.study.taught_models import refusals
from vision.errors import FocalpickError, InputError

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
ACCURACY = ROOT / "docs" / "accuracy.md"
TUNING = ROOT / "docs" / "tuning.md"
IMAGES = ROOT / "docs" / "images"

PICTURES = {
    "calibration.png": "Matching success and pose errors against the hand-eye error",
    "teaching-study.png": "Matching success, pose errors and errors of the taught circles against the click error",
}
SIZED = {"hub": "Hub, 240 mm", "cover1": "Alternator cover 1, 30 mm", "cover2": "Alternator cover 2, 65 mm"}


def between_markers(document: str, name: str, text: str) -> str:
    """A document with other text between two markers.

    Raises:
        InputError: the document has not each of the two markers once, in this order.
    """
    first, last = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    before, opening, rest = document.partition(first)
    _, closing, after = rest.partition(last)
    if not (opening and closing) or first in rest or last in before + after:
        raise InputError("document", got="something else", expected=f"{first.strip()} and {last}, once each")
    return f"{before}{first}{text.strip()}\n{last}{after}"


def table1_block(table: Table, scenes: int, pieces: int, sensor: str) -> str:
    """What the README says first: Table 1, and both extractors together against region growing alone."""
    scope = f"Table 1, {scenes} scenes of {pieces} pieces for each part, sensor `{sensor}`"
    blocks = [
        f"{scope} (mean ± standard deviation over the matched pieces at least {_share(BARELY_VISIBLE)}\nvisible):",
        _untitled(_published(table)),
        "Both extractors together (`focal`) against region growing alone (`focal-region`):",
        _untitled(_focal(table)),
        "In brackets: 95 % Wilson interval. The records are in `results/table1`; `focalpick table results/table1` "
        "prints all of it.",
    ]
    return "\n\n".join(blocks)


def sensor_block(table: Table, scenes: int, pieces: int, sensor: str) -> str:
    """The figures of the focal localizer with one sensor."""
    rows = []
    for part in table.parts:
        half, any_ = (table.find_success(part, "focal", "matching", at).rate for at in (HALF_VISIBLE, BARELY_VISIBLE))
        row = table.find_accuracy(part, "focal", BARELY_VISIBLE)
        errors = [plus_minus(row.errors[name], 2) for name in ("translation_mm", "tilt_deg", "inplane_deg")]
        rows.append((part_title(part), _of(half), _of(any_), *errors, _of(row.coverage)))
    grid = Grid(
        title=f"Sensor {sensor}: matching, pose error and covariance of focal",
        columns=(
            "Object",
            f"matched, ≥ {HALF_VISIBLE:.0%} visible",
            f"matched, ≥ {BARELY_VISIBLE:.0%} visible",
            "Translation (mm)",
            "Tilt (°)",
            "In-plane (°)",
            "inside the 95% ellipsoid",
        ),
        rows=tuple(rows),
        note="In brackets: 95 % Wilson interval. Errors and ellipsoids are those of matched pieces at least\n"
        f"{BARELY_VISIBLE:.0%} visible.",
    )
    return f"Measured, {scenes} scenes of {pieces} pieces a part:\n\n{grids_as_markdown([grid], ())}"


def study_block(directory: Path, picture: str) -> str:
    """The tables of a study, above its picture, which is drawn anew into docs/images."""
    config = read_config(directory)
    study = build_study(config, read_records(directory), refusals(directory), study_circles(config, directory))
    for table in study.tables.values():
        _check_complete(table, directory)
    with tempfile.TemporaryDirectory() as drawn:
        (path,) = save_study_figures(study, Path(drawn))
        (IMAGES / picture).write_bytes(path.read_bytes())
    head = f"Measured, {config.scenes} scenes of {config.pieces} pieces a part:"
    return f"{head}\n\n{study_as_markdown(study)}\n![{PICTURES[picture]}](images/{picture})"


def fill_table1(directory: Path) -> None:
    """All that comes from the benchmark's main sweep."""
    config, table = read_config(directory), _table(directory)
    measured = "Measured (`results/table1`):\n\n{}".format
    _put(README, "table1", table1_block(table, config.scenes, config.pieces, config.sensor))
    _put(ACCURACY, "margins", measured(grids_as_markdown(margin_grids(table.margins), ())))
    _put(ACCURACY, "made-good", measured(grids_as_markdown(recovered_grids(table.recovered), ())))
    _put(ACCURACY, "coverage", measured(grids_as_markdown([coverage_grid(table)], ())))


def fill_shopfloor(directory: Path) -> None:
    """The same figures with the sensor of a shop floor."""
    config = read_config(directory)
    _put(ACCURACY, "shopfloor", sensor_block(_table(directory), config.scenes, config.pieces, config.sensor))


def fill_calibration(directory: Path) -> None:
    """The study of the hand-eye error."""
    _put(ACCURACY, "calibration", study_block(directory, "calibration.png"))


def fill_teaching(directory: Path) -> None:
    """The study of the clicks."""
    _put(ACCURACY, "teaching", study_block(directory, "teaching-study.png"))


def fill_timing(file: Path) -> None:
    """What `python -m benchmark.timing.vision_step --format md` printed."""
    _put(ACCURACY, "timing", f"Measured:\n\n{file.read_text(encoding='utf-8')}")


def fill_tuning(directory: Path) -> None:
    """What the scripts of `benchmark/tuning` printed with `--format md`: NAME.md for each of them."""
    for name in ("ellipse_score", "edge_sigmas", "confirmation"):
        _put(TUNING, name, f"Measured:\n\n{(directory / f'{name}.md').read_text(encoding='utf-8')}")


FILLS: dict[str, Callable[[Path], None]] = {
    "table1": fill_table1,
    "shopfloor": fill_shopfloor,
    "calibration": fill_calibration,
    "teaching": fill_teaching,
    "timing": fill_timing,
    "tuning": fill_tuning,
}


def _table(directory: Path) -> Table:
    table = build_table(read_config(directory), read_records(directory))
    _check_complete(table, directory)
    return table


def _check_complete(table: Table, directory: Path) -> None:
    """A document is no place for provisional figures."""
    if table.recorded < table.planned or table.failed:
        got = f"{table.recorded} of {table.planned} episodes, {len(table.failed)} of them failed"
        raise InputError(f"sweep {directory}", got=got, expected="all of them")


def _published(table: Table) -> Grid:
    rows, last = [], None
    for row in table.table1:
        label = "" if row.part == last else SIZED.get(row.part, row.part)
        rows.append((label, f"{row.method.removeprefix('focal-')}-match", str(row.n), *_beside_published(row)))
        last = row.part
    columns = ("Object", "Extractor", "n", "Translation (mm)", "published", "Rotation (°)", "published")
    return Grid("", columns, tuple(rows))


def _beside_published(row: AccuracyRow) -> list[str]:
    cells = []
    for quantity in ("translation_mm", "rotation_deg"):
        published = NOTHING
        if row.published is not None:
            mean, spread = (getattr(row.published, f"{quantity}_{name}") for name in ("mean", "std"))
            published = f"{mean} ± {spread}"
        cells += [plus_minus(row.errors[quantity], 2), published]
    return cells


def _focal(table: Table) -> Grid:
    rows = []
    for part in table.parts:
        focal, region = (table.find_success(part, m, "matching", HALF_VISIBLE) for m in ("focal", "focal-region"))
        errors = table.find_accuracy(part, "focal", BARELY_VISIBLE).errors
        picks = table.picks[part]
        rows.append(
            (
                SIZED.get(part, part),
                _percent(focal.rate),
                _percent(region.rate),
                _percent(table.find_success(part, "focal", "matching", BARELY_VISIBLE).rate),
                NOTHING if focal.published is None else _share(focal.published),
                f"{errors['translation_mm'].mean:.2f} mm, {errors['tilt_deg'].mean:.2f}°",
                f"{picks.successes} of {picks.n}",
            )
        )
    columns = (
        "Object",
        "matched, focal, ≥ 50 % visible",
        "region growing alone",
        "focal, ≥ 10 % visible",
        "published, all pieces",
        "error of the final pose",
        "first picks",
    )
    return Grid("", columns, tuple(rows))


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _percent(rate: Rate) -> str:
    if rate.rate is None or rate.low is None or rate.high is None:
        return NOTHING
    return f"{_share(rate.rate)} ({100 * rate.low:.0f} to {100 * rate.high:.0f})"


def _of(rate: Rate) -> str:
    return f"{rate.successes} of {rate.n}: {rate_text(rate).strip()}" if rate.n else NOTHING


def _untitled(grid: Grid) -> str:
    """The table of a grid alone."""
    return grids_as_markdown([grid], ()).partition("\n\n")[2].strip()


def _put(path: Path, name: str, text: str) -> None:
    path.write_text(between_markers(path.read_text(encoding="utf-8"), name, text), encoding="utf-8")
    print(f"{path.relative_to(ROOT)}: {name}")


def main() -> None:
    """Fill in what the options name, from the command line."""
    parser = argparse.ArgumentParser(description="Write measured figures into README.md and docs/accuracy.md.")
    for name in FILLS:
        place = "FILE" if name == "timing" else "DIR"
        parser.add_argument(
            f"--{name}", type=Path, metavar=place, help=(FILLS[name].__doc__ or "").partition("\n")[0]
        )
    for name, source in vars(parser.parse_args()).items():
        if source is not None:
            try:
                FILLS[name](source)
            except FocalpickError as error:
                raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
