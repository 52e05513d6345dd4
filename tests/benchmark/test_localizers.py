"""Finding the localizer that a run asks for."""

from __future__ import annotations

import sys
import types
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import benchmark.localizers.registry
from benchmark.config import EpisodeConfig
from benchmark.localizers.registry import make_localizer, with_single_extractor_answers
from benchmark.models import load_model
from vision.errors import InputError
from vision.localizer import EllipseLocalizer, Localization
from vision.pose.calibration import CalibrationError


class Blind:
    """Finds nothing; remembers the models that it was made from."""

    name = "blind"

    def __init__(self, models):
        self.models = models

    def localize(self, views, workspace=None):
        return Localization(())


def no_truth():
    raise AssertionError("only the oracle may ask for the truth")


@pytest.fixture
def mine(monkeypatch):
    """A user's module."""
    module = types.ModuleType("mine")
    module.make = Blind
    module.number = 7
    module.wrong = lambda models: object()  # noqa: ARG005
    monkeypatch.setitem(sys.modules, "mine", module)
    return module


@pytest.fixture
def offered(monkeypatch, mine):
    """Entry points of installed packages."""
    group = benchmark.localizers.registry.ENTRY_POINTS
    points = [EntryPoint(name, value, group) for name, value in (("blind", "mine:make"), ("broken", "mine:gone"))]
    monkeypatch.setattr(
        "benchmark.localizers.registry.entry_points", lambda group: [p for p in points if p.group == group]
    )


@pytest.mark.parametrize(
    ("name", "extractors"),
    [("focal", ("region", "group")), ("focal-region", ("region",)), ("focal-group", ("group",))],
)
def test_the_projects_localizers_go_by_their_names(name, extractors):
    models = [load_model("hub"), load_model("cover1")]
    localizer = make_localizer(name, models, no_truth)
    assert isinstance(localizer, EllipseLocalizer)
    assert localizer.name == name
    assert localizer.extractors == extractors
    assert localizer.models == tuple(models)


@pytest.mark.parametrize("name", ["focal", "focal-region", "focal-group"])
def test_the_projects_localizers_are_told_how_good_the_calibration_is(name):
    models = [load_model("hub")]
    told = CalibrationError(hand_eye_translation_m=1e-3)
    assert make_localizer(name, models, no_truth, told).parameters.calibration == told
    assert make_localizer(name, models, no_truth).parameters == EllipseLocalizer(models).parameters


@pytest.mark.parametrize("name", ["paper", "previous"])
def test_the_papers_own_system_goes_by_its_names(name):
    models = [load_model("hub")]
    assert make_localizer(name, models, no_truth).name == name


@pytest.mark.parametrize(("old", "new"), [("dual", "focal"), ("region", "focal-region"), ("group", "focal-group")])
def test_a_name_of_older_versions_is_answered_with_the_new_one(old, new):
    with pytest.raises(InputError) as refusal:
        make_localizer(old, [], no_truth)
    assert str(refusal.value) == f"localizer: got {old}; expected {new}. It is called {new} now."


def test_oracle_knows_the_truth_and_asks_for_it_late():
    pose = RigidTransform.from_translation([1.0, 2.0, 3.0])
    pieces = []
    oracle = make_localizer("oracle", [], lambda: pieces)
    pieces.append(("hub", pose))
    (estimate,) = oracle.localize([]).estimates
    assert estimate.part == "hub"
    assert np.array_equal(estimate.T_world_part.as_matrix(), pose.as_matrix())


def test_factory_of_a_module_gets_the_models(mine):
    models = [load_model("cover1")]
    localizer = make_localizer("mine:make", models, no_truth)
    assert isinstance(localizer.inner, Blind)
    assert localizer.inner.models == models
    assert localizer.name == "blind"


def test_a_factory_may_be_inside_a_class(mine):
    mine.Family = type("Family", (), {"make": Blind})
    assert isinstance(make_localizer("mine:Family.make", [], no_truth).inner, Blind)


def test_entry_point_is_found_by_name(offered):
    assert isinstance(make_localizer("blind", [], no_truth).inner, Blind)


def test_the_papers_system_from_a_users_factory_is_asked_what_each_extractor_alone_says(mine):
    mine.make = EllipseLocalizer
    localizer = make_localizer("mine:make", [load_model("cover1")], no_truth)
    assert set(with_single_extractor_answers(localizer, Localization(()), [], None).by_extractor) == {
        "focal-region",
        "focal-group",
    }


@pytest.mark.parametrize("name", ["mine:number", "os:sep"])
def test_what_cannot_be_called_is_refused(name, mine):
    with pytest.raises(InputError, match=f"localizer {name}: got .* expected a function of the taught models"):
        make_localizer(name, [], no_truth)


def test_what_a_factory_makes_must_be_a_localizer(mine):
    with pytest.raises(InputError, match=r"mine:wrong: got object object; expected .*localize"):
        make_localizer("mine:wrong", [], no_truth)


@pytest.mark.parametrize("name", ["mine:gone", "nowhere:make", "mine:", ":make", ":"])
def test_what_cannot_be_imported_is_refused(name, mine):
    with pytest.raises(InputError, match=r"package\.module:factory"):
        make_localizer(name, [], no_truth)


def test_broken_entry_point_is_refused(offered):
    with pytest.raises(InputError, match="broken"):
        make_localizer("broken", [], no_truth)


def test_unknown_name_is_answered_with_the_known_ones(offered):
    with pytest.raises(InputError) as refusal:
        make_localizer("best", [], no_truth)
    known = "focal, focal-region, focal-group, paper, previous, oracle, blind, broken, or package.module:factory"
    assert f"got best; expected {known}" in str(refusal.value)


@pytest.mark.parametrize("name", ["focal", "mine:make", "blind", "my.package.module:Factory.make"])
def test_config_takes_any_localizer_that_could_exist(name):
    assert EpisodeConfig(("hub",), localizer=name).localizer == name


@pytest.mark.parametrize("name", ["", " ", "two words", " focal"])
def test_config_refuses_what_is_no_name(name):
    with pytest.raises(InputError, match="localizer"):
        EpisodeConfig(("hub",), localizer=name)


def test_unknown_part_has_no_model():
    with pytest.raises(InputError, match=r"hat\.json"):
        load_model("hat")
