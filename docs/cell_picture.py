"""Takes the picture at the head of the README: `python -m docs.cell_picture` lets the robot pick a hub."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from benchmark.config import EpisodeConfig
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.world.cell import WorkCell
from vision.localizer import Localization

PICTURE = Path(__file__).resolve().parent / "images" / "cell.png"
HANGING_M = 0.25  # above where it lay
ROWS, COLUMNS = slice(230, 930), slice(150, 1080)  # of the overview, where the robot is


class Photographer(EpisodeObserver):
    """Waits until a piece has been lifted."""

    def __init__(self) -> None:
        """Nothing has been seen yet."""
        self.picture: np.ndarray | None = None
        self._cell: WorkCell | None = None
        self._lying: np.ndarray | None = None

    def begin(self, cell: WorkCell, config: EpisodeConfig) -> None:  # noqa: ARG002
        """Remember the cell."""
        self._cell = cell

    def localized(self, localization: Localization, verdict: object) -> None:  # noqa: ARG002
        """From here on a piece that rises has been picked."""
        self._lying = self._heights()

    def step(self) -> None:
        """Take the picture once."""
        if self.picture is None and self._lying is not None and (self._heights() - self._lying).max() > HANGING_M:
            assert self._cell is not None
            self.picture = self._cell.overview(1280, 960)[ROWS, COLUMNS]

    def _heights(self) -> np.ndarray:
        assert self._cell is not None
        return np.array([T.translation[2] for T in self._cell.truth()])


def main() -> None:
    """Take the picture."""
    photographer = Photographer()
    run_episode(EpisodeConfig(("hub",), scene=3), photographer)
    if photographer.picture is None:
        raise SystemExit("no piece was lifted; choose another scene")
    cv2.imwrite(str(PICTURE), cv2.cvtColor(photographer.picture, cv2.COLOR_RGB2BGR))


if __name__ == "__main__":
    main()
