"""``focalpick assets``."""

from __future__ import annotations

from benchmark.commands.common import OptionalPath


def build(out: OptionalPath = None) -> int:
    """Generate the parts' meshes and collision pieces anew, byte by byte the same every time.

    Only needed after a change of a part's design; the files are in the repository.

    Example: focalpick assets build

    Args:
        out: assets directory; the repository's own when left out.
    """
    from benchmark.world.assets import ASSETS, build_assets
    from vision.errors import InputError

    directory = out or ASSETS
    try:
        written = build_assets(directory)
    except OSError as error:
        raise InputError(f"assets in {directory}", got=error.strerror, expected="a writable directory") from None
    print(f"{len(written)} files written to {directory}")
    return 0
