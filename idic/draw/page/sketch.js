// The drawing: an outline of corners with straight lines and arcs, holes, names of lines. No canvas in here.
// A hole is {circle or corners, load}: its load stays with it when another hole is removed.
// A corner is {x, y, arc: null or [xm, ym], name}: arc and name belong to the line from this corner to the next one.

const SAME_HOLE = 10; // px between the middles of a hole that is found again
const near = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

export class Sketch {
  constructor() { this.corners = []; this.circle = null; this.holes = []; this.past = []; }

  read(record) {
    this.remember();
    const { outline, holes, edge_names: names } = record;
    this.circle = typeof outline[0] === "number" ? [...outline] : null;
    this.corners = this.circle ? [] : loop(outline);
    for (const [name, numbers] of Object.entries(names || {})) for (const k of numbers) if (this.corners[k - 1]) this.corners[k - 1].name = name;
    const before = this.holes;
    this.holes = holes.map((hole) => typeof hole[0] === "number" ? { circle: [...hole] } : { corners: loop(hole) });
    for (const hole of this.holes) { const old = before.find((b) => near(middle(b), middle(hole)) < SAME_HOLE); if (old?.load) hole.load = old.load; }
  }

  record() {
    const names = {};
    this.corners.forEach((corner, k) => { if (corner.name) (names[corner.name] ||= []).push(k + 1); });
    return { outline: this.circle || entries(this.corners), holes: this.holes.map((h) => h.circle || entries(h.corners)), edge_names: names };
  }

  get names() { return [...new Set(this.corners.map((c) => c.name).filter(Boolean))]; }

  remember() { this.past.push(JSON.stringify([this.corners, this.circle, this.holes])); if (this.past.length > 100) this.past.shift(); }
  undo() { if (this.past.length > 1) [this.corners, this.circle, this.holes] = JSON.parse(this.past.pop()); }

  // everything that can be dragged: {at, move(point), remove()}
  handles() {
    const found = [];
    const ofLoop = (corners, gone) => corners.forEach((corner, k) => {
      found.push({ at: [corner.x, corner.y], kind: "corner", move: ([x, y]) => moveCorner(corners, k, x, y),
        remove: () => { if (corners.length > 3) { const before = corners[(k + corners.length - 1) % corners.length]; before.arc = null; corners.splice(k, 1); } else gone(); } });
      if (corner.arc) found.push({ at: corner.arc, kind: "arc", move: (p) => { corner.arc = p; }, remove: () => { corner.arc = null; } });
    });
    ofLoop(this.corners, () => {});
    const ofCircle = (circle, gone) => {
      found.push({ at: [circle[0], circle[1]], kind: "centre", move: ([x, y]) => { circle[0] = x; circle[1] = y; }, remove: gone });
      found.push({ at: [circle[0] + circle[2], circle[1]], kind: "radius", move: (p) => { circle[2] = Math.max(near(p, circle), 1); }, remove: gone });
    };
    if (this.circle) ofCircle(this.circle, () => {});
    this.holes.forEach((hole) => {
      const gone = () => { this.holes = this.holes.filter((other) => other !== hole); };
      hole.circle ? ofCircle(hole.circle, gone) : ofLoop(hole.corners, gone);
    });
    return found;
  }

  // the line next to a point: {corners, k, at, distance}
  line(point, outlineOnly = false) {
    let best = null;
    const loops = [this.corners, ...(outlineOnly ? [] : this.holes.filter((h) => h.corners).map((h) => h.corners))];
    for (const corners of loops) corners.forEach((_, k) => {
      const path = points(corners, k);
      for (let i = 0; i + 1 < path.length; i++) {
        const at = foot(point, path[i], path[i + 1]), distance = near(point, at);
        if (!best || distance < best.distance) best = { corners, k, at, distance };
      }
    });
    return best;
  }

  addCorner(place) {
    const { corners, k, at } = place, corner = corners[k];
    corners.splice(k + 1, 0, { x: at[0], y: at[1], arc: null, name: corner.name });
    corner.arc = null;
    return [at[0], at[1]];
  }

  toggleArc(place) {
    const { corners, k } = place, a = corners[k], b = corners[(k + 1) % corners.length];
    if (a.arc) { a.arc = null; return; }
    const inward = this.inward(corners, k), length = near([a.x, a.y], [b.x, b.y]);
    a.arc = [(a.x + b.x) / 2 + inward[0] * length * 0.12, (a.y + b.y) / 2 + inward[1] * length * 0.12];
  }

