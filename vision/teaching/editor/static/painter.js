// Draws one picture with everything that is known about it.

const REGION = "#f2a541";
const GROUP = "#59c3ff";
const BAD = "#ff5d5d";
const GUIDE = "#ffe066";
const PATTERN = "#63e6be";
const LOUPE_PX = 132;
const LOUPE_ZOOM = 5;

/** Draw a scene: {canvas, viewport, picture, view, features, feature, show, tool, hover, drag, pending, cursor, ...}. */
export function paint(scene) {
  const context = scene.canvas.getContext("2d");
  const ratio = window.devicePixelRatio || 1;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, ...scene.viewport.size);
  if (!scene.picture?.image.complete) return;
  layer(context, scene, scene.viewport, ratio);
  if (scene.loupe && scene.pointer && scene.viewport.scale < 6) loupe(context, scene, ratio);
}

function layer(context, scene, viewport, ratio) {
  context.save();
  const { scale, x, y } = viewport;
  const pen = { context, scale, width: (pixels) => pixels / scale };
  context.setTransform(ratio * scale, 0, 0, ratio * scale, ratio * x, ratio * y);
  backdrop(context, scene, scale);
  context.translate(0.5, 0.5);
  candidates(pen, scene);
  if (scene.show.patterns) patterns(pen, scene);
  if (scene.show.circles) circles(pen, scene);
  if (scene.show.guides) guides(pen, scene);
  marks(pen, scene);
  crosshair(pen, scene);
  context.restore();
}

function backdrop(context, scene, scale) {
  const { image, width, height, overlay } = scene.picture;
  context.imageSmoothingEnabled = scale < 3;
  context.drawImage(image, 0, 0, width, height);
  context.imageSmoothingEnabled = false;
  if (scene.show.regions && overlay?.regions.complete) {
    context.globalAlpha = 0.55;
    context.drawImage(overlay.regions, 0, 0, width, height);
    context.globalAlpha = 1;
  }
  if (scene.show.edges && overlay?.edges.complete) context.drawImage(overlay.edges, 0, 0, width, height);
}

function candidates(pen, scene) {
  const overlay = scene.picture.overlay;
  if (!overlay) return;
  if (scene.show.groups) groups(pen, overlay);
  for (const candidate of overlay.candidates) {
    const region = candidate.extractor === "region";
    const shown = region ? scene.show.regions : scene.show.groups;
    if (!shown && scene.tool !== "pick") continue;
    const alpha = shown ? 0.95 : 0.4;
    stroke(pen, candidate.ellipse, region ? REGION : GROUP, { alpha, width: shown ? 1.4 : 1, dash: [2, 3] });
  }
  if (scene.hover.candidate) {
    const { ellipse, extractor } = scene.hover.candidate;
    stroke(pen, ellipse, extractor === "region" ? REGION : GROUP, { alpha: 0.3, width: 9 });
    stroke(pen, ellipse, "#ffffff", { width: 2 });
  }
}

function groups({ context, width }, overlay) {
  context.lineCap = "round";
  context.lineWidth = width(1.3);
  context.strokeStyle = "rgba(190, 200, 215, 0.55)";
  context.stroke(overlay.paths.single);
  overlay.paths.groups.forEach((path, number) => {
    context.strokeStyle = `hsl(${(number * 137.5) % 360} 85% 62%)`;
    context.lineWidth = width(2.6);
    context.stroke(path);
  });
  context.fillStyle = "#ffffff";
  const side = width(3.4);
  for (const [x, y] of overlay.endpoints) context.fillRect(x - side / 2, y - side / 2, side, side);
}

function circles(pen, scene) {
  for (const [id, circle] of Object.entries(scene.view.circles)) {
    const chosen = id === scene.feature;
    const colour = circle.bad ? BAD : scene.features[id]?.colour;
    if (!chosen) stroke(pen, circle.ellipse, "#000000", { alpha: 0.35, width: 2.6 });
    stroke(pen, circle.ellipse, colour, { alpha: chosen ? 1 : 0.75, width: chosen ? 1.6 : 1.2 });
    if (chosen && circle.label) label(pen, circle.ellipse, circle.label, circle.bad ? BAD : colour);
  }
}

function patterns({ context, width }, scene) {
  const side = width(2.6);
  for (const points of Object.values(scene.view.patterns)) {
    context.fillStyle = "rgba(8, 11, 16, 0.6)";
    for (const [x, y] of points) context.fillRect(x - side, y - side, 2 * side, 2 * side);
    context.fillStyle = PATTERN;
    for (const [x, y] of points) context.fillRect(x - side / 2, y - side / 2, side, side);
  }
}

