"""Pictures of the cell: what the camera sees, how an episode looks, and how much of each piece is visible."""

from __future__ import annotations

import atexit
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmark.world import gl
from benchmark.world.marks import surface_marks
from benchmark.world.scene import KEY_LIGHT, TEXTURE_PX, VISUAL_GROUP, CellConfig
from benchmark.world.sensor import Appearance
from vision.frozen import frozen_arrays

_ALONE_GROUP = 5
_DAYLIGHT_DIRECTION = (-0.25, -0.6, -0.76)
_OVERVIEW_TARGET = (0.4, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Visibility:
    """How much of the pieces a picture shows.

    Attributes:
        visible_masks: bool (N, H, W), the pixels of each piece.
        total_masks: bool (N, H, W), the same with nothing before it.
    """

    visible_masks: NDArray[np.bool_]
    total_masks: NDArray[np.bool_]

    @property
    def visible_px(self) -> NDArray[np.int64]:
        """Pixels of each piece in the picture, (N,)."""
        return np.asarray(self.visible_masks.sum(axis=(1, 2)))

    @property
    def total_px(self) -> NDArray[np.int64]:
        """Pixels that each piece would have in the picture if nothing stood before it, (N,)."""
        return np.asarray(self.total_masks.sum(axis=(1, 2)))

    @property
    def fraction(self) -> NDArray[np.float64]:
        """Visible over total, (N,); zero for a piece outside the picture."""
        return np.asarray(self.visible_px / np.maximum(self.total_px, 1))


class CellRenderer:
    """Draws the cell with MuJoCo's renderer. Holds an OpenGL context: close it, or use it in a `with` block."""

    def __init__(self, model: mujoco.MjModel, config: CellConfig, *, has_marks: bool = True) -> None:
        """Open the OpenGL context.

        Args:
            model: the compiled cell; the renderer changes its light, textures and highlights.
            config: what it was compiled from.
            has_marks: whether surfaces can have marks; to go without saves a third of the time of a picture.

        Raises:
            ResourceError: this machine cannot draw.
        """
        gl.choose_backend()
        self._model, self._config, self._has_marks = model, config, has_marks
        self._pieces = [f"piece_{i}" for i in range(config.pieces)]
        self._materials = ["bin", *self._pieces]
        if not has_marks:
            model.mat_texid[[model.material(name).id for name in self._materials]] = -1
        width, height = config.resolution_px
        self._renderer = mujoco.Renderer(model, height, width)
        atexit.register(self.close)  # a context that outlives OpenGL itself complains at the interpreter's exit
        self._option = mujoco.MjvOption()

    def __enter__(self) -> CellRenderer:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the OpenGL context back."""
        atexit.unregister(self.close)
        self._renderer.close()

    def apply(self, appearance: Appearance) -> None:
        """Set the light, the highlights and the marks on surfaces of an episode, from the next physics step on."""
        model = self._model
        light = model.light(KEY_LIGHT).id
        model.light_dir[light] = appearance.light_direction
        model.light_pos[light] = self._config.bin_centre_m - self._config.light_distance_m * model.light_dir[light]
        for name in self._pieces:
            model.mat_specular[model.material(name).id] = appearance.specular
        if self._has_marks:
            self._draw_marks(appearance)

    def _draw_marks(self, appearance: Appearance) -> None:
        rng = np.random.default_rng(appearance.texture_seed)
        for name in self._materials:
            marks = surface_marks(rng, TEXTURE_PX, appearance.texture_strength, turned=name != "bin")
            self._upload(self._model.texture(f"{name}_marks"), marks)

    def _upload(self, texture: Any, marks: NDArray[np.uint8]) -> None:
        """Write a grey texture into the model and onto the graphics card."""
        start, channels = int(texture.adr[0]), int(texture.nchannel[0])
        self._model.tex_data[start : start + marks.size * channels] = np.repeat(marks.ravel(), channels)
        # MuJoCo's renderer has no public way to its context; the textures live there, if it is the current one.
        self._renderer._gl_context.make_current()
        mujoco.mjr_uploadTexture(self._model, self._renderer._mjr_context, texture.id)

    def rgb(self, data: mujoco.MjData, camera: str | mujoco.MjvCamera) -> NDArray[np.uint8]:
        """A picture, uint8 (H, W, 3)."""
        self._renderer.update_scene(data, camera, self._option)
        return np.asarray(self._renderer.render())

    def overview(self, data: mujoco.MjData, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """A picture of the whole cell for people: daylight and finer shadows than the camera needs.

        Args:
            data: the state to draw.
            width_px: at most 1280.
            height_px: at most 960.
        """
        camera = mujoco.MjvCamera()
        camera.lookat[:] = _OVERVIEW_TARGET
        camera.distance, camera.azimuth, camera.elevation = 3.6, 218.0, -20.0
        with self._daylight(data), mujoco.Renderer(self._model, height_px, width_px) as renderer:
            renderer.update_scene(data, camera, self._option)
            return np.asarray(renderer.render())

    @contextmanager
    def _daylight(self, data: mujoco.MjData) -> Iterator[None]:
        """Make the key light a distant one with a large and fine shadow map, for renderers made meanwhile."""
        model, light = self._model, self._model.light(KEY_LIGHT).id
        quality, shadows = model.vis.quality, model.vis.map
        before = quality.shadowsize, shadows.shadowclip
        kept = [(field, field[light].copy()) for field in (model.light_type, data.light_xdir, data.light_xpos)]
        quality.shadowsize, shadows.shadowclip = 4096, 2.5
        model.light_type[light] = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        data.light_xdir[light] = _DAYLIGHT_DIRECTION
        data.light_xpos[light] = _OVERVIEW_TARGET - 4.0 * data.light_xdir[light]
        try:
            yield
        finally:
            quality.shadowsize, shadows.shadowclip = before
            for field, value in kept:
                field[light] = value

    def visibility(self, data: mujoco.MjData, camera: str) -> Visibility:
        """Compare the pixels of each piece in the whole scene with those of the piece alone."""
        geoms = [self._model.geom(name).id for name in self._pieces]
        whole = self._segmentation(data, camera, self._option)
        alone_option = mujoco.MjvOption()
        alone_option.geomgroup[:] = 0
        alone_option.geomgroup[_ALONE_GROUP] = 1
        alone = []
        for geom in geoms:
            self._model.geom_group[geom] = _ALONE_GROUP
            alone.append(self._segmentation(data, camera, alone_option) == geom)
            self._model.geom_group[geom] = VISUAL_GROUP
        return Visibility(np.stack([whole == geom for geom in geoms]), np.stack(alone))

    def _segmentation(self, data: mujoco.MjData, camera: str, option: mujoco.MjvOption) -> NDArray[np.int32]:
        """The geom number of every pixel (H, W), -1 where there is none; without shadows, which would only cost."""
        self._renderer.update_scene(data, camera, option)
        flags = self._renderer.scene.flags
        shadow = flags[mujoco.mjtRndFlag.mjRND_SHADOW]
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._renderer.enable_segmentation_rendering()
        try:
            numbers, kinds = np.moveaxis(self._renderer.render(), -1, 0)
        finally:
            self._renderer.disable_segmentation_rendering()
            flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadow
        return np.where(kinds == int(mujoco.mjtObj.mjOBJ_GEOM), numbers, -1)
