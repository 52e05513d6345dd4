"""Takes the pictures of docs/vision.md: `python -m docs.three_views` drops four covers and photographs the bin."""

from __future__ import annotations

import json
from pathlib import Path

import cv2

from benchmark.config import EpisodeConfig
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.episodes.evaluation import Verdict
from benchmark.models import load_model
from benchmark.world.cell import WorkCell
from vision.drawing.superimpose import superimpose
from vision.files.views import save_views
from vision.geometry.camera import View
from vision.localizer import Localization

DIRECTORY = Path(__file__).resolve().parent / "images" / "three_views"
TRUTH = DIRECTORY / "truth.json"
DRAWN = DIRECTORY.parent / "localize.jpg"


class Photographer(EpisodeObserver):
    """Keeps the pictures, and where the pieces lay."""

    def __init__(self) -> None:
        """Nothing has been seen yet."""
        self.views: list[View] = []
        self.pieces: list[dict[str, object]] = []
        self.localization: Localization | None = None
        self._cell: WorkCell | None = None

    def begin(self, cell: WorkCell, config: EpisodeConfig) -> None:  # noqa: ARG002
        """Remember the cell."""
        self._cell = cell

    def looked(self, index: int, view: View) -> None:  # noqa: ARG002
        """Keep a picture."""
        self.views.append(view)

    def localized(self, localization: Localization, verdict: Verdict) -> None:
        """The pieces lie still: write down where."""
        assert self._cell is not None
        self.localization = localization
        poses = zip(self._cell.truth(), verdict.pieces, strict=True)
        self.pieces = [
            {"part": piece.part, "visibility": round(piece.visibility, 3), "T_world_part": T.as_matrix().tolist()}
            for T, piece in poses
        ]


def main() -> None:
    """Take the pictures; the truth lies in a file of its own, which only the test of the document reads."""
    photographer = Photographer()
    run_episode(EpisodeConfig(("cover2",), sensor="lab", seed=2001, task="none"), photographer)
    assert photographer.localization is not None
    save_views(DIRECTORY, photographer.views)
    drawn = superimpose(photographer.views[0], photographer.localization.estimates, [load_model("cover2")])
    cv2.imwrite(str(DRAWN), cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])
    TRUTH.write_text(json.dumps(photographer.pieces, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
