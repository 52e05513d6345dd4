"""Writes the measured figures into the documents: `python -m docs.fill --table1 results/table1 ...`.

Each option names a record (a finished sweep, or a file), keeps it in docs/records, and rewrites what stands between
the markers that belong to it, `<!-- name -->` and `<!-- /name -->`; what is not named stays as it is. The studies'
figures in docs/images are drawn again too.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmark.config import SweepConfig
from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE, Summary
from benchmark.report.extractors_text import margin_grids, recovered_grids
from benchmark.report.grid import (
    NOTHING,
    Grid,
    grids_as_markdown,
    median,
    part_title,
    plus_minus,
    rate_text,
    share_text,
)
from benchmark.report.rate import Rate
from benchmark.report.study import Study
from benchmark.report.study_figures import save_study_figures
from benchmark.report.study_text import study_as_markdown
from benchmark.report.table_text import coverage_grid
from benchmark.report.tables import AccuracyRow, Table
from docs.records import RECORDS, ROOT, detector_block, keep, studied, swept, timing_block
from vision.errors import FocalpickError, InputError

README = ROOT / "README.md"
ACCURACY = ROOT / "docs" / "accuracy.md"
TUNING = ROOT / "docs" / "tuning.md"
TUNED = ("ellipse_score", "edge_sigmas", "confirmation", "pose_probability")
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


def table1_block(config: SweepConfig, table: Table) -> str:
    """What the README says first: Table 1, and what the three localizers match."""
    scope = (
        f"Table 1, {config.scenes} scenes of {config.pieces_in_words} pieces for each part, sensor `{config.sensor}`"
    )
    blocks = [
        f"{scope} (mean ± standard deviation over the matched pieces at least {_share(BARELY_VISIBLE)}\nvisible):",
        _untitled(_published(table)),
        "Our localizer (`focal`), the paper's system (`paper`) and its predecessor (`previous`):",
        _untitled(_focal(table)),
        "In brackets: 95 % Wilson interval. The records are in `results/table1`; `focalpick table results/table1` "
        "prints all of it.",
    ]
    return "\n\n".join(blocks)


def sensor_block(config: SweepConfig, table: Table) -> str:
    """The figures of the focal localizer with one sensor."""
    rows = []
    for part in table.parts:
        half, any_ = (table.find_success(part, "focal", "matching", at).rate for at in (HALF_VISIBLE, BARELY_VISIBLE))
        row = table.find_accuracy(part, "focal", BARELY_VISIBLE)
        errors = [
            text(row.errors[name], 2)
            for name in ("translation_mm", "tilt_deg", "inplane_deg")
            for text in (plus_minus, median)
        ]
        false_poses = share_text(table.find_false_poses(part, "focal"))
        rows.append((part_title(part), _of(half), _of(any_), false_poses, *errors, _of(row.coverage)))
    grid = Grid(
        title=f"Sensor {config.sensor}: matching, pose error and covariance of focal",
        columns=(
            "Object",
            f"matched, ≥ {HALF_VISIBLE:.0%} visible",
            f"matched, ≥ {BARELY_VISIBLE:.0%} visible",
            "false poses",
            "Translation (mm)",
            "median",
            "Tilt (°)",
            "median",
            "In-plane (°)",
            "median",
            "inside the 95% ellipsoid",
        ),
        rows=tuple(rows),
        note="In brackets: 95 % Wilson interval. Errors and ellipsoids are those of matched pieces at least\n"
        f"{BARELY_VISIBLE:.0%} visible.",
    )
    return f"{_measured(config)}\n\n{grids_as_markdown([grid], ())}"


def study_block(study: Study, picture: str) -> str:
    """The tables of a study, above its picture."""
    return f"{_measured(study.config)}\n\n{study_as_markdown(study)}\n![{PICTURES[picture]}](images/{picture})"


def draw_study(study: Study, picture: str) -> None:
    """Draw the picture of a study anew into docs/images."""
    with tempfile.TemporaryDirectory() as drawn:
        (path,) = save_study_figures(study, Path(drawn))
        (IMAGES / picture).write_bytes(path.read_bytes())


@dataclass(frozen=True)
class Block:
    """What stands between two markers of a document.

    Attributes:
        name: of the markers.
        document: in which they are.
        record: key of ``docs.records.RECORDS``: where the figures come from.
        text: makes the block from the record's path, and from nothing else.
    """

    name: str
    document: Path
    record: str
    text: Callable[[Path], str]


def _of_table1(grids: Callable[[Table], list[Grid]]) -> Callable[[Path], str]:
    return lambda path: f"Measured (`results/table1`):\n\n{grids_as_markdown(grids(swept(path)[1]), ())}"


BLOCKS = (
    Block("table1", README, "table1", lambda path: table1_block(*swept(path))),
    Block("margins", ACCURACY, "table1", _of_table1(lambda table: margin_grids(table.margins))),
    Block("made-good", ACCURACY, "table1", _of_table1(lambda table: recovered_grids(table.recovered))),
    Block("coverage", ACCURACY, "table1", _of_table1(lambda table: [coverage_grid(table)])),
    Block("shopfloor", ACCURACY, "shopfloor", lambda path: sensor_block(*swept(path))),
    Block("calibration", ACCURACY, "calibration", lambda path: study_block(studied(path), "calibration.png")),
    Block("teaching", ACCURACY, "teaching", lambda path: study_block(studied(path), "teaching-study.png")),
    Block("detector", ACCURACY, "detector", detector_block),
    Block("timing", ACCURACY, "timing", timing_block),
)
STUDIES = {"calibration": "calibration.png", "teaching": "teaching-study.png"}
NOT_MEASURED = "Not measured with this version yet."
"""Stands in a block without records: no figure without them."""


def fill(record: str, source: Path) -> None:
    """Keep a record and write what comes from it into the documents."""
    keep(record, source)
    if record in STUDIES:
        draw_study(studied(RECORDS[record]), STUDIES[record])
    for block in BLOCKS:
        if block.record == record:
            _put(block.document, block.name, block.text(RECORDS[record]))


def fill_tuning(directory: Path) -> None:
    """What the scripts of `benchmark/tuning` printed with `--format md`: NAME.md for each of them."""
    for name in TUNED:
        _put(TUNING, name, f"Measured:\n\n{(directory / f'{name}.md').read_text(encoding='utf-8')}")


def _measured(config: SweepConfig) -> str:
    return f"Measured, {config.scenes} scenes of {config.pieces_in_words} pieces a part:"


def _published(table: Table) -> Grid:
    rows, last = [], None
    for row in table.table1:
        label = "" if row.part == last else SIZED.get(row.part, row.part)
        rows.append((label, row.method, str(row.n), *_beside_published(row)))
        last = row.part
    errors = ("Translation (mm)", "median", "published", "Rotation (°)", "median", "published")
    columns = ("Object", "Method", "n", *errors)
    return Grid("", columns, tuple(rows))


def _beside_published(row: AccuracyRow) -> list[str]:
    cells = []
    for quantity in ("translation_mm", "rotation_deg"):
        published = NOTHING
        if row.published is not None:
            mean, spread = (getattr(row.published, f"{quantity}_{name}") for name in ("mean", "std"))
            published = f"{mean} ± {spread}"
        cells += [plus_minus(row.errors[quantity], 2), median(row.errors[quantity], 2), published]
    return cells


def _focal(table: Table) -> Grid:
    rows = []
    for part in table.parts:
        methods = ("previous", "paper", "focal")
        rows_of = {name: table.find_success(part, name, "matching", BARELY_VISIBLE) for name in methods}
        published = rows_of["paper"].published
        errors = table.find_accuracy(part, "focal", BARELY_VISIBLE).errors
        picks = table.picks[part]
        rows.append(
            (
                SIZED.get(part, part),
                _percent(table.find_success(part, "focal", "matching", HALF_VISIBLE).rate),
                *(_percent(rows_of[name].rate) for name in reversed(methods)),
                NOTHING if published is None else _share(published),
                share_text(table.find_false_poses(part, "focal")),
                *(f"{text(errors['translation_mm'])} mm, {text(errors['tilt_deg'])}°" for text in (_mean, _median)),
                f"{picks.successes} of {picks.n}",
            )
        )
    columns = (
        "Object",
        "matched, focal, ≥ 50 % visible",
        "focal, ≥ 10 % visible",
        "paper",
        "previous",
        "paper, published, all pieces",
        "false poses",
        "mean error of the final pose",
        "median",
        "first picks",
    )
    return Grid("", columns, tuple(rows))


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _percent(rate: Rate) -> str:
    if rate.rate is None or rate.low is None or rate.high is None:
        return NOTHING
    return f"{_share(rate.rate)} ({100 * rate.low:.0f} to {100 * rate.high:.0f})"


def _mean(summary: Summary) -> str:
    return NOTHING if summary.mean is None else f"{summary.mean:.2f}"


def _median(summary: Summary) -> str:
    return median(summary, 2)


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
    parser = argparse.ArgumentParser(
        description="Keep records in docs/records and write their figures into documents."
    )
    for name, path in RECORDS.items():
        parser.add_argument(f"--{name}", type=Path, metavar="FILE" if path.suffix else "DIR")
    parser.add_argument("--tuning", type=Path, metavar="DIR", help=(fill_tuning.__doc__ or "").partition("\n")[0])
    for name, source in vars(parser.parse_args()).items():
        if source is not None:
            try:
                fill_tuning(source) if name == "tuning" else fill(name, source)
            except FocalpickError as error:
                raise SystemExit(str(error)) from None


if __name__ == "__main__":
    main()
