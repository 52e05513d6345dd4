"""What the terminal says of an episode."""

from __future__ import annotations

import pytest

from benchmark.commands.outcome import pick_lines
from benchmark.records.episode_record import EpisodeRecord, PickRecord


@pytest.mark.parametrize(
    ("pick", "line"),
    [
        (PickRecord(True, 2, True, None, "rim"), "Pick of piece 2 by rim: succeeded"),
        (PickRecord(True, None, False, "grip", "rim"), "Pick of a pose where no piece is by rim: failed at grip"),
        (PickRecord(False, None, False), "No pick: nothing was localised"),
        (
            PickRecord(True, None, False, "plan", None, {"too tilted": 20, "collision": 4}),
            "No pick: none of the grasps was possible (too tilted 20, collision 4)",
        ),
        (PickRecord(True, None, False, "plan"), "No pick: none of the grasps was possible"),  # of an older record
    ],
)
def test_a_pick_is_one_line(pick, line):
    record = EpisodeRecord("hub/000", ("hub",), 0, 7, "0" * 64, picks=(pick,))
    assert pick_lines(record) == [line]
