"""How far two sweeps lie apart, on made-up records."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmark.cli import main
from benchmark.config import SweepConfig, episodes
from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, PieceRecord, PoseErrors, PoseOffset
from benchmark.records.store import RecordWriter
from benchmark.report.comparison import Spread, compare
from vision.errors import InputError

SMALL = PoseErrors(0.1, 0.1, 0.1, 0.1, 0.2)
MISSED = LocalizerResult(True, False)
CONFIG = SweepConfig(parts=("hub", "cover1"), scenes=2)
HUBS, COVERS, MORE_HUBS, _ = episodes(CONFIG)


def at(x_mm: float = 0.0, tilt_deg: float = 0.0) -> LocalizerResult:
    """Matched, and so far from the true pose."""
    return LocalizerResult(True, True, SMALL, None, PoseOffset((x_mm, 0.0, 0.0), (tilt_deg, 0.0, 0.0)))


def episode(*pieces: LocalizerResult, config=HUBS, **changes: object) -> EpisodeRecord:
    """One part's pieces, each as the localizer focal saw it."""
    records = tuple(
        PieceRecord(i, config.parts[0], 1.0, True, {"focal": result}, None) for i, result in enumerate(pieces)
    )
    record = EpisodeRecord(config.key, config.parts, config.scene, config.seed, config.config_hash, pieces=records)
    return replace(record, **changes)


def test_distances_are_those_between_the_two_estimates() -> None:
    first = [episode(at(0.10), at(0.20, 1.0)), episode(at(-0.30), config=MORE_HUBS)]
    second = [episode(at(0.11), at(0.20, 1.5)), episode(at(0.30), config=MORE_HUBS)]
    (hub,) = compare(first, second).comparisons
    assert (hub.part, hub.method, hub.both) == ("hub", "focal", 3)
    assert hub.position_mm is not None
    assert hub.rotation_deg is not None
    assert (hub.position_mm.median, hub.position_mm.largest) == pytest.approx((0.01, 0.60))
    assert (hub.rotation_deg.median, hub.rotation_deg.largest) == pytest.approx((0.0, 0.5))
    assert hub.far == hub.different == 2  # one in position, one in rotation


def test_rotations_are_compared_as_rotations() -> None:
    """Two vectors that nearly name a half turn, in opposite senses, name nearly the same rotation."""
    (hub,) = compare([episode(at(0, 179.99))], [episode(at(0, -179.99))]).comparisons
    assert hub.rotation_deg is not None
    assert hub.rotation_deg.largest == pytest.approx(0.02)
    assert hub.far == 0


def test_pieces_matched_in_one_sweep_only_differ() -> None:
    first = [episode(at(), at(), at(), MISSED, MISSED)]
    second = [episode(at(), MISSED, MISSED, at(), MISSED)]
    apart = compare(first, second)
    (hub,) = apart.comparisons
    assert (hub.both, hub.first_only, hub.second_only) == (1, 2, 1)
    assert (apart.matched, apart.different) == (4, 3)
    assert hub.position_mm == Spread(0.0, 0.0)


def test_nothing_is_measured_where_nothing_was_matched_twice() -> None:
    (hub,) = compare([episode(at())], [episode(MISSED)]).comparisons
    assert hub.position_mm is None
    assert hub.rotation_deg is None


def test_each_part_and_localizer_is_counted_by_itself() -> None:
    def both(config, focal: LocalizerResult, region: LocalizerResult) -> EpisodeRecord:
        record = episode(focal, config=config)
        return replace(record, pieces=(replace(record.pieces[0], results={"focal": focal, "focal-region": region}),))

    first = [both(HUBS, at(), at()), both(COVERS, at(), MISSED)]
    second = [both(HUBS, at(), at(1.0)), both(COVERS, MISSED, MISSED)]
    apart = compare(first, second)
    different = {(c.part, c.method): c.different for c in apart.comparisons}
    assert different == {
        ("hub", "focal"): 0,
        ("hub", "focal-region"): 1,
        ("cover1", "focal"): 1,
        ("cover1", "focal-region"): 0,
    }


def test_only_episodes_that_both_finished_are_compared() -> None:
    first = [episode(at()), episode(config=COVERS, error="out of memory"), episode(at(), config=MORE_HUBS)]
    second = [episode(at()), episode(at(), config=COVERS)]
    apart = compare(first, second)
    assert apart.episodes == 1
    assert apart.matched == 1


def test_other_episodes_of_the_same_names_are_not_compared() -> None:
    with pytest.raises(InputError, match="no episode that both finished"):
        compare([episode(at())], [episode(at(), config_hash="another")])


def test_records_of_before_poses_were_kept_are_refused() -> None:
    with pytest.raises(InputError, match="from before poses were kept"):
        compare([episode(at())], [episode(replace(at(), offset=None))])


def test_stamps_are_named_where_they_differ() -> None:
    first = [episode(at(), environment={"numpy": "2.4", "cpu": "AMD EPYC", "numba_cpu": "znver5"})]
    second = [episode(at(), environment={"numpy": "2.4", "cpu": "AMD EPYC", "blas": "OpenBLAS"})]
    assert compare(first, second).stamps == {"numba_cpu": ("znver5", ""), "blas": ("", "OpenBLAS")}


def written(directory: Path, *records: EpisodeRecord) -> str:
    with RecordWriter(directory, CONFIG) as writer:
        for record in records:
            writer.append(record)
    return str(directory)


@pytest.mark.parametrize(
    ("options", "code", "verdict"),
    [
        ([], 1, "too many"),
        (["--may-differ", "0.25"], 0, "the sweeps agree"),
        (["--may-differ", "0.24"], 1, "too many"),
    ],
)
def test_the_command_fails_when_too_many_poses_differ(tmp_path, capsys, options, code, verdict) -> None:
    here = written(tmp_path / "here", episode(at(), at(), at(), at(0.3), environment={"numba_cpu": "znver5"}))
    there = written(tmp_path / "there", episode(at(), at(), at(), at(0.0), environment={"numba_cpu": "generic"}))
    assert main(["compare", here, there, *options]) == code
    out = capsys.readouterr().out
    assert f"1 of 4 poses differ; {float((options or [0, 0.05])[1]):.1%} may: {verdict}" in out
    assert "0.300000" in out
    assert "znver5" in out


def test_the_command_fails_where_there_is_nothing_to_compare(tmp_path, capsys) -> None:
    here, there = (written(tmp_path / name, episode(MISSED)) for name in ("here", "there"))
    assert main(["compare", here, there]) == 1
    assert "nothing to compare" in capsys.readouterr().out


@pytest.mark.parametrize("share", ["-0.1", "1.5", "nan"])
def test_a_share_that_is_none_is_refused(tmp_path, capsys, share) -> None:
    assert main(["compare", str(tmp_path), str(tmp_path), "--may-differ", share]) == 2
    assert "expected a share from 0 to 1" in capsys.readouterr().err
