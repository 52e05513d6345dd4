"""The figures in the documents are those of the records."""

from __future__ import annotations

import gzip
import re
from dataclasses import replace

import pytest

from benchmark.config import PRESETS, SweepConfig, episodes
from benchmark.detector.evaluate import DetectorRecord, Tally
from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, NormalizedError, PieceRecord, PoseErrors
from benchmark.records.store import RecordWriter, read_config, read_records
from benchmark.report.tables import build_table
from benchmark.timing.vision_step import STAGES, TimingRecord
from docs.fill import BLOCKS, NOT_MEASURED, README, TUNED, TUNING, between_markers, sensor_block
from docs.records import RECORDS, ROOT, detector_block, keep, timing_block
from vision.errors import FileFormatError, InputError

CONFIG = SweepConfig(parts=("hub",), scenes=1, pieces=3, most_pieces=5, sensor="shopfloor")


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_a_documents_figures_are_those_of_the_records_in_the_repository(block):
    """Where there are no records, there are no figures."""
    document, record = block.document.read_text(encoding="utf-8"), RECORDS[block.record]
    text = block.text(record) if record.exists() else NOT_MEASURED
    assert between_markers(document, block.name, text) == document


def test_every_table_of_measured_figures_stands_between_markers():
    for document in (README, *sorted((ROOT / "docs").glob("*.md"))):
        text = document.read_text(encoding="utf-8")
        names = re.findall(r"<!-- ([a-z0-9_-]+) -->", text)
        mine = {block.name for block in BLOCKS if block.document == document} | (
            set(TUNED) if document == TUNING else set()
        )
        assert set(names) == mine
        for name in names:
            text = between_markers(text, name, "")
        rows = [line for line in text.splitlines() if line.startswith("|")]
        assert not [row for row in rows if re.search(r" ± |\d ?% \(|\| [\d.]+ \|", row)]


def test_records_are_of_the_preset_that_the_document_names():
    for name, path in RECORDS.items():
        if name in PRESETS and path.exists() and name != "table1":  # benchmark/test_config.py is about that one
            config = read_config(path)
            assert config == replace(PRESETS[name], workers=config.workers)


def swept_into(directory, config):
    """Records of a sweep in which every piece was found."""
    found = LocalizerResult(True, True, PoseErrors(0.5, 0.25, 0.125, 0.25, 1.0))
    with RecordWriter(directory, config) as writer:
        for plan in episodes(config):
            piece = PieceRecord(0, plan.parts[0], 0.9, True, {"focal": found})
            writer.append(
                EpisodeRecord(plan.key, plan.parts, plan.scene, plan.seed, plan.config_hash, pieces=(piece,))
            )


def test_kept_records_are_those_of_the_sweep_in_a_few_bytes(tmp_path, monkeypatch):
    source, target = tmp_path / "swept", tmp_path / "kept"
    monkeypatch.setitem(RECORDS, "shopfloor", target)
    swept_into(source, CONFIG)
    keep("shopfloor", source)
    assert (read_config(target), read_records(target)) == (read_config(source), read_records(source))
    assert {path.name for path in target.iterdir()} == {"sweep.json", "episodes.jsonl.gz"}
    swept_into(tmp_path / "unfinished", replace(CONFIG, scenes=2))
    (tmp_path / "unfinished" / "episodes.jsonl").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="got 0 of 2 episodes"):
        keep("shopfloor", tmp_path / "unfinished")


def test_packed_records_that_are_torn_are_told(tmp_path):
    (tmp_path / "episodes.jsonl.gz").write_bytes(gzip.compress(b"{}")[:-9])
    with pytest.raises(FileFormatError, match="expected compressed records"):
        read_records(tmp_path)


def test_the_detectors_table_adds_up_its_counts(tmp_path):
    tallies = {
        "focalpick": {"half": Tally(3, 4, 6, 0.03, 2), "clutter": Tally(0, 5, 0, 0.01, 2)},
        "edge_drawing": {"half": Tally(1, 2, 6, 0.01, 2), "clutter": Tally(0, 9, 0, 0.01, 2)},
    }
    DetectorRecord("test", 2, {}, tallies).write(tmp_path / "detector.json")
    block = detector_block(tmp_path / "detector.json")
    assert "4 pictures with 6 ellipses" in block
    assert "| `vision.detect_ellipses` | 0.333 | 0.500 | 0.400 | 10.0 |" in block
    assert "| half | 0.750, 0.500, 0.600 | 0.500, 0.167, 0.250 |" in block
    assert "(clutter): `vision.detect_ellipses` 5, `EdgeDrawing.detectEllipses` 9." in block


def test_times_come_back_from_their_file(tmp_path):
    stages = dict.fromkeys((*STAGES, "localize"), (0.01, 0.03))
    record = TimingRecord({"cpu": "x"}, {"hub": stages}, ())
    record.write(tmp_path / "timing.json")
    assert TimingRecord.read(tmp_path / "timing.json") == record
    assert "| Hub | 20.0 (28.0) |" in timing_block(tmp_path / "timing.json")


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
    base = EpisodeRecord(episode.key, ("hub",), 0, episode.seed, episode.config_hash)
    record = replace(base, pieces=pieces, false_positives={"focal": 1})
    block = sensor_block(CONFIG, build_table(CONFIG, [record]))
    assert block.startswith("Measured, 1 scenes of 3 to 5 pieces a part:")
    assert "Sensor shopfloor" in block
    (row,) = (line for line in block.splitlines() if line.startswith("| Hub"))
    assert [cell.strip() for cell in row.strip("|").split("|")] == [
        "Hub",
        "2 of 2: 100% (34% to 100%)",
        "2 of 3: 67% (21% to 94%)",
        "33.3% of 3",
        "0.50 ± 0.00",
        "0.50",
        "0.25 ± 0.00",
        "0.25",
        "0.12 ± 0.00",
        "0.12",
        "2 of 2: 100% (34% to 100%)",
    ]