  addNotch(place, radius) {
    const { corners, k, at } = place, a = corners[k], b = corners[(k + 1) % corners.length];
    const length = near([a.x, a.y], [b.x, b.y]), t = [(b.x - a.x) / length, (b.y - a.y) / length], inward = this.inward(corners, k);
    const r = Math.min(radius, length / 4), along = Math.min(Math.max((at[0] - a.x) * t[0] + (at[1] - a.y) * t[1], 1.2 * r), length - 1.2 * r);
    const middle = [a.x + t[0] * along, a.y + t[1] * along];
    corners.splice(k + 1, 0,
      { x: middle[0] - t[0] * r, y: middle[1] - t[1] * r, arc: [middle[0] + inward[0] * r, middle[1] + inward[1] * r], name: "" },
      { x: middle[0] + t[0] * r, y: middle[1] + t[1] * r, arc: null, name: a.name });
  }

  inward(corners, k) {
    const a = corners[k], b = corners[(k + 1) % corners.length], length = near([a.x, a.y], [b.x, b.y]) || 1;
    const turn = area(corners) > 0 ? 1 : -1;
    return [-(b.y - a.y) / length * turn, (b.x - a.x) / length * turn];
  }

  // opposite ends along the longer side get the names that the first drawing would give them
  nameEnds() {
    const xs = this.corners.map((c) => c.x), ys = this.corners.map((c) => c.y);
    const box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)], tall = box[3] - box[1] > box[2] - box[0];
    const [low, high, key] = tall ? [box[1], box[3], "y"] : [box[0], box[2], "x"], reach = 0.03 * (high - low);
    this.corners.forEach((corner, k) => {
      const next = this.corners[(k + 1) % this.corners.length], both = (v) => Math.abs(corner[key] - v) < reach && Math.abs(next[key] - v) < reach;
      corner.name = both(low) ? (tall ? "TOP" : "LEFT") : both(high) ? (tall ? "BOTTOM" : "RIGHT") : "";
    });
  }
}

function moveCorner(corners, k, x, y) {
  const corner = corners[k], n = corners.length, before = corners[(k + n - 1) % n], next = corners[(k + 1) % n];
  const [dx, dy] = [x - corner.x, y - corner.y];
  for (const own of [corner, before]) if (own.arc) own.arc = [own.arc[0] + dx / 2, own.arc[1] + dy / 2];
  corner.x = x; corner.y = y;
  return next;
}

export function middle(hole) {
  const points = hole.circle ? [hole.circle] : hole.corners.map((c) => [c.x, c.y]);
  return [0, 1].map((k) => points.reduce((sum, p) => sum + p[k] / points.length, 0));
}

function loop(rows) { // [x, y] or [xm, ym, x, y]: the arc leads to its corner
  const corners = rows.map((row) => ({ x: row[row.length - 2], y: row[row.length - 1], arc: null, name: "" }));
  rows.forEach((row, k) => { if (row.length === 4) corners[(k + rows.length - 1) % rows.length].arc = [row[0], row[1]]; });
  return corners;
}

function entries(corners) {
  return corners.map((corner, k) => [...(corners[(k + corners.length - 1) % corners.length].arc || []), corner.x, corner.y].map((v) => Math.round(v * 100) / 100));
}

export function area(corners) {
  return corners.reduce((sum, a, k) => { const b = corners[(k + 1) % corners.length]; return sum + a.x * b.y - a.y * b.x; }, 0) / 2;
}

function foot(p, a, b) {
  const d = [b[0] - a[0], b[1] - a[1]], length = d[0] ** 2 + d[1] ** 2 || 1;
  const t = Math.min(Math.max(((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / length, 0), 1);
  return [a[0] + t * d[0], a[1] + t * d[1]];
}

// points along the line from corner k: two, or many on an arc through the middle point
export function points(corners, k) {
  const corner = corners[k], next = corners[(k + 1) % corners.length], a = [corner.x, corner.y], b = [next.x, next.y], m = corner.arc;
  if (!m) return [a, b];
  const chord = [b[0] - a[0], b[1] - a[1]], mid = [m[0] - a[0], m[1] - a[1]], twice = chord[0] * mid[1] - chord[1] * mid[0];
  const square = chord[0] ** 2 + chord[1] ** 2;
  if (Math.abs(twice) < 1e-4 * square) return [a, b];
  const offset = (mid[0] ** 2 + mid[1] ** 2 - mid[0] * chord[0] - mid[1] * chord[1]) / (2 * twice);
  const centre = [a[0] + chord[0] / 2 - offset * chord[1], a[1] + chord[1] / 2 + offset * chord[0]], radius = near(a, centre);
  const first = Math.atan2(a[1] - centre[1], a[0] - centre[0]), last = Math.atan2(b[1] - centre[1], b[0] - centre[0]), turn = 2 * Math.PI;
  const sweep = twice < 0 ? ((last - first) % turn + turn) % turn : -(((first - last) % turn + turn) % turn);
  const steps = Math.max(8, Math.ceil(Math.abs(sweep) / 0.1));
  return Array.from({ length: steps + 1 }, (_, i) => i === steps ? b : [centre[0] + radius * Math.cos(first + sweep * i / steps), centre[1] + radius * Math.sin(first + sweep * i / steps)]);
}
