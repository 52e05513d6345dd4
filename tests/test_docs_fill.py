"""The figures in the documents are those of the records."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmark.config import SweepConfig
from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, NormalizedError, PieceRecord, PoseErrors
from benchmark.records.store import read_config, read_records
from benchmark.report.tables import build_table
from docs.fill import README, between_markers, sensor_block, table1_block
from vision.errors import InputError

RECORDED = Path(__file__).resolve().parents[1] / "results" / "table1"
CONFIG = SweepConfig(parts=("hub",), scenes=1)


def test_the_table_of_the_readme_is_that_of_the_records_beside_it():
    config = read_config(RECORDED)
    block = table1_block(build_table(config, read_records(RECORDED)), config.scenes, config.pieces, config.sensor)
    readme = README.read_text(encoding="utf-8")
    assert between_markers(readme, "table1", block) == readme


def test_only_what_stands_between_the_markers_is_replaced():
    document = "a\n<!-- x -->\nold\nolder\n<!-- /x -->\nb\n<!-- y -->\nc\n<!-- /y -->\n"
    filled = between_markers(document, "x", "new\n")
    assert filled == "a\n<!-- x -->\nnew\n<!-- /x -->\nb\n<!-- y -->\nc\n<!-- /y -->\n"
    assert between_markers(filled, "x", "new") == filled


@pytest.mark.parametrize(
    "document",
    ["", "<!-- x -->\n", "<!-- /x -->\n<!-- x -->\n", "<!-- x -->\n<!-- /x -->\n<!-- x -->\n<!-- /x -->\n"],
)
def test_markers_that_are_not_there_once_are_an_error(document):
    with pytest.raises(InputError, match="once each"):
        between_markers(document, "x", "text")


def test_a_sensor_has_its_rates_errors_and_coverage():
    hit = LocalizerResult(True, True, PoseErrors(0.5, 0.25, 0.125, 0.25, 1.0), NormalizedError(3.0, 6))
    miss = LocalizerResult(False, False)
    pieces = tuple(
        PieceRecord(i, "hub", visibility, True, {"focal": result})
        for i, (visibility, result) in enumerate([(0.9, hit), (0.8, hit), (0.3, miss)])
    )
    episode = CONFIG.episode("hub", 0)
    record = EpisodeRecord(episode.key, ("hub",), 0, episode.seed, episode.config_hash, pieces=pieces)
    block = sensor_block(build_table(CONFIG, [record]), 1, 3, "shopfloor")
    (row,) = (line for line in block.splitlines() if line.startswith("| Hub"))
    assert [cell.strip() for cell in row.strip("|").split("|")] == [
        "Hub",
        "2 of 2: 100% (34% to 100%)",
        "2 of 3: 67% (21% to 94%)",
        "0.50 ± 0.00",
        "0.25 ± 0.00",
        "0.12 ± 0.00",
        "2 of 2: 100% (34% to 100%)",
    ]
