"""The teaching page in a real browser: marking, undo, reload, complaints, keys."""

from __future__ import annotations

import json
import statistics
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Dialog, Page, expect

from benchmark.world.parts import get_part
from tests.browser.person import Person, Program
from vision.geometry.circle import Circle, project_circle
from vision.teaching.session import Session
from vision.teaching.session_file import load_session

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def rim(name: str) -> Circle:
    (found,) = [r for r in get_part("cover2").rims if r.name == name]
    return Circle(np.array([found.offset_m, 0.0, found.z_m]), np.array([0.0, 0.0, float(found.side)]), found.radius_m)


OUTLINE, BORE = rim("outline_front"), rim("bore_front")


def stored(lesson: Path) -> Session:
    return load_session(lesson)


def test_a_circle_is_taught_by_clicks_in_two_views(person: Person, page: Page, lesson: Path):
    person.mark(OUTLINE, 0)
    person.wait()
    (mark,) = person.state()["views"][0]["marks"].values()
    truth = project_circle(OUTLINE, person.views[0])
    assert np.allclose(mark["ellipse"][:4], truth.geometric[:4], atol=0.3)
    assert person.state()["views"][1]["circles"] == {}
    person.mark(OUTLINE, 1)
    person.wait()
    expect(page.locator(".teach-circle")).to_contain_text("Diameter")
    expect(page.locator(".teach-residual")).to_have_count(2)
    expect(page.locator(".teach-residual").first).to_contain_text("mm")
    for number in (2, 3, 4):  # the circle appears in views in which nobody has clicked
        (circle,) = person.state()["views"][number]["circles"].values()
        image = project_circle(OUTLINE, person.views[number])
        assert np.allclose(circle["ellipse"][:4], image.geometric[:4], atol=1.0)
    assert person.state()["views"][5]["circles"] == {}  # the back
    assert len(stored(lesson).document.features[0].contours) == 2


def test_a_view_guides_to_the_same_feature_in_the_next(person: Person, page: Page):
    person.mark(OUTLINE, 1)
    person.wait()
    person.look(2)
    page.wait_for_function("() => window.focalpickStage.state.guide?.view === 2")
    guide = page.evaluate("() => window.focalpickStage.state.guide")
    image = project_circle(OUTLINE, person.views[2])
    assert np.allclose(guide["predicted"][:4], image.geometric[:4], atol=3.0)
    assert len(guide["curves"]) >= 5
    person.press("5")
    assert page.get_by_role("button", name="Guides").get_attribute("aria-pressed") == "false"


def test_undo_and_redo_restore_exactly(person: Person, page: Page, lesson: Path):
    documents = []
    for pixel in person.clicks_on(OUTLINE, 0, 6):
        person.click(pixel)
        person.wait()
        documents.append(stored(lesson).document)
    for document in documents[-2::-1]:
        person.press("Control+z")
        expect_document(page, lesson, document)
    for document in documents[1:-1]:
        person.press("Control+Shift+Z")
        expect_document(page, lesson, document)
    person.press("Control+y")
    expect_document(page, lesson, documents[-1])
    person.button("Undo")
    expect_document(page, lesson, documents[-2])


def expect_document(page: Page, lesson: Path, document: object) -> None:
    for _ in range(100):
        if stored(lesson).document == document:
            return
        page.wait_for_timeout(50)
    assert stored(lesson).document == document


def test_points_are_dragged_and_deleted(person: Person, page: Page, lesson: Path):
    pixels = person.clicks_on(OUTLINE, 0, 6)
    for pixel in pixels:
        person.click(pixel)
    person.wait()
    page.mouse.move(*person.place(pixels[2]))
    page.mouse.down()
    page.mouse.move(*person.place(pixels[2] + [9, 4]), steps=5)
    page.mouse.up()
    person.wait()
    points = stored(lesson).document.features[0].marks[0]
    assert np.allclose(points[2], pixels[2] + [9, 4], atol=1.0)
    page.mouse.click(*person.place(points[4]), button="right")
    person.wait()
    assert stored(lesson).document.features[0].marks[0] == (*points[:4], points[5])
    page.mouse.move(5, 5)
    person.press("Delete")
    person.wait()
    assert stored(lesson).document.features[0].marks[0] == points[:4]


