"""The vision models of a study's variants: each is taught once and kept as a file in the sweep's directory."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.config import SweepConfig, Variant
from benchmark.study.simulated_person import Operator, teach
from vision.errors import InputError
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import Localization
from vision.model.model_file import load_model, save_model
from vision.model.vision_model import VisionModel

MODELS = "models"
_REFUSED = ".refused.txt"
OnTaught = Callable[[int, int], None]


@dataclass(frozen=True)
class NothingTaught:
    """Stands in for a localizer where the teaching has failed: a robot that was taught nothing finds nothing."""

    name: str

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:  # noqa: ARG002
        """Nothing."""
        return Localization(())


def teach_variants(config: SweepConfig, out: Path, on_taught: OnTaught | None = None) -> None:
    """Teach every part anew for every variant that asks for it; what an earlier run has taught is left alone.

    A teaching that the vision system refuses, because the clicks contradict each other too much, is an outcome of
    the study: its reason is kept in place of the model, and the part is not found in that variant.

    Args:
        config: of the sweep.
        out: its directory; the models come into ``models/VARIANT/PART.json`` there.
        on_taught: called with (done, total) after each model.

    Raises:
        ResourceError: the machine cannot draw, or the disk is full.
    """
    lessons = [(variant, part) for variant in config.variants if variant.is_taught for part in config.part_names]
    for done, (variant, part) in enumerate(lessons, start=1):
        path = model_path(out, variant, part)
        if not path.exists() and not _refusal(path).exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            _teach(variant, part, config.seed, path)
        if on_taught is not None:
            on_taught(done, len(lessons))


def taught_models(out: Path, variant: Variant, parts: Sequence[str]) -> list[VisionModel]:
    """The models of a variant, without the parts that could not be taught.

    Raises:
        InputError: the variant has not been taught in this directory.
        FileFormatError: a model's file is corrupt.
    """
    paths = [model_path(out, variant, part) for part in parts]
    return [load_model(path) for path in paths if not _refusal(path).exists()]


def refusals(out: Path) -> dict[str, str]:
    """Why a part could not be taught, by ``VARIANT/PART``."""
    paths = sorted((out / MODELS).glob(f"*/*{_REFUSED}"))
    return {f"{p.parent.name}/{p.name.removesuffix(_REFUSED)}": p.read_text(encoding="utf-8").strip() for p in paths}


def model_path(out: Path, variant: Variant, part: str) -> Path:
    """Where the model of a part, a name or the path of a mesh, is kept."""
    return out / MODELS / variant.name / f"{Path(part).stem}.json"


def _teach(variant: Variant, part: str, seed: int, path: Path) -> None:
    operator = Operator(variant.click_sigma_px or 0.0, views=variant.taught_views, seed=seed)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        model = teach(part, operator)
    except InputError as refusal:
        unfinished.write_text(f"{refusal}\n", encoding="utf-8")
        unfinished.replace(_refusal(path))
    else:
        save_model(model, unfinished)
        unfinished.replace(path)


def _refusal(path: Path) -> Path:
    return path.with_name(f"{path.stem}{_REFUSED}")
