"""A browser, a lesson, and the page open on it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from benchmark.lessons.page_services import open_part
from tests.browser.person import CHROMIUM, Person, Program
from vision.errors import ResourceError
from vision.teaching.view_directory import load_views


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if not CHROMIUM:
        pytest.skip("no chromium in /usr/bin; install it with: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lesson directory on cover 2 in which nothing has been done."""
    directory = tmp_path_factory.mktemp("photographed") / "cover2"
    try:
        open_part("cover2", directory)
    except ResourceError as error:
        pytest.skip(str(error))
    return directory


@pytest.fixture
def lesson(photographed: Path, tmp_path: Path) -> Path:
    """The same, for one test."""
    return Path(shutil.copytree(photographed, tmp_path / "lesson"))


@pytest.fixture
def program(lesson: Path, tmp_path: Path) -> Iterator[Program]:
    """The command, running."""
    program = Program("--part", "cover2", "--dir", str(lesson), log=tmp_path / "log.txt")
    yield program
    program.kill()


@pytest.fixture
def page(browser: Browser, program: Program) -> Iterator[Page]:
    """The page on a laptop's screen; errors in the browser are errors."""
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(program.url)
    yield page
    context.close()
    assert errors == []


@pytest.fixture
def person(page: Page, lesson: Path) -> Person:
    return Person(page, load_views(lesson))
