"""A complete lesson on cover 2 by mouse and keyboard, from the opened page to the saved model, and its worth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from benchmark.lessons.model_trial import try_model
from benchmark.models import load_model as shipped_model
from benchmark.study.simulated_person import Operator, record
from tests.browser.apprentice import repeat
from tests.browser.person import Person, Program
from vision.model.model_file import load_model, model_to_json
from vision.model.vision_model import VisionModel
from vision.teaching.session import Session
from vision.teaching.session_file import load_session, replay
from vision.teaching.view_directory import save_views

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SCENES, SEED = 2, 10_600


@pytest.fixture(scope="module")
def recorded() -> tuple[Session, list]:
    """What the simulated operator does: seven clicks a contour, 1 px beside it, in three views."""
    return record("cover2", Operator(click_sigma_px=1.0, clicks=7, views=3, seed=0))


@pytest.fixture
def lesson(recorded: tuple[Session, list], tmp_path: Path) -> Path:
    save_views(tmp_path / "lesson", recorded[1], "cover2")
    return tmp_path / "lesson"


def test_cover2_is_taught_by_mouse_and_keyboard(
    person: Person, page: Page, program: Program, lesson: Path, recorded: tuple[Session, list]
):
    document = recorded[0].document
    repeat(document, person)
    person.wait()
    try_it(page, person)
    person.tab("Mark")
    person.press("Control+s")
    expect(page.get_by_text("Saved as")).to_be_visible(timeout=60_000)
    assert page.evaluate("() => window.focalpickUnsaved") is False
    shown = page.evaluate("() => Object.values(window.focalpickStage.state.views[0].patterns).flat()")
    assert program.interrupt() == 130
    taught = load_model(lesson / "model.json")
    assert model_to_json(replay(lesson)) == (lesson / "model.json").read_text()
    same_as(taught, document, load_session(lesson))
    assert len(shown) == sum(len(p.points) for p in taught.patterns if p.normal[2] > 0) > 300
    assert hits(taught) >= hits(shipped_model("cover2")) - 1


def try_it(page: Page, person: Person) -> None:
    """Two scenes, in which most of the pieces are found."""
    person.tab("Try it")
    person.fill("Scenes", "2")
    person.button("Try it")
    expect(page.locator(".teach-shot")).to_have_count(2, timeout=120_000)
    found, _, total = page.locator(".teach-figure-value").first.inner_text().partition("/")
    assert int(found) >= 0.8 * int(total) > 0


def same_as(taught: VisionModel, document: object, session: Session) -> None:
    """The page came to what the operator meant."""
    meant = {f.name: f for f in document.features}
    assert {f.name: (f.role, f.copies) for f in taught.features} == {
        name: (f.role, f.copies) for name, f in meant.items()
    }
    assert [(g.name, g.kind, g.copies) for g in taught.grasps] == [
        (g.name, g.kind, g.copies) for g in document.grasps
    ]
    for mine, placed in zip(session.document.grasps, document.grasps, strict=True):
        assert np.allclose(mine.T_part_tcp, placed.T_part_tcp, atol=2e-6)
        assert abs(mine.width_m - placed.width_m) < 1e-6
    assert taught.bore is not None
    assert abs(taught.bore.diameter_m - document.bore.diameter_m) < 1e-7


def hits(model: VisionModel) -> int:
    outcomes = try_model(model, "cover2", SCENES, SEED)
    return sum(piece.status == "hit" for scene in outcomes for piece in scene.pieces)
