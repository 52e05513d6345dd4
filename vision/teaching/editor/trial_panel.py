"""Try it: the model as taught, in scenes that it has never seen."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from nicegui import background_tasks, ui

from vision.errors import FocalpickError
from vision.teaching.editor.page_context import PageContext
from vision.teaching.editor.services import PieceOutcome, SceneOutcome
from vision.teaching.editor.workers import StoppedError

HALF_VISIBLE = 0.5


class TrialPanel:
    """A button, figures and pictures."""

    def __init__(self, page: PageContext) -> None:
        """Lay it out."""
        self._page = page
        self._scenes: list[SceneOutcome] = []
        self._running = False
        with ui.element("div").classes("teach-sheet"):
            with ui.row().classes("w-full items-center no-wrap gap-4"):
                self._run = ui.button("Try it", icon="play_arrow", on_click=self._start)
                self._run.props("unelevated no-caps color=primary")
                self._stop = ui.button("Stop", icon="stop", on_click=page.workshop.thinking.stop)
                self._stop.props("outline no-caps")
                self._count = ui.number("Scenes", value=6, min=1, max=50, precision=0).props("dense outlined")
                self._seed = ui.number("Seed", value=1, min=0, precision=0).props("dense outlined")
                for field in (self._count, self._seed):
                    field.classes("teach-copies")
                ui.label(page.workshop.services.trial_note).classes("teach-muted")
                ui.space()
                self._state = ui.label().classes("teach-muted")
            self._progress = ui.linear_progress(0, show_value=False, size="3px")
            self._figures = ui.element("div").classes("teach-figures")
            self._gallery = ui.element("div").classes("teach-gallery")
        self.refresh()

    def refresh(self) -> None:
        """Show what can be done now."""
        self._run.set_enabled(not self._running and bool(self._page.workshop.document.features))
        self._stop.set_visibility(self._running)
        self._progress.set_visibility(self._running)

    def _start(self) -> None:
        background_tasks.create(self._try(), context=ui.context.client)

    async def _try(self) -> None:
        if self._running:
            return
        self._scenes = []
        self._figures.clear()
        self._gallery.clear()
        self._progress.set_value(0)
        self._running = True
        self._state.set_text("building the model …")
        self.refresh()
        scenes, seed = int(self._count.value or 6), int(self._seed.value or 0)
        try:
            await self._page.workshop.try_model(scenes, seed, lambda scene: self._show(scene, scenes))
            self._state.set_text("done")
        except StoppedError:
            self._state.set_text("stopped")
        except FocalpickError as error:
            self._state.set_text("")
            self._page.complain(str(error))
        finally:
            self._running = False
            self.refresh()

    def _show(self, scene: SceneOutcome, total: int) -> None:
        self._scenes.append(scene)
        self._progress.set_value(len(self._scenes) / total)
        self._state.set_text(f"scene {len(self._scenes)} of {total}")
        with self._gallery, ui.element("div").classes("teach-shot"):
            ui.html(f'<img alt="scene {scene.number}" src="{_data_url(scene.picture)}">', sanitize=False)
            with ui.element("div").classes("teach-shot-text"):
                ui.label(f"scene {scene.number}")
                ui.label(_summary(scene.pieces)).classes("teach-muted")
        self._show_figures([piece for s in self._scenes for piece in s.pieces])

    def _show_figures(self, pieces: list[PieceOutcome]) -> None:
        real = [p for p in pieces if p.status != "false alarm"]
        clear = [p for p in real if (p.visible or 0.0) >= HALF_VISIBLE]
        hits = [p for p in real if p.status == "hit"]
        figures = (
            ("of pieces at least half visible", f"{_share([p.status == 'hit' for p in clear])}"),
            ("of all pieces", _share([p.status == "hit" for p in real])),
            ("false alarms", str(len(pieces) - len(real))),
            ("median position error", _median([p.translation_mm for p in hits], "mm")),
            ("median tilt error", _median([p.rotation_deg for p in hits], "°")),
        )
        self._figures.clear()
        with self._figures:
            for caption, value in figures:
                with ui.element("div").classes("teach-figure"):
                    ui.label(value).classes("teach-figure-value")
                    ui.label(caption).classes("teach-muted")


def _summary(pieces: tuple[PieceOutcome, ...]) -> str:
    counts = {s: sum(p.status == s for p in pieces) for s in ("hit", "miss", "false alarm")}
    words = {"hit": ("hit", "hits"), "miss": ("miss", "misses"), "false alarm": ("false alarm", "false alarms")}
    return ", ".join(f"{n} {words[s][n != 1]}" for s, n in counts.items() if n or s == "hit")


def _share(outcomes: list[bool]) -> str:
    return f"{sum(outcomes)}/{len(outcomes)}" if outcomes else "–"


def _median(values: list[float | None], unit: str) -> str:
    known = [v for v in values if v is not None]
    return f"{np.median(known):.2f} {unit}" if known else "–"


def _data_url(rgb: np.ndarray) -> str:
    encoded = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])[1]
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode()
