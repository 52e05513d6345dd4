"""Does on the page, by mouse and keyboard, what somebody else has taught."""

from __future__ import annotations

import re
from dataclasses import asdict

from playwright.sync_api import expect

from tests.browser.person import Person
from vision.teaching.document import Document, MarkedFeature
from vision.teaching.editor.grasp_pose import GraspPose
from vision.teaching.events import PlaceGrasp, SetBore, pose_of

LABELS = {
    "x_mm": "x, mm",
    "y_mm": "y, mm",
    "z_mm": "z, mm",
    "tilt_deg": "Tilt, °",
    "azimuth_deg": "Azimuth, °",
    "turn_deg": "Turn, °",
}


def repeat(document: Document, person: Person) -> None:
    """Teach a document from start to end."""
    for feature in document.features:
        teach_feature(feature, person)
    person.tab("Grasp")
    if document.bore is not None:
        take_bore(document, document.bore, person)
    for grasp in document.grasps:
        place_grasp(grasp, person)


def teach_feature(feature: MarkedFeature, person: Person) -> None:
    """A new feature, its name, its clicks in every view."""
    rows = person.page.locator(".teach-feature:visible")
    count = rows.count()
    person.press("n")
    expect(rows).to_have_count(count + 1)
    expect(person.field("Name")).to_have_value(re.compile("circle [0-9]+"))
    person.fill("Name", feature.name)
    if feature.role == "supporting":
        person.button("Supporting")
        person.fill("Copies", str(feature.copies))
    for number, points in feature.marks.items():
        person.look(number)
        for point in points:
            person.click(point)
        person.wait()


def take_bore(document: Document, bore: SetBore, person: Person) -> None:
    """The bore from its circle, then its numbers."""
    front = pose_of(bore.T_part_bore).rotation.as_matrix()[2, 2] < 0
    entry = next(f.name for f in document.features if f.name == ("bore_front" if front else "bore_back"))
    person.page.get_by_label("From a circle").click()
    person.page.get_by_role("option", name=entry, exact=True).click()
    person.button("Take the circle")
    person.fill("Diameter, mm", f"{1e3 * bore.diameter_m:.4f}")
    person.fill("Depth, mm", f"{1e3 * bore.depth_m:.4f}")


def place_grasp(grasp: PlaceGrasp, person: Person) -> None:
    """A new grasp, and its numbers."""
    rows = person.page.locator(".teach-feature:visible")
    count = rows.count()
    person.button("New")
    expect(rows).to_have_count(count + 1)
    expect(person.field("Name")).to_have_value("grasp")
    person.fill("Name", grasp.name)
    if grasp.kind == "inside":
        person.button("Open inside")
    for name, value in asdict(GraspPose.of(pose_of(grasp.T_part_tcp))).items():
        person.fill(LABELS[name], f"{value:.4f}")
    person.fill("Width, mm", f"{1e3 * grasp.width_m:.4f}")
    person.fill("Copies", str(grasp.copies))
