from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark import cli
from benchmark.models import MODELS, load_model
from benchmark.report.rerun_blueprint import stage_entity
from benchmark.report.rerun_log import RerunLog
from vision.drawing.explain import MODEL_FREE_PANELS, PANELS
from vision.geometry.camera import Camera, View
from vision.localizer import EllipseLocalizer
from vision.model.contour import ModelContour


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
    assert {path.stem for path in out.iterdir()} == {*MODEL_FREE_PANELS, "contact_sheet"}
    for name in MODEL_FREE_PANELS:
        assert cv2.imread(str(out / f"{name}.png")).shape == (300, 400, 3)
    assert str(out / "contact_sheet.png") in capsys.readouterr().err


def drawn_cover(path: Path, scale: int = 1) -> None:
    """A front view of cover 2 in white lines, at the distance from which the benchmark sees it."""
    camera = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
    T_world_part = RigidTransform.from_components(
        [0.005, -0.004, 0.72], Rotation.from_euler("xz", [170, 20], degrees=True)
    )
    view = View(np.zeros((480, 640), np.uint8), camera, RigidTransform.identity())
    contour = ModelContour.of(load_model("cover2"), camera.fx / 0.72)
    image = np.full((480 * scale, 640 * scale), 50, np.uint8)
    found = contour.project(T_world_part.as_matrix(), view)
    circle = contour.circle[found.index]
    for number in np.flatnonzero(~contour.circle_drawn):
        ring = ((found.pixels[circle == number] + 0.5) * scale - 0.5) * 16
        if len(ring):
            cv2.polylines(image, [np.rint(ring).astype(np.int32)], True, 230, 2 * scale, cv2.LINE_AA, 4)
    cv2.imwrite(str(path), image)


@pytest.mark.parametrize(("part", "scale"), [("cover2", 1), (str(MODELS / "cover2.json"), 4)])
def test_with_a_model_it_is_found_in_one_picture_and_every_stage_drawn(
    part: str, scale: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn_cover(tmp_path / "cover.png", scale)
    assert cli.main(["explain", str(tmp_path / "cover.png"), "--model", part, "--out", str(tmp_path / "out")]) == 0
    assert {path.stem for path in (tmp_path / "out").iterdir()} == {*PANELS, "contact_sheet"}
    assert "Superimposed model: 1 poses" in capsys.readouterr().err


def test_what_is_known_of_the_camera_is_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn_cover(tmp_path / "cover.png")
    command = ["explain", str(tmp_path / "cover.png"), "--model", "cover2", "--out", str(tmp_path / "out")]
    lens = ["--camera", "2133", "2133", "319.5", "239.5"]
    assert cli.main([*command, *lens, "--depth-mm", "600", "900"]) == 0
    assert "Superimposed model: 1 poses" in capsys.readouterr().err
    assert cli.main([*command, *lens, "--depth-mm", "1500", "2000"]) == 0
    assert "Superimposed model: 0 poses" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--camera", "1", "1", "0", "0"], "--camera"),
        (["--depth-mm", "1", "2"], "--depth-mm"),
        (["--model", "cover2", "--depth-mm", "2", "1"], "--depth-mm"),
        (["--model", "cover2", "--camera", "0", "1", "0", "0"], "intrinsics"),
        (["--model", "nothing.json"], "nothing.json"),
    ],
)
def test_options_that_say_nothing_are_one_line(
    arguments: list[str], named: str, drawing: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["explain", str(drawing), "--out", str(tmp_path / "out"), *arguments]) == 2
    err = capsys.readouterr().err
    assert named in err
    assert err.count("\n") == 1


class Recording:
    """Notes the entities that are logged."""

    def __init__(self) -> None:
        self.entities: list[str] = []

    def log(self, entity: str, *_: object) -> None:
        self.entities.append(entity)


def test_rerun_has_the_panels_that_the_command_writes(tmp_path: Path) -> None:
    drawn_cover(tmp_path / "cover.png")
    assert (
        cli.main(["explain", str(tmp_path / "cover.png"), "--model", "cover2", "--out", str(tmp_path / "out")]) == 0
    )
    written = {path.stem for path in (tmp_path / "out").iterdir()} - {"contact_sheet"}
    camera = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
    view = View(cv2.imread(str(tmp_path / "cover.png")), camera, RigidTransform.identity())
    recording = Recording()
    log = RerunLog(recording)  # type: ignore[arg-type]
    localizer = EllipseLocalizer([load_model("cover2")])
    log.draw_stages(1, view, localizer.extraction(view), localizer.localize([view]).estimates, localizer.models)
    assert set(recording.entities) == {stage_entity(1, name) for name in written}


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
