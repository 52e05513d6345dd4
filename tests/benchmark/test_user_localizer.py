"""What is wrong with a user's localizer is said of the user's file and line, before anything runs where possible."""

from __future__ import annotations

import pickle
import textwrap

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from benchmark import cli
from benchmark.config import EpisodeConfig
from benchmark.episodes.failures import failed_episode
from benchmark.localizers.errors import LocalizerError
from benchmark.localizers.registry import make_localizer
from benchmark.models import load_model
from vision.errors import InputError
from vision.geometry.camera import Camera, View
from vision.localizer import Localization
from vision.pose.estimate import PoseEstimate

VIEW = View(np.zeros((4, 5), np.uint8), Camera(5, 4, 5.0, 5.0, 2.0, 1.5), RigidTransform.identity())

GOOD = """
    from vision import Localization
    class Mine:
        name = "mine"
        def __init__(self, models):
            self.models = models
        def localize(self, views, workspace=None):
            return {answer}
    make = Mine
"""


@pytest.fixture
def written(tmp_path, monkeypatch):
    """written(source) is the name of a localizer whose module has this source; `make` is its factory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [str(tmp_path), *__import__("sys").path])

    def write(source, name=f"written_{tmp_path.name}"):
        (tmp_path / f"{name}.py").write_text(textwrap.dedent(source), encoding="utf-8")
        return f"{name}:make"

    return write


def make(name):
    return make_localizer(name, [load_model("cover1")], tuple)


WRONG = {
    "a name that is not there": ("number = 7", r"has no attribute 'make'.* package\.module:factory"),
    "a syntax error": (
        "x = 1\nmake = (",
        r"SyntaxError: '\(' was never closed \([^()]*\.py, line 2\).* Correct .*\.py\.$",
    ),
    "an error on import": ("x = 1\nraise RuntimeError('no licence')", r"RuntimeError: no licence \(.*\.py, line 2\)"),
    "an exit on import": ("import sys\nsys.exit(3)", r"SystemExit: 3 \(.*\.py, line 2\)"),
    "a package that is missing": ("import no_such_package", r"No module named 'no_such_package' \(.*\.py, line 1\)"),
    "an attribute error on import": ("import math\nmath.no_such_thing", r"AttributeError: .*\.py, line 2\)"),
    "a factory without arguments": ("\ndef make():\n    pass", r"make\(\): .*too many.* Change .*\.py, line 2"),
    "a factory that raises": ("def make(models):\n    return models['hub']", r"TypeError: .*\.py, line 2\).*Correct"),
    "a factory that raises deep inside": (
        "import numpy\ndef make(models):\n    return numpy.linalg.inv(numpy.zeros((2, 2)))",
        r"LinAlgError: Singular matrix \(.*written_.*\.py, line 3\)",
    ),
    "a factory that gives the class": (
        "class Mine:\n    name = 'mine'\n    def localize(self, views, workspace): pass\n"
        "def make(models):\n    return Mine",
        r"got the class Mine itself; expected an object .* Return such an object in .*\.py, line 4",
    ),
    "a factory that gives nothing": ("def make(models):\n    pass", r"got None; expected an object with a name"),
    "a localizer without a name": (
        "class make:\n    def __init__(self, models): pass\n    def localize(self, views, workspace): pass",
        r"got make object; expected an object with a name",
    ),
    "a localizer that takes one argument": (
        "class make:\n    name = 'm'\n    def __init__(self, models): pass\n    def localize(self, views): pass",
        r"localize\(views\): .*expected localize\(views, workspace\)\. Change .*\.py, line 4",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_localizer_that_cannot_be_made_is_refused(what, written):
    source, message = WRONG[what]
    name = written(source)
    with pytest.raises(LocalizerError, match=message) as refusal:
        make(name)
    assert str(refusal.value).startswith("localizer")
    assert name in str(refusal.value)


ANSWERS = {
    "None": r"got None; expected a vision\.Localization, .* Correct localize in .*\.py, line 7",
    "[]": "got list object",
    "Localization((5,))": "got int object among the estimates",
    "Localization((), ((), ()))": "got features of 2 views; expected those of 1 views, or none",
    "1 / 0": r"ZeroDivisionError: division by zero \(.*\.py, line 8\)",
    "exit('enough')": r"SystemExit: enough \(.*\.py, line 8\)",
}


@pytest.mark.parametrize("answer", ANSWERS)
def test_an_answer_that_is_none_is_refused(answer, written):
    localizer = make(written(GOOD.format(answer=answer)))
    with pytest.raises(LocalizerError, match=ANSWERS[answer]):
        localizer.localize([VIEW])


@pytest.mark.parametrize(
    ("part", "pose", "message"),
    [
        ("lid", RigidTransform.identity(), "got an estimate of part 'lid'; expected one of cover1"),
        ("cover1", None, "got T_world_part = None"),
        ("cover1", np.eye(4), "got T_world_part = "),
        ("cover1", RigidTransform.from_translation([np.nan, 0, 0]), "got T_world_part = "),
    ],
    ids=str,
)
def test_an_estimate_of_nothing_is_refused(part, pose, message, written):
    localizer = make(written(GOOD.format(answer="self.answer")))
    estimate = PoseEstimate(part, pose, np.eye(6), 1.0, "mine", 0.0, 1, inplane_known=True)
    for answer in (Localization((estimate,)), Localization((), by_extractor={"alone": (estimate,)})):
        localizer.inner.answer = answer
        with pytest.raises(LocalizerError, match=message):
            localizer.localize([VIEW])


def test_a_good_answer_passes(written):
    localizer = make(written(GOOD.format(answer="Localization([self.answer])")))
    estimate = PoseEstimate("cover1", RigidTransform.identity(), np.eye(6), 1.0, "mine", 0.0, 1, inplane_known=True)
    localizer.inner.answer = estimate
    assert localizer.localize([VIEW], None).estimates == (estimate,)
    assert localizer.name == "mine"


def test_ctrl_c_passes_through(written):
    name = written("def make(models):\n    raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        make(name)
    localizer = make(written(GOOD.format(answer="self.stop()"), "patient"))

    def stop():
        raise KeyboardInterrupt

    localizer.inner.stop = stop
    with pytest.raises(KeyboardInterrupt):
        localizer.localize([VIEW])


def test_the_command_names_the_users_file_and_keeps_the_traceback(written, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("benchmark.world.gl.works", lambda *_, **__: True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    name = written("def make(models):\n    return helper()\ndef helper():\n    raise OSError('no camera')")
    assert cli.main(["run", "--localizer", name]) == 2
    err = capsys.readouterr().err
    (saved,) = tmp_path.glob("focalpick-*.txt")
    assert err.count("\n") == 1
    assert "internal error" not in err
    assert f"OSError: no camera ({tmp_path / name.partition(':')[0]}.py, line 4)" in err
    assert err.rstrip().endswith(f"The traceback is in {saved}")
    assert "in helper" in saved.read_text(encoding="utf-8")


def test_what_is_refused_without_an_error_of_the_users_saves_no_traceback(written, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("benchmark.world.gl.works", lambda *_, **__: True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cli.main(["run", "--localizer", written("def make(models):\n    pass")]) == 2
    assert "got None" in capsys.readouterr().err
    assert list(tmp_path.glob("focalpick-*.txt")) == []


def test_an_episode_whose_localizer_fails_is_recorded_with_the_users_line(written):
    localizer = make(written(GOOD.format(answer="1 / 0")))
    with pytest.raises(InputError) as refusal:
        localizer.localize([VIEW])
    error = pickle.loads(pickle.dumps(refusal.value))  # as it comes from a worker
    assert isinstance(error, LocalizerError)
    text = failed_episode(EpisodeConfig(("cover1",)), error).error
    assert "ZeroDivisionError: division by zero (" in text
    assert ".py, line 8)" in text
    assert "user_localizer.py" not in text
