// What the pointer does on the stage (../stage.js): methods of that component.
import { nearestContour, nearestPoint } from "./geometry.js";

const REACH = 9; // pixels of the screen

export const pointerMethods = {
  at(event) {
    const box = this.$refs.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  },
  markedPoints() {
    return this.state.views[this.number].marks[this.state.feature]?.points ?? [];
  },
  sense(place) {
    const pixel = this.viewport.toPicture(place);
    const reach = REACH / this.viewport.scale;
    this.hover.point = nearestPoint(this.markedPoints(), pixel, reach);
    const overlay = this.album.views[this.number].overlay;
    const picking = this.tool === "pick" && this.hover.point < 0 && overlay;
    this.hover.candidate = picking ? nearestContour(overlay.candidates, pixel, 1.5 * reach) : undefined;
    this.over = this.hover.point >= 0 ? "point" : this.hover.candidate ? "candidate" : "";
    this.place = this.viewport.contains(pixel) ? `x ${pixel[0].toFixed(1)}   y ${pixel[1].toFixed(1)}` : "";
    this.hint = this.hover.candidate ? describe(this.hover.candidate) : "";
  },
  onWheel(event) {
    const step = event.deltaMode === 1 ? 30 * event.deltaY : event.deltaY;
    this.viewport.zoom(Math.exp(-step / 500), this.at(event));
    this.refresh();
  },
  onDown(event) {
    this.$refs.canvas.focus({ preventScroll: true });
    this.$refs.canvas.setPointerCapture(event.pointerId);
    const place = this.at(event);
    this.sense(place);
    if (event.button === 2) {
      if (this.hover.point >= 0) this.removePoint(this.hover.point);
    } else if (event.button === 1 || this.spaceHeld) {
      event.preventDefault();
      this.gesture = { kind: "pan", place, moved: true };
    } else if (this.hover.point >= 0) {
      const points = this.markedPoints().map((p) => [...p]);
      this.gesture = { kind: "point", index: this.hover.point, points, place, moved: false, asked: 0 };
    } else this.gesture = { kind: "click", place, moved: false };
  },
  onMove(event) {
    const place = this.at(event);
    this.pointer = place;
    const gesture = this.gesture;
    if (!gesture) this.sense(place);
    else {
      if (Math.hypot(place[0] - gesture.place[0], place[1] - gesture.place[1]) > 4) gesture.moved = true;
      if (gesture.kind === "point") this.dragPoint(gesture, place);
      else if (gesture.moved) {
        this.dragging = true;
        gesture.kind = "pan";
        const from = gesture.last ?? gesture.place;
        this.viewport.pan(place[0] - from[0], place[1] - from[1]);
        gesture.last = place;
      }
    }
    this.refresh();
  },
  dragPoint(gesture, place) {
    if (!gesture.moved) return;
    gesture.points[gesture.index] = this.viewport.toPicture(place);
    if (gesture.waiting || gesture.points.length < 5) return;
    gesture.waiting = true;
    gesture.asked += 1;
    this.$emit("preview", { view: this.number, points: gesture.points, turn: gesture.asked });
  },
  onUp(event) {
    const gesture = this.gesture;
    this.onCancel();
    if (!gesture) return;
    const [x, y] = this.viewport.toPicture(this.at(event));
    if (gesture.kind === "point" && gesture.moved) {
      this.act({ kind: "move", index: gesture.index, x, y });
      const mark = this.state.views[this.number].marks[this.state.feature];
      if (mark) mark.points[gesture.index] = [x, y];
    } else if (gesture.kind === "click") this.click([x, y]);
    this.refresh();
  },
  onCancel() {
    this.gesture = undefined;
    this.dragging = false;
  },
  onLeave() {
    this.pointer = undefined;
    this.place = "";
    this.hover = { point: -1, candidate: undefined };
    this.refresh();
  },
  click([x, y]) {
    if (!this.viewport.contains([x, y])) return;
    if (this.tool === "points") this.act({ kind: "point", x, y });
    else if (this.hover.candidate) {
      const { extractor, ellipse } = this.hover.candidate;
      this.act({ kind: "choose", extractor, ellipse });
    } else this.hint = "No ellipse was found here. Press P and click five points along the contour.";
  },
  removePoint(index) {
    this.hover.point = -1;
    this.act({ kind: "remove", index });
  },
  act(act) {
    this.outbox.push({ ...act, view: this.number, feature: this.state.feature ?? null });
    this.refresh();
  },
};

function describe({ extractor, ellipse, support }) {
  const name = extractor === "region" ? "region growing" : "edge grouping";
  const [, , a, b] = ellipse;
  return `${name}: ${(2 * a).toFixed(1)} × ${(2 * b).toFixed(1)} px, ${Math.round(100 * support)} % of the contour. Click to take it.`;
}