def test_a_reload_in_the_middle_loses_nothing(person: Person, page: Page, lesson: Path):
    dialogs: list[str] = []

    def stay_or_go(dialog: Dialog) -> None:
        dialogs.append(dialog.type)
        dialog.accept()

    page.on("dialog", stay_or_go)
    pixels = person.clicks_on(OUTLINE, 0, 7)
    for pixel in pixels[:4]:
        person.click(pixel)
    page.reload()  # at once: what the server has not stored comes with the page
    person.wait()
    assert dialogs == ["beforeunload"]
    for pixel in pixels[4:]:
        person.click(pixel)
    person.wait()
    points = stored(lesson).document.features[0].marks[0]
    assert np.allclose(points, pixels, atol=1.0)
    (mark,) = person.state()["views"][0]["marks"].values()
    assert np.allclose(mark["points"], points)


def test_a_crash_loses_nothing(person: Person, page: Page, program: Program, lesson: Path, tmp_path: Path):
    person.mark(OUTLINE, 0, 6)
    person.wait()
    before = stored(lesson)
    program.kill()
    pixels = np.add(person.clicks_on(OUTLINE, 0, 2), [40, 0])
    for pixel in pixels:  # nobody is there to take them
        person.click(pixel)
    port = program.url.rstrip("/").rpartition(":")[2]
    again = Program("--part", "cover2", "--dir", str(lesson), "--port", port, log=tmp_path / "again.txt")
    try:
        page.wait_for_function("() => window.focalpickStage?.outbox.acts.length === 0", timeout=30_000)
        person.wait()
        points = stored(lesson).document.features[0].marks[0]
        assert points[:6] == before.document.features[0].marks[0]
        assert np.allclose(points[6:], pixels, atol=1.0)
    finally:
        assert again.interrupt() == 130


def test_an_overlay_that_does_not_arrive_is_asked_for_again(person: Person, page: Page):
    person.wait_for_extractors()
    fetch = "(tag) => window.focalpickStage.album.fetchOverlay(0, tag)"
    tag = page.evaluate("() => window.focalpickStage.album.views[0].tag")
    page.route("**/overlay/**", lambda route: route.abort())
    page.evaluate(fetch, f"{tag}-lost")
    page.unroute("**/overlay/**")
    assert page.evaluate("() => window.focalpickStage.album.views[0].tag === undefined")
    with page.expect_response(f"**/overlay/{tag}/0.json") as answer:
        page.evaluate(fetch, tag)
    assert answer.value.ok


def test_an_inconsistent_view_is_named(person: Person, page: Page):
    for number in (1, 2, 3):
        person.mark(OUTLINE, number)
    person.look(4)
    for pixel in np.add(person.clicks_on(OUTLINE, 4), [14.0, 9.0]):
        person.click(pixel)
    person.wait()
    expect(page.get_by_role("alert")).to_contain_text("front 5 disagrees with the other views")
    expect(page.locator(".stage-thumb.bad")).to_have_count(1)


def test_a_stray_click_is_named(person: Person, page: Page):
    pixels = person.clicks_on(OUTLINE, 0, 8)
    pixels[4] += [25.0, 0.0]
    for pixel in pixels:
        person.click(pixel)
    person.wait()
    expect(page.get_by_role("alert")).to_contain_text("Click 5 in front 1 is not on the ellipse")


def test_a_candidate_is_picked(person: Person, page: Page, lesson: Path):
    person.wait_for_extractors()
    image = project_circle(BORE, person.views[0])
    person.press("n")
    person.press("v")
    page.mouse.move(*person.place(image.sample(9)[4]))
    expect(page.locator(".stage-status")).to_contain_text("Click to take it")
    person.click(image.sample(9)[4])
    person.wait()
    (mark,) = person.state()["views"][0]["marks"].values()
    assert np.allclose(mark["ellipse"][:4], image.geometric[:4], atol=1.0)
    assert type(stored(lesson).events[-1]).__name__ == "ChooseCandidate"


