"""One episode's outcome for the terminal."""

from __future__ import annotations

from rich import box
from rich.table import Table

from benchmark.records.episode_record import AttemptRecord, EpisodeRecord, LocalizerResult, PickRecord, PieceRecord
from benchmark.report.grid import NOTHING


def outcome_table(record: EpisodeRecord) -> Table:
    """A row for each piece: how visible it is, and what each localizer made of it."""
    methods = list(dict.fromkeys(name for piece in record.pieces for name in piece.results))
    title = f"Episode {record.key}  (own seed {record.seed})"
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for heading in ("Piece", "Part", "Visible", *methods, "Lost at"):
        table.add_column(heading)
    for piece in record.pieces:
        visible = f"{piece.visibility:.0%}" if piece.in_bin else "out of the bin"
        results = [_result(piece, method) for method in methods]
        table.add_row(str(piece.index), piece.part, visible, *results, piece.failed_stage or NOTHING)
    return table


def pick_lines(record: EpisodeRecord) -> list[str]:
    """A line for each pick, for false positives and for the time spent."""
    lines = [_pick_line(pick) for pick in record.picks] or [_attempt_line(attempt) for attempt in record.attempts]
    if record.places and not record.picks:
        lines.append(f"In the tray: {record.places.count('tray')} of {len(record.places)} pieces{_lost(record)}")
    if any(record.false_positives.values()):
        counts = ", ".join(f"{name} {count}" for name, count in record.false_positives.items())
        lines.append(f"Poses that belong to no piece: {counts}")
    if record.timings_s:
        lines.append("Time: " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in record.timings_s.items()))
    return lines


def _pick_line(pick: PickRecord) -> str:
    if not pick.attempted:
        return "No pick: nothing was localised"
    if pick.failed_stage == "plan":
        reasons = ", ".join(f"{reason} {count}" for reason, count in pick.rejected.items())
        return "No pick: none of the grasps was possible" + (f" ({reasons})" if reasons else "")
    target = f"piece {pick.piece}" if pick.piece is not None else "a pose where no piece is"
    grasp = f" by {pick.grasp}" if pick.grasp else ""
    outcome = "succeeded" if pick.succeeded else f"failed at {pick.failed_stage or 'an unknown stage'}"
    return f"Pick of {target}{grasp}: {outcome}"


def _attempt_line(attempt: AttemptRecord) -> str:
    about = "" if attempt.piece is None else f" of piece {attempt.piece}"
    how = f" by {attempt.grasp}" if attempt.grasp else ""
    end = "succeeded" if attempt.succeeded else f"ended at {attempt.stage}: {attempt.cause}"
    reasons = ", ".join(f"{reason} {count}" for reason, count in attempt.rejected.items())
    seconds = sum(attempt.seconds.values())
    return f"{attempt.goal}{about}{how}: {end}{f' ({reasons})' if reasons else ''}, {seconds:.1f} s simulated"


def _lost(record: EpisodeRecord) -> str:
    lost = record.places.count("lost")
    return f", {lost} lost" if lost else ""


def _result(piece: PieceRecord, method: str) -> str:
    result: LocalizerResult | None = piece.results.get(method)
    if result is None:
        return NOTHING
    if result.matched and result.errors is not None:
        return f"{result.errors.translation_mm:.2f} mm, tilt {result.errors.tilt_deg:.2f}°"
    return "extracted, not matched" if result.extracted else "not found"
