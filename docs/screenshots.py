"""Takes the pictures of docs/teaching.md: `python -m docs.screenshots` teaches cover 2 in a browser and looks on.

Needs chromium. The person at the page is that of tests/browser.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, expect, sync_playwright

from benchmark.study.simulated_person import Operator, record
from tests.browser.apprentice import place_grasp, take_bore, teach_feature
from tests.browser.person import CHROMIUM, Person, Program
from vision.teaching.document import Document
from vision.teaching.view_directory import save_views

IMAGES = Path(__file__).resolve().parent / "images"


def main() -> None:
    """Teach cover 2 and save a picture at each step."""
    session, views = record("cover2", Operator(click_sigma_px=0.7, clicks=7, views=3))
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        directory = Path(name) / "lesson"
        save_views(directory, views, "cover2")
        program = Program("--part", "cover2", "--dir", str(directory), log=Path(name) / "log.txt")
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1366, "height": 768})
        try:
            page.goto(program.url)
            show_the_page(Person(page, views), session.document)
        finally:
            browser.close()
            program.kill()


def show_the_page(person: Person, document: Document) -> None:
    """From the first click to the trial."""
    page = person.page
    person.wait_for_extractors()
    first, *others = document.features
    show_marking(person, first.marks)
    person.fill("Name", first.name)
    for feature in others:
        teach_feature(feature, person)
    page.wait_for_timeout(1500)
    person.look(1)
    save(page, "circles")
    person.press("1")
    person.press("2")
    save(page, "overlays")
    person.press("1")
    person.press("2")
    person.tab("Grasp")
    if document.bore is not None:
        take_bore(document, document.bore, person)
    for grasp in document.grasps:
        place_grasp(grasp, person)
    page.locator(".teach-feature:visible").nth(2).click()
    page.wait_for_timeout(1500)
    save(page, "grasp")
    person.tab("Thresholds")
    person.button("Propose")
    expect(page.locator(".teach-before-after")).to_be_visible(timeout=180_000)
    save(page, "thresholds")
    person.tab("Try it")
    person.button("Try it")
    expect(page.locator(".teach-shot")).to_have_count(6, timeout=300_000)
    save(page, "try-it")


def show_marking(person: Person, marks: dict[int, tuple[tuple[float, float], ...]]) -> None:
    """The first feature: clicks, the guide in the next view, and a view whose clicks do not belong."""
    page = person.page
    (first, second, third, *_) = marks
    person.look(first)
    for point in marks[first]:
        person.click(point)
    person.wait()
    page.wait_for_timeout(800)
    save(page, "points")
    person.look(second)
    page.wait_for_timeout(800)
    save(page, "guide")
    for point in marks[second]:
        person.click(point)
    person.look(third)
    for point in np.add(marks[third], [16.0, 7.0]):
        person.click(point)
    person.wait()
    page.wait_for_timeout(800)
    save(page, "inconsistent")
    person.button("Clear this view")
    for point in marks[third]:
        person.click(point)
    person.wait()


def save(page: Page, name: str) -> None:
    """A picture of the page."""
    page.wait_for_timeout(500)
    page.screenshot(path=IMAGES / f"teach-{name}.png")


if __name__ == "__main__":
    main()
