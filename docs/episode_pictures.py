"""Takes the README's pictures of one recorded episode: `python -m docs.episode_pictures`. Needs chromium.

One shows the recording in the rerun viewer, the other the stages of its first view as `focalpick explain` draws them.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import sync_playwright

from benchmark.cli import main as focalpick
from benchmark.config import EpisodeConfig
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.report.rerun_log import record_episode
from tests.browser.person import CHROMIUM
from vision.drawing.explain import PANELS
from vision.drawing.strokes import Image, contact_sheet
from vision.geometry.camera import View

IMAGES = Path(__file__).resolve().parent / "images"
EPISODE = EpisodeConfig(("hub",), scene=3)
TITLES = (
    "Edges",
    "Regions and their quadtree (Fig. 7 a)",
    "Pruned by attributes (Fig. 7 b)",
    "Regions with an elliptic boundary",
    "Fragments (Fig. 8 a)",
    "Groups of fragments (Fig. 8 b)",
    "Kalman filter, after 0, 4, 8 ... points",
    "Supporting features (Fig. 9 d)",
    "Superimposed model (Figs. 11 c, 12 b)",
)
PORT, WEB_PORT = 19876, 19090
SOFTWARE_GL = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
WIDTH, HEIGHT = 1440, 904
MENU_PX = 36  # of the viewer, at the top
DRAWN_MS = 100_000  # the viewer takes in a little between one picture and the next, and draws slowly in software


class Photographer(EpisodeObserver):
    """Keeps what the camera has seen."""

    def __init__(self) -> None:
        """Nothing has been seen yet."""
        self.views: list[View] = []

    def looked(self, index: int, view: View) -> None:  # noqa: ARG002
        """Keep the view."""
        self.views.append(view.undistorted())


def main() -> None:
    """Record the episode and take both pictures."""
    with tempfile.TemporaryDirectory() as name:
        save("explain", stages(Path(name)))
        recording = Path(name) / "hub.rrd"
        record_episode(EPISODE, recording)
        (IMAGES / "rerun.png").write_bytes(in_viewer(recording))


def stages(directory: Path) -> Image:
    """What `focalpick explain` draws of the first view, as one picture."""
    photographer = Photographer()
    run_episode(EPISODE, photographer)
    picture = directory / "view.png"
    cv2.imwrite(str(picture), photographer.views[0].gray)
    focalpick(["explain", str(picture), "--model", "hub", "--out", str(directory)])
    panels = [np.asarray(cv2.imread(str(directory / f"{panel}.png"))[..., ::-1], np.uint8) for panel in PANELS]
    return contact_sheet(dict(zip(TITLES, panels, strict=True)), box_px=480)


def in_viewer(recording: Path) -> bytes:
    """The recording in the viewer, as PNG."""
    options = ["--port", str(PORT), "--web-viewer-port", str(WEB_PORT)]
    command = [sys.executable, "-m", "rerun_cli", "--web-viewer", *options, str(recording)]
    # Its own attempt to open a browser must come to nothing, and its native process must end with the wrapper.
    server = subprocess.Popen(command, start_new_session=True, env={**os.environ, "BROWSER": "true"})
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(SOFTWARE_GL))
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="dark")
            page.wait_for_timeout(3000)
            page.goto(f"http://127.0.0.1:{WEB_PORT}?url=rerun%2Bhttp://127.0.0.1:{PORT}/proxy")
            page.wait_for_timeout(DRAWN_MS)
            picture = page.screenshot(clip={"x": 0, "y": MENU_PX, "width": WIDTH, "height": HEIGHT - MENU_PX})
            browser.close()
    finally:
        os.killpg(server.pid, signal.SIGTERM)
        server.wait()
    return bytes(picture)


def save(name: str, rgb: Image) -> None:
    """As PNG among the documents' pictures."""
    cv2.imwrite(str(IMAGES / f"{name}.png"), rgb[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
