"""``focalpick assets``."""

from __future__ import annotations

from benchmark.commands.common import OptionalPath


def build(out: OptionalPath = None) -> int:
    """Generate the parts' meshes and collision pieces anew, byte by byte the same with the pinned versions.

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


def teach(out: OptionalPath = None) -> int:
    """Have a simulated person teach the vision models of the three parts anew.

    The person photographs the part on the teaching fixture, five views of either face, and clicks near its rims and
    holes with an error of one pixel. What it does is recorded as a teaching session beside its pictures, and the
    model is what a replay of the session gives. Needed after a change of a part's design or of an extractor.

    Example: focalpick assets teach

    Args:
        out: directory of the models; the repository's own when left out.
    """
    from benchmark.commands.common import prepare_process

    prepare_process()
    from benchmark.models import MODELS
    from benchmark.study.simulated_person import record
    from benchmark.world.parts import PART_NAMES
    from vision.model.model_file import save_model
    from vision.teaching.session_file import replay, save_session
    from vision.teaching.view_directory import save_views

    models = out or MODELS
    for name in PART_NAMES:
        lesson = models / "sessions" / name
        session, views = record(name)
        save_views(lesson, views, name)
        save_session(session, lesson)
        model = replay(lesson)
        save_model(model, models / f"{name}.json")
        salient = ", ".join(f.name for f in model.salient)
        counts = f"{len(session.events)} events, {len(model.features)} features, {len(model.patterns)} patterns"
        print(f"{name}: {counts}, salient: {salient}")
    return 0
