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
    assert err.startswith("focalpick: picture ")
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_explain_into_a_file_is_one_line(drawing: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["explain", str(drawing), "--out", str(drawing)]) == 2
    assert "--out" in capsys.readouterr().err


@pytest.mark.parametrize("broken", ["truncated", "damaged"])
def test_explain_of_a_broken_png_is_one_line(
    drawing: Path, tmp_path: Path, broken: str, capfd: pytest.CaptureFixture[str]
) -> None:
    content = bytearray(drawing.read_bytes())
    middle = len(content) // 2
    if broken == "truncated":
        del content[middle:]
    else:
        content[middle] ^= 255
    drawing.write_bytes(bytes(content))
    assert cli.main(["explain", str(drawing), "--out", str(tmp_path / "out")]) == 2
    err = capfd.readouterr().err
    assert "cannot be decoded" in err
    assert err.count("\n") == 1  # libpng's own line is not among them


def test_explain_takes_sixteen_bits_as_it_takes_eight(drawing: Path, tmp_path: Path) -> None:
    deep = tmp_path / "deep.png"
    cv2.imwrite(str(deep), cv2.imread(str(drawing)).astype(np.uint16) * 257)
    for path, out in ((drawing, tmp_path / "eight"), (deep, tmp_path / "sixteen")):
        assert cli.main(["explain", str(path), "--out", str(out)]) == 0
    for name in PANELS:
        eight, sixteen = (cv2.imread(str(tmp_path / out / f"{name}.png")) for out in ("eight", "sixteen"))
        assert np.array_equal(eight, sixteen)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.full((40, 50), 0.5, np.float32), "float32 pixels"),
        (np.full((40, 50), 1023, np.uint16), "no level above 1023"),
    ],
    ids=["float", "10 bits"],
)
def test_explain_says_what_to_do_with_other_levels(
    image: np.ndarray, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "other.tiff"
    cv2.imwrite(str(path), image)
    assert cli.main(["explain", str(path), "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert "Scale" in err
    assert err.count("\n") == 1
