"""The composed cell is the one that its configuration describes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmark.world.parts import PART_NAMES, get_part
from benchmark.world.scene import CAMERA, COLLISION_GROUP, CellConfig, build_model, cell_config
from vision.errors import InputError, ResourceError


@pytest.fixture(scope="module")
def mixed() -> tuple[CellConfig, mujoco.MjModel]:
    config = cell_config(("cover1", "cover2"), pieces=3)
    return config, build_model(config)


@pytest.mark.parametrize("name", PART_NAMES)
def test_bin_at_pile_height_fits_into_one_picture(name: str) -> None:
    config = cell_config((name,))
    camera = config.camera
    assert camera.fx == pytest.approx(2133.33, abs=0.01)
    seen = np.array([camera.height_px, camera.width_px]) / camera.fx * config.camera_distance_m
    assert (np.array(config.bin_size_m) < seen).all()
    assert min(config.bin_size_m) > get_part(name).diameter_m


def test_mixed_cell_takes_the_bin_of_its_largest_part() -> None:
    assert cell_config(("cover1", "hub")).bin_size_m == cell_config(("hub",)).bin_size_m
    assert cell_config(("cover1", "cover2"), pieces=3).piece_parts == ("cover1", "cover2", "cover1")


def test_pieces_have_the_mass_and_inertia_of_their_parts(mixed: tuple[CellConfig, mujoco.MjModel]) -> None:
    config, model = mixed
    for number, name in enumerate(config.piece_parts):
        part, body = get_part(name), model.body(f"piece_{number}")
        assert body.mass[0] == pytest.approx(part.mass_kg, rel=1e-6)
        assert np.allclose(np.sort(body.inertia), np.linalg.eigvalsh(part.inertia), rtol=1e-3)
        assert np.allclose(body.ipos, part.centre_of_mass_m, atol=1e-7)


def test_pieces_are_seen_by_their_mesh_and_touched_by_their_hulls(mixed: tuple[CellConfig, mujoco.MjModel]) -> None:
    config, model = mixed
    for number, name in enumerate(config.piece_parts):
        body = model.body(f"piece_{number}").id
        geoms = np.flatnonzero(model.geom_bodyid == body)
        touching = model.geom_contype[geoms] != 0
        assert touching.sum() == len(get_part(name).collision_meshes)
        assert (model.geom_group[geoms[touching]] == COLLISION_GROUP).all()
        assert [model.geom(g).name for g in geoms[~touching]] == [f"piece_{number}"]


def test_wrist_camera_has_the_configured_optics(mixed: tuple[CellConfig, mujoco.MjModel]) -> None:
    config, model = mixed
    camera = model.camera(CAMERA).id
    assert model.cam_resolution[camera].tolist() == [640, 480]
    assert model.cam_sensorsize[camera] == pytest.approx(config.sensor_size_m)
    assert model.cam_intrinsic[camera] == pytest.approx([0.016, 0.016, 0.0, 0.0])


def test_another_lens_is_a_matter_of_configuration() -> None:
    config = replace(cell_config(("cover1",), pieces=1), focal_length_m=0.012, resolution_px=(320, 240))
    model = build_model(config)
    assert model.cam_intrinsic[model.camera(CAMERA).id, :2] == pytest.approx([0.012, 0.012])
    assert config.camera.fx == pytest.approx(0.012 / 0.0048 * 320)


def test_bad_configurations_are_refused() -> None:
    with pytest.raises(InputError, match="hub"):
        cell_config(("sprocket",))
    with pytest.raises(InputError, match="at least one"):
        cell_config(())
    with pytest.raises(InputError, match="0 pieces"):
        cell_config(("hub",), pieces=0)
    with pytest.raises(InputError, match="above zero"):
        replace(cell_config(("hub",)), camera_distance_m=-1.0)


def test_a_missing_arm_is_a_resource_error() -> None:
    with pytest.raises(ResourceError, match="no_such_arm"):
        build_model(replace(cell_config(("cover1",)), arm_xml=Path("no_such_arm.xml")))
