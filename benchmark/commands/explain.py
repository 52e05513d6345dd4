"""``focalpick explain``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from benchmark.commands.common import print_line
from vision.errors import InputError

if TYPE_CHECKING:
    from vision.drawing import Image

CONTACT_SHEET = "contact_sheet.png"


def explain(
    image: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="IMAGE")],
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("explained"),
) -> int:
    """Draw what region growing and edge grouping find in an image, stage by stage.

    Writes 1_edges.png, 2_regions.png, 3_region_ellipses.png, 4_fragments.png, 5_groups.png, 6_filter.png, and
    contact_sheet.png with all of them beside the image.

    Example: focalpick explain photo.jpg --out explained

    Args:
        image: a PNG, JPEG or TIFF file, or any other that OpenCV reads; 8 bits per channel, or 16, of which 65535 is
            the brightest.
        out: directory for the pictures; made where it is missing.
    """
    from vision.drawing import contact_sheet
    from vision.explain import explain as draw_stages

    rgb = _read(image)
    _make_directory(out)
    panels = draw_stages(rgb)
    for panel in panels:
        _write(out / f"{panel.name}.png", panel.image)
    sheet = {"Image": rgb, **{panel.title: panel.image for panel in panels}}
    _write(out / CONTACT_SHEET, contact_sheet(sheet))
    print_line(f"Drawn in {out}: {', '.join(panel.title for panel in panels)}. Next: look at {out / CONTACT_SHEET}")
    return 0


def _read(path: Path) -> Image:
    """An image file as RGB; errors as of :func:`vision.picture.read_picture`."""
    import cv2

    from vision.picture import read_picture

    image = read_picture(path)
    return image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)


def _make_directory(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        do = "Choose another --out."
        raise InputError(f"directory {path}", got=error.strerror, expected="one that can be made", do=do) from None


def _write(path: Path, rgb: Image) -> None:
    """Save an image.

    Raises:
        InputError: the file cannot be written.
    """
    import cv2

    encoded = cv2.imencode(path.suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1]
    try:
        path.write_bytes(encoded.tobytes())
    except OSError as error:
        do = "Choose another --out."
        raise InputError(f"picture {path}", got=error.strerror, expected="a writable file", do=do) from None
