// Distances in the picture. An ellipse is [x, y, semi-major, semi-minor, angle], pixels and radians.

/** First-order (Sampson) distance of a point from the contour of an ellipse, in pixels. */
export function contourDistance([cx, cy, a, b, angle], [x, y]) {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  const u = c * (x - cx) + s * (y - cy);
  const v = -s * (x - cx) + c * (y - cy);
  const value = (u * u) / (a * a) + (v * v) / (b * b) - 1;
  const gradient = 2 * Math.hypot(u / (a * a), v / (b * b));
  return gradient > 1e-12 ? Math.abs(value) / gradient : b;
}

/** The candidate whose contour passes nearest to a point, within a reach in pixels; undefined where none does. */
export function nearestContour(candidates, point, reach) {
  let best;
  let least = reach;
  for (const candidate of candidates) {
    const distance = contourDistance(candidate.ellipse, point);
    if (distance < least) {
      least = distance;
      best = candidate;
    }
  }
  return best;
}

/** The number of the point nearest to a place, within a reach in pixels; -1 where none is. */
export function nearestPoint(points, [x, y], reach) {
  let best = -1;
  let least = reach;
  points.forEach(([px, py], index) => {
    const distance = Math.hypot(px - x, py - y);
    if (distance < least) {
      least = distance;
      best = index;
    }
  });
  return best;
}
