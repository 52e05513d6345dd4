"""The errors that many edge points of a picture share, far above the noise of single points."""

from __future__ import annotations

from dataclasses import dataclass

from vision.settings import NOT_NEGATIVE, check


@dataclass(frozen=True)
class EdgeErrors:
    """Standard deviations of errors that do not average out; they widen the covariance of a pose and do not move it.

    ``benchmark/tuning/edge_sigmas.py`` fits them on rendered scenes. The ratios of the defaults are those of the
    greatest likelihood; all are half as large again, because the tails are longer than a Gaussian's.

    Attributes:
        shift_px: of all edges of one picture together.
        swell_px: of the radius of one rim in one picture.
        rim_shift_px: of one rim or hole in one picture.
        lift_px: of the taught height of one rim.
        twist_px: of all holes of one picture about the part's axis.
        common_px: of all edges of all pictures together.
    """

    shift_px: float = 0.02
    swell_px: float = 0.063
    rim_shift_px: float = 0.032
    lift_px: float = 0.078
    twist_px: float = 0.012
    common_px: float = 0.06

    def __post_init__(self) -> None:
        check(self, shift_px=NOT_NEGATIVE, swell_px=NOT_NEGATIVE, rim_shift_px=NOT_NEGATIVE)
        check(self, lift_px=NOT_NEGATIVE, twist_px=NOT_NEGATIVE, common_px=NOT_NEGATIVE)


USUAL = EdgeErrors()
"""Those of the renderer's edges."""
