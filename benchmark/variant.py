"""What a study varies: one setting of it. A pure value, like the configuration that it is part of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vision.errors import InputError

TAUGHT_VIEWS = (2, 5)


@dataclass(frozen=True)
class Variant:
    """One setting of the quantities that a study varies; None leaves a quantity as the sweep has it.

    Attributes:
        hand_eye_mm: root mean square length of the camera's mounting error, instead of the sensor's; its angle goes
            with it, see ``benchmark.world.sensor.with_hand_eye_error``.
        click_sigma_px: the parts are taught anew by a simulated person whose clicks err by this standard deviation.
        taught_views: in how many views of a face, 2 to 5, this person marks a feature; given with ``click_sigma_px``.
    """

    hand_eye_mm: float | None = None
    click_sigma_px: float | None = None
    taught_views: int | None = None

    def __post_init__(self) -> None:
        for name in ("hand_eye_mm", "click_sigma_px"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise InputError(name, got=value, expected="a finite number, not negative")
            if value is not None:
                object.__setattr__(self, name, float(value))  # 1 and 1.0 are one variant, and must have one hash
        if (self.click_sigma_px is None) != (self.taught_views is None):
            got = f"click_sigma_px={self.click_sigma_px}, taught_views={self.taught_views}"
            raise InputError("variant", got=got, expected="both or neither")
        if self.taught_views is not None and not TAUGHT_VIEWS[0] <= self.taught_views <= TAUGHT_VIEWS[1]:
            expected = f"a whole number, from {TAUGHT_VIEWS[0]} to {TAUGHT_VIEWS[1]}"
            raise InputError("taught_views", got=self.taught_views, expected=expected)

    @property
    def is_taught(self) -> bool:
        """Whether the variant has vision models of its own."""
        return self.click_sigma_px is not None

    @property
    def name(self) -> str:
        """Names the variant in keys and directories, for example ``hand-eye-0.5mm`` or ``clicks-2px-3views``."""
        quantities = [] if self.hand_eye_mm is None else [f"hand-eye-{self.hand_eye_mm:g}mm"]
        if self.is_taught:
            quantities.append(f"clicks-{self.click_sigma_px:g}px-{self.taught_views}views")
        return "-".join(quantities) or "unchanged"
