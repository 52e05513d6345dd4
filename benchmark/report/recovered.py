"""How often one extractor recovers a salient feature that the other lost: the paper's claim, counted by pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmark.records.episode_record import EpisodeRecord, LocalizerResult
from benchmark.report.rate import Rate

Trio = tuple[LocalizerResult, LocalizerResult, LocalizerResult]


@dataclass(frozen=True)
class Recovered:
    """How many pieces the focal localizer matched, by what each of its two extractors had of them.

    Attributes:
        part: name of the pieces' type.
        min_visibility: pieces less visible are left out.
        extraction: by who had extracted the salient ellipse: ``both``, ``region_lost`` (edge grouping alone had it)
            and ``group_lost`` (region growing alone had it).
        matching: of the pieces that an extractor, alone, did not match: ``region_missed``, ``group_missed``, and
            ``both_missed``, which count in the other two as well.
    """

    part: str
    min_visibility: float
    extraction: dict[str, Rate]
    matching: dict[str, Rate]


def recovered(records: Sequence[EpisodeRecord], part: str, min_visibility: float) -> Recovered:
    """Count over the pieces that focal and both of its extractors alone were judged on.

    Args:
        records: episodes that did not fail.
        part: name of the pieces' type.
        min_visibility: pieces less visible are left out, and so are those that bounced out of the bin.
    """
    judged = [trio for record in records for trio in _trios(record, part, min_visibility)]
    return Recovered(
        part,
        min_visibility,
        extraction={
            "both": Rate.of([focal.matched for r, g, focal in judged if r.extracted and g.extracted]),
            "region_lost": Rate.of([focal.matched for r, g, focal in judged if g.extracted and not r.extracted]),
            "group_lost": Rate.of([focal.matched for r, g, focal in judged if r.extracted and not g.extracted]),
        },
        matching={
            "region_missed": Rate.of([focal.matched for r, _, focal in judged if not r.matched]),
            "group_missed": Rate.of([focal.matched for _, g, focal in judged if not g.matched]),
            "both_missed": Rate.of([focal.matched for r, g, focal in judged if not (r.matched or g.matched)]),
        },
    )


def _trios(record: EpisodeRecord, part: str, min_visibility: float) -> list[Trio]:
    """The results of region growing, edge grouping and focal for each piece that counts."""
    counted = [p.results for p in record.pieces if p.part == part and p.in_bin and p.visibility >= min_visibility]
    names = ("focal-region", "focal-group", "focal")
    return [(r["focal-region"], r["focal-group"], r["focal"]) for r in counted if all(name in r for name in names)]
