"""Precision, recall, F and time of ``vision.detect_ellipses`` on drawn and rendered images.

Usage: ``python -m benchmark.detector.evaluate [--split tune|test] [--number N] [--only CATEGORY ...]
[--against NAME ...] [--out FILE]``. One-to-one matching, a pair counts where the filled ellipses overlap by more than
0.8 (intersection over union); one thread. ``--against`` runs public detectors on the same images; see ``public.py``
for what they need. Without OpenGL the rendered images are left out.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from benchmark.detector.drawings import CATEGORIES, RENDERED, SPLITS, Drawing, draw
from benchmark.detector.public import PUBLIC, Detector, public_detector
from benchmark.records.environment import environment_stamp
from benchmark.records.episode_record import SCHEMA, parse_object
from benchmark.strict_json import decode
from benchmark.world import gl
from vision import detect_ellipses
from vision.errors import ResourceError
from vision.geometry.ellipse import Ellipse, overlap

OURS = "focalpick"
MIN_OVERLAP = 0.8


@dataclass(frozen=True)
class Tally:
    """Counts over images.

    Attributes:
        true_positives: detections matched to ground truth.
        detections: all detections but those matched to tolerated ellipses.
        truths: all ground truth.
        seconds: time spent in the detector.
        images: number of images.
    """

    true_positives: int = 0
    detections: int = 0
    truths: int = 0
    seconds: float = 0.0
    images: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.true_positives + other.true_positives,
            self.detections + other.detections,
            self.truths + other.truths,
            self.seconds + other.seconds,
            self.images + other.images,
        )

    @property
    def precision(self) -> float:
        """Share of the detections that are true; 1 without detections."""
        return self.true_positives / self.detections if self.detections else 1.0

    @property
    def recall(self) -> float:
        """Share of the true ellipses that are detected; 1 without any."""
        return self.true_positives / self.truths if self.truths else 1.0

    @property
    def f_measure(self) -> float:
        """Harmonic mean of precision and recall."""
        total = self.precision + self.recall
        return 2 * self.precision * self.recall / total if total else 0.0


@dataclass(frozen=True)
class DetectorRecord:
    """An evaluation as a file keeps it.

    Attributes:
        split: of the drawings.
        number: of drawings of each category.
        environment: ``benchmark.records.environment.environment_stamp``.
        tallies: by detector and category.
    """

    split: str
    number: int
    environment: dict[str, str]
    tallies: dict[str, dict[str, Tally]]

    @classmethod
    def read(cls, path: Path) -> DetectorRecord:
        """From what :meth:`write` has written.

        Raises:
            FileFormatError: it is corrupt.
        """
        return decode(cls, parse_object(path.read_text(encoding="utf-8"), str(path)), str(path))

    def write(self, path: Path) -> None:
        """As JSON."""
        path.write_text(f"{json.dumps({'schema': SCHEMA, **asdict(self)}, indent=1)}\n", encoding="utf-8")


def match(found: list[Ellipse], truths: list[Ellipse], min_overlap: float = MIN_OVERLAP) -> list[tuple[int, int]]:
    """One-to-one pairs (found, truth) that overlap by more than ``min_overlap``, as many as possible."""
    if not found or not truths:
        return []
    overlaps = np.array([[overlap(a, b) for b in truths] for a in found])
    valid = overlaps > min_overlap
    rows, columns = linear_sum_assignment(np.where(valid, -1.0 - overlaps, 0.0))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if valid[i, j]]


def judge(drawing: Drawing, geometric: NDArray[np.float64], seconds: float) -> Tally:
    """Count the hits of detections (N, 5) in one drawing."""
    found = [Ellipse.from_geometric(*row) for row in geometric]
    pairs = match(found, list(drawing.ellipses))
    rest = [e for k, e in enumerate(found) if k not in {i for i, _ in pairs}]
    tolerated = len(match(rest, list(drawing.tolerated)))
    return Tally(len(pairs), len(found) - tolerated, len(drawing.ellipses), seconds, 1)


def drawable(categories: Sequence[str]) -> tuple[str, ...]:
    """The categories that this machine can make; says so where it leaves out what is rendered."""
    if RENDERED in categories:
        try:
            gl.require_backend()
        except ResourceError as error:
            print(f"{RENDERED}: left out. {error}")
            return tuple(category for category in categories if category != RENDERED)
    return tuple(categories)


def evaluate(
    split: str, number: int, detectors: Mapping[str, Detector], categories: Sequence[str] = CATEGORIES
) -> dict[str, dict[str, Tally]]:
    """Tally per detector and category over the drawings 0 to ``number`` - 1 of a split."""
    for detect in detectors.values():
        detect(draw("tune", "complete", 0).image)  # compile first
    tallies = {name: dict.fromkeys(categories, Tally()) for name in detectors}
    for category in categories:
        for k in range(number):
            drawing = draw(split, category, k)
            for name, detect in detectors.items():
                start = time.perf_counter()
                geometric = detect(drawing.image)
                seconds = time.perf_counter() - start
                tallies[name][category] += judge(drawing, geometric, seconds)
    return tallies


def table(tallies: dict[str, Tally]) -> str:
    """The figures of one detector as text, one line per category and one for all."""
    lines = [f"{'category':14}{'images':>7}{'true':>6}{'P':>8}{'R':>8}{'F':>8}{'ms/image':>10}"]
    for name, t in [*tallies.items(), ("all", sum(tallies.values(), Tally()))]:
        rates = f"{t.precision:8.3f}{t.recall:8.3f}{t.f_measure:8.3f}"
        lines.append(f"{name:14}{t.images:7}{t.truths:6}{rates}{1e3 * t.seconds / max(t.images, 1):10.1f}")
    return "\n".join(lines)


def main() -> None:
    """Run the evaluation from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--split", choices=tuple(SPLITS), default="test", help="which drawings")
    parser.add_argument("--number", type=int, default=20, help="drawings per category")
    parser.add_argument("--only", nargs="+", choices=CATEGORIES, default=CATEGORIES, help="which categories")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the counts into this file, too")
    parser.add_argument("--against", nargs="+", choices=tuple(PUBLIC), default=[], help="public detectors to compare")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    try:
        detectors: dict[str, Detector] = {name: public_detector(name) for name in arguments.against}
    except ResourceError as error:
        parser.exit(2, f"{error}\n")
    categories = drawable(arguments.only)
    tallies = evaluate(arguments.split, arguments.number, {OURS: detect_ellipses, **detectors}, categories)
    if arguments.out is not None:
        drawn_by = gl.drawn_by() if RENDERED in categories else {}
        DetectorRecord(arguments.split, arguments.number, environment_stamp(drawn_by), tallies).write(arguments.out)
    for name in tallies:
        print(*([f"\n{name}"] if detectors else []), table(tallies[name]), sep="\n")


if __name__ == "__main__":
    main()