def test_keys(person: Person, page: Page):
    person.press("PageDown")
    expect(page.locator(".stage-thumb.current")).to_contain_text("front 2")
    person.press("PageUp")
    person.press("1")
    expect(page.get_by_role("button", name="Regions1")).to_have_attribute("aria-pressed", "true")
    zoom = page.locator(".stage-zoom")
    whole = zoom.inner_text()
    person.press("+")
    expect(zoom).not_to_have_text(whole)
    person.press("ArrowLeft")
    person.press("0")
    expect(zoom).to_have_text(whole)
    person.press("n")
    person.press("n")
    expect(page.locator(".teach-feature.is-chosen")).to_contain_text("circle 2")
    person.press("k")
    expect(page.locator(".teach-feature.is-chosen")).to_contain_text("circle 1")
    person.press("?")
    expect(page.get_by_text("Keyboard and mouse")).to_be_visible()
    person.press("Escape")
    expect(page.get_by_text("Keyboard and mouse")).not_to_be_visible()


def test_points_are_set_with_the_keyboard_alone(person: Person, page: Page, lesson: Path):
    person.press("n")
    person.press("c")
    for keys in ("ArrowRight", "Shift+ArrowDown", "Enter", "Shift+ArrowRight", "Enter"):
        person.press(keys)
    person.wait()
    first, second = stored(lesson).document.features[0].marks[0]
    assert np.allclose(np.subtract(second, first), [10, 0])


def test_two_tabs_show_one_session(person: Person, page: Page, program: Program, lesson: Path):
    other = page.context.new_page()
    other.goto(program.url)
    there = Person(other, person.views)
    page.bring_to_front()
    for pixel in person.clicks_on(OUTLINE, 0, 6):
        person.click(pixel)
    person.wait()
    other.bring_to_front()
    other.wait_for_function("() => Object.keys(window.focalpickStage.state.views[0].marks).length === 1")
    there.click((20, 20))
    there.wait()
    assert len(stored(lesson).document.features[0].marks[0]) == 7


def test_ctrl_c_ends_it(person: Person, program: Program, lesson: Path):
    person.mark(OUTLINE, 0, 6)
    person.wait()
    assert program.interrupt() == 130
    assert "Traceback" not in program.log.read_text()
    assert json.loads((lesson / "session.json").read_text())["events"]


def test_clicks_and_overlays_are_answered(person: Person, page: Page, capsys: pytest.CaptureFixture[str]):
    """Prints how fast; what is asserted is that every click is answered."""
    waits = []
    for number in (0, 1, 2):
        person.look(number)
        for pixel in person.clicks_on(OUTLINE, number):
            waits.append(answer_ms(person, pixel))
    person.wait_for_extractors()
    person.press("2")
    drawn = page.evaluate(_DRAWN)
    assert all(np.isfinite(waits))
    with capsys.disabled():
        print(
            f"\nclick answered in {statistics.median(waits):.0f} ms (median), {max(waits):.0f} ms (slowest of "
            f"{len(waits)}); overlay drawn in {drawn:.0f} ms"
        )


_DRAWN = """() => new Promise((done) => {
  const stage = window.focalpickStage, began = performance.now();
  stage.run("overlay:regions");
  requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - began)));
})"""

_ANSWERED = """() => new Promise((done) => {
  const stage = window.focalpickStage, before = stage.markedPoints().length;
  let released = 0;
  const release = () => { released = performance.now(); };
  stage.$refs.canvas.addEventListener("pointerup", release, { once: true, capture: true });
  const look = () => {
    if (stage.markedPoints().length > before) done(performance.now() - released);
    else setTimeout(look, 1);
  };
  look();
})"""


def answer_ms(person: Person, pixel: np.ndarray) -> float:
    """From letting the button go to the server's answer being on the page."""
    person.page.evaluate(f"() => {{ window.answered = ({_ANSWERED})(); }}")
    person.click(pixel)
    waited = person.page.evaluate("() => window.answered")
    person.page.wait_for_timeout(150)
    return float(waited)
