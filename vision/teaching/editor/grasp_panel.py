"""Grasp coordinates and the bore, placed in 3D by numbers, sliders, and from taught circles."""

from __future__ import annotations

from dataclasses import asdict, replace

from nicegui import ui

from vision.geometry.circle import Circle
from vision.teaching import events as ev
from vision.teaching.editor.bore_form import BoreForm
from vision.teaching.editor.fields import Fields, on_commit
from vision.teaching.editor.grasp_pose import GraspPose, grasp_on
from vision.teaching.editor.page_context import PageContext
from vision.teaching.editor.part_scene import PartScene

KINDS = {"outside": "Close on the outside", "inside": "Open inside"}
POSE_FIELDS = {
    "x_mm": "x, mm",
    "y_mm": "y, mm",
    "z_mm": "z, mm",
    "tilt_deg": "Tilt, °",
    "azimuth_deg": "Azimuth, °",
    "turn_deg": "Turn, °",
}
FROM_CIRCLE = {"outside": "Around it", "inside": "Inside it", "rim": "On its rim"}


class GraspPanel:
    """A 3D scene, a list of grasps, and the numbers of the chosen one."""

    def __init__(self, page: PageContext) -> None:
        """Lay it out."""
        self._page = page
        self._chosen: str | None = None
        self._shown: object = None
        self._in_form: str | None = None
        self._fields = Fields()
        self._scene = PartScene()
        with ui.element("aside").classes("teach-side"):
            with ui.row().classes("w-full items-center no-wrap"):
                ui.label("Grasps").classes("teach-eyebrow")
                ui.space()
                ui.button("New", icon="add", on_click=self._add).props("flat dense no-caps").classes("teach-add")
            self._rows = ui.element("div").classes("teach-features").props('role=listbox aria-label="Grasps"')
            self._source = (
                ui.select({}, label="From a circle").props("dense outlined options-dense").classes("w-full")
            )
            with ui.row().classes("w-full no-wrap gap-1"):
                for kind, text in FROM_CIRCLE.items():
                    button = ui.button(text, on_click=lambda kind=kind: self._from_circle(kind))
                    button.props("outline dense no-caps").classes("grow teach-quiet")
            self._build_form()
            self._bore = BoreForm(page, self._circle)

    def _build_form(self) -> None:
        with ui.element("div").classes("teach-details") as self._form:
            with ui.row().classes("w-full no-wrap items-center gap-1"):
                self._name = ui.input("Name", on_change=None).props("dense outlined").classes("grow")
                remove = ui.button(icon="delete_outline", on_click=self._remove)
                remove.props('flat round dense aria-label="Remove grasp"').tooltip("Remove this grasp")
            self._kind = ui.toggle(KINDS, on_change=self._apply).props("dense no-caps unelevated spread")
            self._kind.classes("w-full")
            with ui.element("div").classes("teach-form-3"):
                self._numbers = {name: self._number(text) for name, text in POSE_FIELDS.items()}
                self._width = self._number("Width, mm")
                self._copies = self._number("Copies")
                with ui.row().classes("no-wrap gap-0 items-center justify-center"):
                    for icon, tilt, hint in (
                        ("south", 180.0, "front"),
                        ("east", 90.0, "side"),
                        ("north", 0.0, "back"),
                    ):
                        button = ui.button(icon=icon, on_click=lambda tilt=tilt: self._approach(tilt))
                        button.props(f'flat round dense size=sm aria-label="From the {hint}"').tooltip(
                            f"From the {hint}"
                        )
            with ui.element("div").classes("teach-sliders"):
                self._height = self._slider("Height", "z_mm")
                self._turn = self._slider("Turn", "turn_deg")
        on_commit(self._name, self._apply)

    def _number(self, label: str) -> ui.number:
        number = ui.number(label).props("dense outlined")
        return on_commit(number, self._apply)

    def _slider(self, label: str, name: str) -> ui.slider:
        ui.label(label).classes("teach-muted")
        slider = ui.slider(min=-180, max=180, step=1).props(f'dense aria-label="{label}"')
        slider.on("update:model-value", lambda e: self._numbers[name].set_value(e.args), throttle=0.05)
        slider.on("change", self._apply)
        return slider

    # ---- showing

    def appear(self) -> None:
        """The panel has come into sight."""
        self._scene.fit()
        if self._page.feature in self._source.options:
            self._source.set_value(self._page.feature)

    def refresh(self) -> None:
        """Show what is the case now."""
        document = self._page.workshop.document
        names = [g.grasp_id for g in document.grasps]
        if self._chosen not in names:
            self._chosen = names[-1] if names else None
        findings = self._page.workshop.findings()
        self._scene.show(document, findings, self._page.workshop.colours(), self._chosen)
        circles = {f.feature.feature_id: f.feature.name for f in findings if f.circle is not None}
        self._source.set_options(circles, value=self._source.value if self._source.value in circles else None)
        if self._source.value is None and circles:
            self._source.set_value(self._page.feature if self._page.feature in circles else next(iter(circles)))
        self._bore.refresh()
        if self._shown != (document.grasps, self._chosen, document.diameter_m):
            self._shown = (document.grasps, self._chosen, document.diameter_m)
            self._show_rows(document.grasps)
            self._show_form()

    def _show_rows(self, grasps: tuple[ev.PlaceGrasp, ...]) -> None:
        self._rows.clear()
        with self._rows:
            for grasp in grasps:
                row = ui.element("div").classes(
                    "teach-feature" + (" is-chosen" if grasp.grasp_id == self._chosen else "")
                )
                row.on("click", lambda grasp=grasp: self._choose(grasp.grasp_id))
                with row:
                    ui.icon("unfold_less" if grasp.kind == "outside" else "unfold_more").classes(
                        "rotate-90 teach-state"
                    )
                    ui.label(grasp.name).classes("teach-feature-name")
                    ui.label(f"{1e3 * grasp.width_m:.1f} mm").classes("teach-muted teach-number")
                    ui.label(f"× {grasp.copies}").classes("teach-muted")
            if not grasps:
                ui.label("None yet. Choose a circle, and how to take it.").classes("teach-muted teach-none")

    def _show_form(self) -> None:
        grasp = self._grasp()
        self._form.set_visibility(grasp is not None)
        self._in_form = None
        if grasp is None:
            return
        pose = GraspPose.of(ev.pose_of(grasp.T_part_tcp))
        for name, value in asdict(pose).items():
            self._fields.show(self._numbers[name], round(value, 3), grasp.grasp_id)
        self._fields.show(self._name, grasp.name, grasp.grasp_id)
        self._fields.show(self._width, round(1e3 * grasp.width_m, 4), grasp.grasp_id)
        self._fields.show(self._copies, grasp.copies, grasp.grasp_id)
        self._kind.set_value(grasp.kind)
        reach = max(600 * self._page.workshop.document.diameter_m, abs(pose.z_mm), 1.0)
        self._height.props(f"min={-reach:.1f} max={reach:.1f} step=0.1")
        self._height.set_value(pose.z_mm)
        self._turn.set_value(round(pose.turn_deg))
        self._in_form = grasp.grasp_id

    def _grasp(self) -> ev.PlaceGrasp | None:
        for grasp in self._page.workshop.document.grasps:
            if grasp.grasp_id == self._chosen:
                return grasp
        return None

    def _choose(self, grasp_id: str) -> None:
        self._chosen = grasp_id
        self.refresh()

    def _circle(self) -> Circle | None:
        """The circle that was chosen to start from."""
        for finding in self._page.workshop.findings():
            if finding.feature.feature_id == self._source.value:
                return finding.circle
        return None

    # ---- changing

    def _add(self) -> None:
        diameter = self._page.workshop.document.diameter_m or 0.05
        self._place("grasp", GraspPose(0.0, 0.0, 0.0), diameter, "outside")

    def _from_circle(self, how: str) -> None:
        circle = self._circle()
        if circle is None:
            self._page.complain("There is no circle yet. Mark a feature in two views first.")
            return
        pose, width = grasp_on(circle, how)
        feature = self._page.workshop.document.feature(str(self._source.value))
        self._place(f"{feature.name} {how}", pose, width, "inside" if how == "inside" else "outside")

    def _place(self, name: str, pose: GraspPose, width_m: float, kind: str) -> None:
        document = self._page.workshop.document
        grasp_id = self._page.workshop.free_id("g", [g.grasp_id for g in document.grasps])
        copies = document.symmetry_fold or 12
        matrix = ev.matrix_of(pose.transform())
        self._chosen = grasp_id
        self._page.do(
            ev.PlaceGrasp(grasp_id, name, matrix, width_m, "inside" if kind == "inside" else "outside", copies)
        )

    def _approach(self, tilt_deg: float) -> None:
        self._numbers["tilt_deg"].set_value(tilt_deg)
        self._apply()

    def _apply(self) -> None:
        """Take over what the form says, where it says something new."""
        grasp = self._grasp()
        values = {name: number.value for name, number in self._numbers.items()}
        complete = None not in values.values() and self._width.value and self._copies.value and self._name.value
        if grasp is None or grasp.grasp_id != self._in_form or not complete:
            return
        pose = GraspPose(**{name: float(value) for name, value in values.items()})
        shown = GraspPose.of(ev.pose_of(grasp.T_part_tcp))
        unmoved = all(abs(a - b) < 6e-4 for a, b in zip(asdict(pose).values(), asdict(shown).values(), strict=True))
        width_m = float(self._width.value) / 1e3
        changed = replace(
            grasp,
            name=self._name.value.strip(),
            kind=self._kind.value,
            width_m=grasp.width_m if abs(width_m - grasp.width_m) < 1e-7 else width_m,
            copies=int(self._copies.value),
            T_part_tcp=grasp.T_part_tcp if unmoved else ev.matrix_of(pose.transform()),
        )
        if changed != grasp:
            self._page.do(changed)

    def _remove(self) -> None:
        if self._chosen is not None:
            self._page.do(ev.RemoveGrasp(self._chosen))
