// Zoom and pan: from pixels of the picture to pixels of the canvas and back.

const LARGEST = 32;

export class Viewport {
  constructor() {
    this.scale = 1;
    this.x = 0;
    this.y = 0;
    this.fitted = true;
    this.size = [1, 1];
    this.picture = [640, 480];
  }

  /** The canvas has another size; a picture that was fitted stays so. */
  resize(width, height) {
    const centre = this.toPicture([this.size[0] / 2, this.size[1] / 2]);
    this.size = [width, height];
    if (this.fitted) this.fit();
    else this.centreOn(centre);
  }

  show(width, height) {
    const changed = this.picture[0] !== width || this.picture[1] !== height;
    this.picture = [width, height];
    if (changed || this.fitted) this.fit();
  }

  get fittingScale() {
    return Math.min(this.size[0] / this.picture[0], this.size[1] / this.picture[1]);
  }

  fit() {
    this.fitted = true;
    this.scale = this.fittingScale;
    this.x = (this.size[0] - this.scale * this.picture[0]) / 2;
    this.y = (this.size[1] - this.scale * this.picture[1]) / 2;
  }

  /** Zoom by a factor and keep a place of the canvas where it is. */
  zoom(factor, [x, y] = [this.size[0] / 2, this.size[1] / 2]) {
    const least = 0.5 * this.fittingScale;
    const scale = Math.min(Math.max(this.scale * factor, least), LARGEST);
    this.x = x - ((x - this.x) * scale) / this.scale;
    this.y = y - ((y - this.y) * scale) / this.scale;
    this.scale = scale;
    this.fitted = false;
    this.hold();
  }

  pan(dx, dy) {
    this.x += dx;
    this.y += dy;
    this.fitted = false;
    this.hold();
  }

  centreOn([x, y]) {
    this.x = this.size[0] / 2 - this.scale * (x + 0.5);
    this.y = this.size[1] / 2 - this.scale * (y + 0.5);
    this.hold();
  }

  /** Move just enough that a place of the picture is well inside the canvas. */
  reveal(place) {
    const [x, y] = this.toCanvas(place);
    const margin = 40;
    const dx = Math.max(margin - x, 0) + Math.min(this.size[0] - margin - x, 0);
    const dy = Math.max(margin - y, 0) + Math.min(this.size[1] - margin - y, 0);
    if (dx || dy) this.pan(dx, dy);
  }

  /** Never lose the picture: its part in the canvas is at least 80 px each way. */
  hold() {
    const within = (offset, room, length) => Math.min(Math.max(offset, 80 - length), room - 80);
    this.x = within(this.x, this.size[0], this.scale * this.picture[0]);
    this.y = within(this.y, this.size[1], this.scale * this.picture[1]);
  }

  /** A whole number is the centre of a pixel. */
  toCanvas([x, y]) {
    return [this.x + this.scale * (x + 0.5), this.y + this.scale * (y + 0.5)];
  }

  toPicture([x, y]) {
    return [(x - this.x) / this.scale - 0.5, (y - this.y) / this.scale - 0.5];
  }

  contains([x, y]) {
    return x >= -0.5 && y >= -0.5 && x < this.picture[0] - 0.5 && y < this.picture[1] - 0.5;
  }
}
