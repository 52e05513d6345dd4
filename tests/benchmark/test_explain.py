from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmark import cli

PANELS = ("1_edges", "2_regions", "3_region_ellipses", "4_fragments", "5_groups", "6_filter", "contact_sheet")


@pytest.fixture
def drawing(tmp_path: Path) -> Path:
    image = np.full((150, 200, 3), 60, np.uint8)
    cv2.ellipse(image, (100, 75), (60, 40), 20, 0, 360, (90, 180, 220), -1, cv2.LINE_AA)
    path = tmp_path / "drawing.png"
    cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_explain_writes_every_panel(
    drawing: Path, tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    source = drawing.with_suffix(suffix)
    cv2.imwrite(str(source), cv2.imread(str(drawing)))
    out = tmp_path / "a" / "b"
    assert cli.main(["explain", str(source), "--out", str(out)]) == 0
    assert {path.stem for path in out.iterdir()} == set(PANELS)
    for name in PANELS[:-1]:
        assert cv2.imread(str(out / f"{name}.png")).shape == (300, 400, 3)
    assert str(out / "contact_sheet.png") in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, b"", b"no image", b"\x89PNG\r\n\x1a\nbroken"])
def test_explain_of_what_is_no_image_is_one_line(
    tmp_path: Path, content: bytes | None, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "image.png"
    if content is not None:
        path.write_bytes(content)
    assert cli.main(["explain", str(path), "--out", str(tmp_path / "out")]) == 2
    err = capfd.readouterr().err
    assert err.startswith("focalpick: image ")
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_explain_into_a_file_is_one_line(drawing: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["explain", str(drawing), "--out", str(drawing)]) == 2
    assert "--out" in capsys.readouterr().err
