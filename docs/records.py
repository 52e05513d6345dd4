"""The records behind the documents' figures: `results/table1`, and for all others `docs/records`, packed."""

from __future__ import annotations

import shutil
from pathlib import Path

from benchmark.config import SweepConfig
from benchmark.detector.evaluate import OURS, DetectorRecord, Tally
from benchmark.records.store import pack_records, read_config, read_records
from benchmark.report.circle_errors import keep_taught, read_taught
from benchmark.report.grid import grids_as_markdown
from benchmark.report.study import Study, build_study
from benchmark.report.tables import Table, build_table
from benchmark.timing.vision_step import TimingRecord, timing_grids
from vision.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
RECORDS = {
    "table1": ROOT / "results" / "table1",
    **{name: ROOT / "docs" / "records" / name for name in ("shopfloor", "calibration", "teaching")},
    **{name: ROOT / "docs" / "records" / f"{name}.json" for name in ("detector", "timing")},
}
DETECTORS = {
    OURS: "`vision.detect_ellipses`",
    "edge_drawing": "`EdgeDrawing.detectEllipses`",
    "find_ellipses": "`findEllipses`",
}


def keep(name: str, source: Path) -> None:
    """Keep what a document will quote where the test of the documents finds it; a sweep has to be complete.

    Raises:
        InputError: something is missing or cannot be read or written.
    """
    target = RECORDS[name]
    if source.resolve() == target.resolve():
        return
    if target.suffix == ".json":
        target.parent.mkdir(exist_ok=True)
        shutil.copyfile(source, target)
        return
    config, _ = swept(source)
    if name == "table1":
        got, expected = str(source), f"{target.relative_to(ROOT)}, where readers look for it"
        raise InputError("records of Table 1", got=got, expected=expected)
    if config.models is not None or config.localizer != "focal":
        raise InputError(
            f"sweep {source}", got=f"localizer {config.localizer}", expected="focal, with its own models"
        )
    pack_records(source, target)
    if config.variants and all(variant.is_taught for variant in config.variants):
        keep_taught(read_taught(config, source), target)


def swept(directory: Path) -> tuple[SweepConfig, Table]:
    """A finished sweep from its directory, and what is reported about it.

    Raises:
        InputError: it is not finished, and a document is no place for provisional figures.
    """
    config, records = read_config(directory), read_records(directory)
    table = build_table(config, records)
    if table.recorded < table.planned or table.failed:
        got = f"{table.recorded} of {table.planned} episodes, {len(table.failed)} of them failed"
        raise InputError(f"sweep {directory}", got=got, expected="all of them")
    return config, table


def studied(directory: Path) -> Study:
    """A finished study from its directory."""
    config, _ = swept(directory)
    taught = read_taught(config, directory)
    return build_study(config, read_records(directory), taught.refused, taught.errors(config))


def detector_block(file: Path) -> str:
    """Precision, recall and F of our ellipse detector and of public ones, over all pictures and by their kind."""
    record = DetectorRecord.read(file)
    total = {name: sum(kinds.values(), Tally()) for name, kinds in record.tallies.items()}
    ours = total[OURS]
    rows = [
        f"| {DETECTORS[name]} | {t.precision:.3f} | {t.recall:.3f} | {t.f_measure:.3f} | "
        f"{1e3 * t.seconds / t.images:.1f} |"
        for name, t in total.items()
    ]
    head = f"Measured on the {record.split} split, {ours.images} pictures with {ours.truths} ellipses, one core:"
    overall = ["| Detector | Precision | Recall | F | ms per picture |", "| --- | --- | --- | --- | --- |", *rows]
    shown = list(total)
    kinds = [
        f"| Kind | {' | '.join(f'{DETECTORS[name]}: P, R, F' for name in shown)} |",
        "| --- " * (1 + len(shown)) + "|",
    ]
    empty = []
    for kind, tally in record.tallies[OURS].items():
        if not tally.truths:
            empty.append(kind)
            continue
        cells = (record.tallies[name][kind] for name in shown)
        rates = (f"{t.precision:.3f}, {t.recall:.3f}, {t.f_measure:.3f}" for t in cells)
        kinds.append(f"| {kind.replace('_', ' ')} | {' | '.join(rates)} |")
    false = []
    for kind in empty:
        counts = ", ".join(f"{DETECTORS[name]} {record.tallies[name][kind].detections}" for name in shown)
        false.append(
            f"Detections in {record.tallies[OURS][kind].images} pictures without an ellipse ({kind}): {counts}."
        )
    lists = ("\n".join(overall), "The kinds of picture differ:", "\n".join(kinds), *false)
    return "\n\n".join([head, *lists])


def timing_block(file: Path) -> str:
    """How long the vision step and the ellipse detector take, by stages."""
    return f"Measured:\n\n{grids_as_markdown(timing_grids(TimingRecord.read(file)), ())}"
