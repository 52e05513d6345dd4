"""Who is told what in an episode: a cell that nobody has to simulate, and a localizer that keeps what it is given."""

from __future__ import annotations

import sys
import types
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from benchmark.config import EpisodeConfig, Variant
from benchmark.episodes import episode, referee
from benchmark.episodes.cells import Looks
from benchmark.world.drop import DropResult
from benchmark.world.scene import cell_config
from benchmark.world.sensor import sensor_config
from vision.geometry.camera import View
from vision.localizer import Localization

BELIEVED, TRUE = (RigidTransform.from_translation([x, 0.0, 0.75]) for x in (0.1, 0.2))
PIECES = [RigidTransform.from_translation([0.75, y, 0.1]) for y in (-0.03, 0.03)]


class Cell:
    """Two pieces and a camera that is not where the robot believes it to be."""

    config = cell_config(("cover2",), 2)
    model = None
    data = SimpleNamespace(time=0.0)

    def __init__(self):
        self.sensors = []

    def drop(self, rng, on_step, sensor):
        self.sensors.append(sensor)
        return DropResult(True, (True, False))

    def move_joints(self, q, on_step):
        pass

    def capture(self, rng, name):
        return View(np.zeros((480, 640), np.uint8), self.config.camera, BELIEVED, name)

    def camera_truth(self):
        return TRUE

    def visibility(self):
        return SimpleNamespace(total_px=np.array([10, 10]), fraction=np.array([0.9, 0.4]))

    def truth(self):
        return PIECES


@pytest.fixture
def told(monkeypatch):
    """What reaches the localizer and the judge, and the record, of an episode with a variant or none."""
    heard = SimpleNamespace(views=None, judged=None, cell=Cell(), record=None)

    class Spy:
        name = "spy"

        def __init__(self, models):
            pass

        def localize(self, views, workspace=None):
            heard.views = views
            return Localization(())

    def judge(localization, method, pieces, true_views, models):
        heard.judged = pieces, true_views
        return real_judge(localization, method, pieces, true_views, models)

    real_judge = referee.judge
    monkeypatch.setattr(referee, "judge", judge)
    monkeypatch.setattr("benchmark.tasks.bench.boards", lambda *_: None)
    monkeypatch.setattr("benchmark.tasks.bench.Hand", lambda *_: SimpleNamespace(move_joints=lambda _: None))
    monkeypatch.setitem(sys.modules, "spying", types.SimpleNamespace(make=Spy))

    def run(variant=None):
        looks = Looks(lambda: [SimpleNamespace(q=None)] * 3, list)
        cells = SimpleNamespace(cell=lambda _: heard.cell, looks=lambda _: looks)
        config = EpisodeConfig(("cover2",), pieces=2, localizer="spying:make", task="none", variant=variant)
        heard.record = episode.run_episode(config, cells=cells)
        return heard

    return run


def test_a_localizer_gets_what_the_robot_knows_and_is_judged_by_the_truth(told):
    heard = told()
    pieces, true_views = heard.judged
    assert all(np.array_equal(v.T_world_camera.as_matrix(), BELIEVED.as_matrix()) for v in heard.views)
    assert all(np.array_equal(v.T_world_camera.as_matrix(), TRUE.as_matrix()) for v in true_views)
    assert len(heard.views) == len(true_views) == 3
    assert [piece.T_world_part for piece in pieces] == PIECES
    assert [(p.visibility, p.in_bin, p.failed_stage) for p in heard.record.pieces] == [
        (pytest.approx(0.9), True, "extraction"),
        (pytest.approx(0.4), False, "drop"),
    ]


def test_the_sensor_of_a_variant_has_its_hand_eye_error(told):
    (usual,) = told().cell.sensors
    assert usual == sensor_config("lab")
    assert told(Variant(hand_eye_mm=1.5)).cell.sensors[-1].hand_eye_translation_m == 0.0015
