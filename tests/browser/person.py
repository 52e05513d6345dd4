"""A person at the teaching page: looks at pictures, clicks, drags, types. Knows where a part's rims are.

Also used by docs/screenshots.py.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Locator, Page

from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle

CHROMIUM = next(
    (p for p in ("/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome") if Path(p).exists()), ""
)

_TO_PAGE = """([x, y]) => {
  const stage = window.focalpickStage;
  const box = stage.$refs.canvas.getBoundingClientRect();
  const [u, v] = stage.viewport.toCanvas([x, y]);
  return [box.left + u, box.top + v];
}"""
_SETTLED = "() => window.focalpickStage && !window.focalpickStage.outbox.acts.length"


class Program:
    """`focalpick teach` in a process of its own."""

    def __init__(self, *arguments: str, log: Path) -> None:
        """Start it and wait until it says where the page is."""
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
        command = [sys.executable, "-m", "benchmark.cli", "teach", "--no-show", *arguments]
        self.log = log
        with log.open("w") as file:
            self.process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, env=environment)
        self.url = self._wait_for_url()

    def _wait_for_url(self) -> str:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            found = re.search(r"http://127\.0\.0\.1:\d+/", self.log.read_text())
            if found:
                return found[0]
            if self.process.poll() is not None:
                break
            time.sleep(0.1)
        self.kill()
        raise RuntimeError(f"no page: {self.log.read_text()}")

    def interrupt(self) -> int:
        """Ctrl-C; the exit code."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(timeout=20)

    def kill(self) -> None:
        """A crash."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


class Person:
    """Hands and eyes."""

    def __init__(self, page: Page, views: Sequence[View], seed: int = 0, sigma_px: float = 0.7) -> None:
        """Sit down before an open page."""
        self.page, self.views, self.sigma_px = page, views, sigma_px
        self.rng = np.random.default_rng(seed)
        self.wait()

    def wait(self) -> None:
        """Until the page is there and all that was done is stored."""
        self.page.wait_for_selector(".stage canvas", state="attached")
        self.page.wait_for_function(_SETTLED)

    def wait_for_extractors(self) -> None:
        """Until they are done with all views."""
        self.page.wait_for_function(
            "() => window.focalpickStage.album.views.every((view) => view.overlay)", timeout=90_000
        )

    def look(self, view: int) -> None:
        """Turn to a view."""
        self.page.locator(".stage-thumb").nth(view).click()

    def place(self, pixel: Sequence[float]) -> tuple[float, float]:
        """Where a pixel of the picture is on the screen."""
        x, y = self.page.evaluate(_TO_PAGE, [float(v) for v in pixel])
        return x, y

    def click(self, pixel: Sequence[float]) -> None:
        """Click on a pixel of the picture."""
        self.page.mouse.click(*self.place(pixel))

    def clicks_on(self, circle: Circle, view: int, n: int = 7) -> np.ndarray:
        """Pixels near the image of a circle."""
        image = project_circle(circle, self.views[view])
        assert image is not None
        return image.sample(n) + self.rng.normal(scale=self.sigma_px, size=(n, 2))

    def mark(self, circle: Circle, view: int, n: int = 7) -> None:
        """Click along a circle in a view."""
        self.look(view)
        for pixel in self.clicks_on(circle, view, n):
            self.click(pixel)

    def press(self, keys: str) -> None:
        """Press a key, or several at once."""
        self.page.keyboard.press(keys)

    def field(self, label: str) -> Locator:
        """A field that is in sight."""
        return self.page.get_by_label(label, exact=True).locator("visible=true").first

    def fill(self, label: str, text: str) -> None:
        """Type into a field, and confirm."""
        field = self.field(label)
        field.fill(text)
        field.press("Enter")

    def tab(self, name: str) -> None:
        """Turn to a tab."""
        self.page.get_by_role("tab", name=name).click()

    def button(self, name: str) -> None:
        """Push a button that is in sight."""
        self.page.get_by_role("button", name=name).locator("visible=true").first.click()

    def state(self) -> dict[str, Any]:
        """What the page draws: by view, marks and circles by feature."""
        return self.page.evaluate(
            "() => ({ views: window.focalpickStage.state.views, feature: window.focalpickStage.state.feature })"
        )