function guides(pen, scene) {
  const guide = scene.guide;
  if (!guide || guide.view !== scene.number || guide.feature !== scene.feature) return;
  const { context, width } = pen;
  context.strokeStyle = GUIDE;
  context.globalAlpha = 0.5;
  context.lineWidth = width(1);
  for (const curve of guide.curves) {
    context.beginPath();
    curve.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
  }
  context.globalAlpha = 1;
  if (guide.predicted) stroke(pen, guide.predicted, GUIDE, { width: 1.8, dash: [7, 5] });
}

function marks(pen, scene) {
  const mark = scene.view.marks[scene.feature];
  const colour = scene.features[scene.feature]?.colour ?? "#ffffff";
  const fit = scene.drag?.fit ?? mark?.ellipse;
  if (fit && !(scene.show.circles && scene.view.circles[scene.feature] && !scene.drag)) {
    stroke(pen, fit, "#000000", { alpha: 0.4, width: 3.2 });
    stroke(pen, fit, colour, { width: 1.8 });
  }
  const points = scene.drag?.points ?? mark?.points ?? [];
  const suspects = new Set(mark?.suspects ?? []);
  points.forEach((point, index) => {
    const active = index === scene.hover.point || index === scene.drag?.index;
    dot(pen, point, suspects.has(index) ? BAD : colour, active ? 6 : 4, suspects.has(index) ? String(index + 1) : "");
  });
  for (const act of scene.pending) dot(pen, [act.x, act.y], colour, 4, "");
}

function crosshair({ context, width }, scene) {
  if (!scene.cursor) return;
  const [x, y] = scene.cursor;
  context.strokeStyle = "#ffffff";
  context.lineWidth = width(1.2);
  context.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    context.moveTo(x + dx * width(5), y + dy * width(5));
    context.lineTo(x + dx * width(18), y + dy * width(18));
  }
  context.stroke();
}

function stroke({ context, width }, [x, y, a, b, angle], colour, { alpha = 1, width: pixels = 1.5, dash = [] }) {
  context.globalAlpha = alpha;
  context.strokeStyle = colour;
  context.lineWidth = width(pixels);
  context.setLineDash(dash.map(width));
  context.beginPath();
  context.ellipse(x, y, a, b, angle, 0, 2 * Math.PI);
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

function dot({ context, width }, [x, y], colour, radius, text) {
  context.beginPath();
  context.arc(x, y, width(radius), 0, 2 * Math.PI);
  context.fillStyle = "rgba(10, 14, 20, 0.35)";
  context.fill();
  context.lineWidth = width(1.8);
  context.strokeStyle = colour;
  context.stroke();
  context.fillStyle = colour;
  context.beginPath();
  context.arc(x, y, width(1.3), 0, 2 * Math.PI);
  context.fill();
  if (text) write(context, width, [x + width(9), y - width(9)], text, colour);
}

function label({ context, width }, [x, y, a, b, angle], text, colour) {
  const reach = Math.hypot(a * Math.sin(angle), b * Math.cos(angle));
  write(context, width, [x, y - reach - width(12)], text, colour, "center");
}

function write(context, width, [x, y], text, colour, align = "left") {
  context.font = `600 ${width(12)}px Inter, Roboto, sans-serif`;
  context.textAlign = align;
  context.textBaseline = "middle";
  context.lineWidth = width(3.5);
  context.lineJoin = "round";
  context.strokeStyle = "rgba(8, 11, 16, 0.85)";
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}

/** The surroundings of the pointer, enlarged, in the corner away from it. */
function loupe(context, scene, ratio) {
  const [px, py] = scene.pointer;
  const [width, height] = scene.viewport.size;
  const left = px > width - 2 * LOUPE_PX && py < 2 * LOUPE_PX ? 10 : width - LOUPE_PX - 10;
  const centre = scene.viewport.toPicture(scene.pointer);
  const scale = Math.max(LOUPE_ZOOM, 2.5 * scene.viewport.scale);
  const middle = [left + LOUPE_PX / 2, 10 + LOUPE_PX / 2];
  const view = { scale, x: middle[0] - scale * (centre[0] + 0.5), y: middle[1] - scale * (centre[1] + 0.5) };
  context.save();
  context.beginPath();
  context.roundRect(left, 10, LOUPE_PX, LOUPE_PX, 10);
  context.clip();
  context.fillStyle = "#0d1117";
  context.fillRect(left, 10, LOUPE_PX, LOUPE_PX);
  layer(context, { ...scene, cursor: undefined }, view, ratio);
  context.restore();
  context.strokeStyle = "rgba(255, 255, 255, 0.55)";
  context.lineWidth = 1;
  context.beginPath();
  context.roundRect(left, 10, LOUPE_PX, LOUPE_PX, 10);
  context.moveTo(middle[0] - 7, middle[1]);
  context.lineTo(middle[0] + 7, middle[1]);
  context.moveTo(middle[0], middle[1] - 7);
  context.lineTo(middle[0], middle[1] + 7);
  context.stroke();
}
