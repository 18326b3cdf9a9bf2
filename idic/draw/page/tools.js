// Pointer and keyboard on the canvas: each tool turns points of the image into changes of the drawing.

const REACH = 14; // CSS pixels around a handle, a line or the first corner
const KEYS = { v: "select", p: "polygon", c: "corner", a: "arc", n: "notch", h: "circle", g: "polyhole", s: "scale", x: "axes" };
const HINTS = {
  polygon: "Set the corners of the outline. Enter, or the first corner, closes it; Esc gives up.",
  polyhole: "Set the corners of the hole. Enter, or the first corner, closes it; Esc gives up.",
  corner: "Choose the place on a line for a new corner.", arc: "Choose a line: it becomes an arc, or straight again. Drag the point in its middle.",
  notch: "Choose the place of a round notch on a line.", circle: "Set the centre of the hole, then a point on its edge.",
  scale: "Set two points whose distance you know.", axes: "Set the origin of the mesh, then a point in the direction of x.",
};

export class Tools {
  constructor(view, sketch, actions) {
    Object.assign(this, { view, sketch, actions, tool: "select", points: [], selected: null, line: null, cross: null, pointers: new Map() });
    const canvas = view.canvas;
    canvas.addEventListener("pointerdown", (e) => this.down(e));
    canvas.addEventListener("pointermove", (e) => this.move(e));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (e) => this.up(e));
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); view.zoom(Math.exp(-e.deltaY * 0.0015), this.place(e)); }, { passive: false });
    canvas.addEventListener("keydown", (e) => this.key(e));
    document.addEventListener("keydown", (e) => {
      if (e.ctrlKey || e.metaKey || e.altKey) { if (e.key.toLowerCase() === "z" && !/^(INPUT|SELECT|TEXTAREA)$/.test(e.target.tagName)) { e.preventDefault(); this.undo(); } return; }
      if (/^(INPUT|SELECT|TEXTAREA)$/.test(e.target.tagName)) return;
      if (KEYS[e.key]) this.choose(KEYS[e.key]);
      if (e.key === "0") view.fit();
    });
    document.querySelectorAll("[data-tool]").forEach((button) => button.addEventListener("click", () => this.choose(button.dataset.tool)));
  }

  choose(tool) {
    Object.assign(this, { tool, points: [] });
    document.querySelectorAll("[data-tool]").forEach((b) => b.setAttribute("aria-pressed", String(b.dataset.tool === tool)));
    document.getElementById("hint").textContent = HINTS[tool] || "";
    if (tool !== "select") this.view.canvas.focus({ preventScroll: true });
    this.actions.paint();
  }

  place(e) { const box = this.view.canvas.getBoundingClientRect(); return [e.clientX - box.left, e.clientY - box.top]; }
  distance(at, place) { const s = this.view.toScreen(at); return Math.hypot(s[0] - place[0], s[1] - place[1]); }
  handleAt(place) {
    let best = null;
    this.sketch.handles().forEach((handle, number) => { const d = this.distance(handle.at, place); if (d < REACH && (!best || d < best.d)) best = { ...handle, number, d }; });
    return best;
  }
  lineAt(place, outlineOnly) {
    const line = this.sketch.line(this.view.toImage(place), outlineOnly);
    return line && this.distance(line.at, place) < REACH ? line : null;
  }

  forgetLine() { // its number may be that of another line now
    this.line = null;
    this.actions.lineChosen(null);
  }

  down(e) {
    const place = this.place(e);
    this.view.canvas.focus({ preventScroll: true });
    this.pointers.set(e.pointerId, place);
    this.view.canvas.setPointerCapture(e.pointerId);
    if (this.pointers.size === 2) { this.drag = { kind: "pinch" }; return; }
    const handle = this.tool === "select" || this.tool === "arc" ? this.handleAt(place) : null;
    if (handle) { this.sketch.remember(); this.selected = handle.number; this.drag = { kind: "handle", number: handle.number, moved: false }; }
    else this.drag = { kind: "press", from: place, last: place, panned: e.button === 1 };
    this.actions.paint();
  }

  move(e) {
    const place = this.place(e), before = this.pointers.get(e.pointerId);
    if (this.points.length || this.tool !== "select") { this.cross = this.view.toImage(place); this.actions.paint(); }
    if (!before) return;
    this.pointers.set(e.pointerId, place);
    const drag = this.drag;
    if (drag?.kind === "pinch" && this.pointers.size === 2) {
      const [a, b] = [...this.pointers.values()], other = a === place ? b : a;
      const was = Math.hypot(before[0] - other[0], before[1] - other[1]), now = Math.hypot(place[0] - other[0], place[1] - other[1]);
      this.view.zoom(now / Math.max(was, 1), [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
      this.view.pan((place[0] - before[0]) / 2, (place[1] - before[1]) / 2);
    } else if (drag?.kind === "handle") {
      drag.moved = true;
      this.sketch.handles()[drag.number]?.move(this.inImage(this.view.toImage(place)));
      this.actions.drawn(false);
    } else if (drag?.kind === "press") {
      if (Math.hypot(place[0] - drag.from[0], place[1] - drag.from[1]) > 5) drag.panned = true;
      if (drag.panned) this.view.pan(place[0] - drag.last[0], place[1] - drag.last[1]);
      drag.last = place;
    }
  }

  up(e) {
    const drag = this.drag, place = this.place(e);
    this.pointers.delete(e.pointerId);
    if (this.pointers.size) return;
    this.drag = null;
    if (e.type === "pointercancel" || !drag) return;
    if (drag.kind === "handle") { drag.moved ? this.actions.drawn(true) : this.sketch.past.pop(); this.forgetLine(); this.actions.paint(); }
    else if (drag.kind === "press" && !drag.panned) this.point(place);
  }

  inImage([x, y]) { return [Math.min(Math.max(x, 0), this.view.width - 1), Math.min(Math.max(y, 0), this.view.height - 1)]; }

  // a point was set, by pointer or keyboard
  point(place) {
    const at = this.inImage(this.view.toImage(place)), { sketch, tool } = this;
    if (tool === "select") {
      this.selected = null;
      this.line = this.lineAt(place, true);
      this.actions.lineChosen(this.line);
      return this.actions.paint();
    }
    if (tool === "polygon" || tool === "polyhole") {
      if (this.points.length > 2 && this.distance(this.points[0], place) < REACH) return this.close();
      this.points.push(at);
      return this.actions.paint();
    }
    if (tool === "circle" || tool === "scale" || tool === "axes") {
      this.points.push(at);
      if (this.points.length === 2) {
        const [a, b] = this.points;
        if (tool === "circle") { sketch.remember(); sketch.holes.push({ circle: [a[0], a[1], Math.max(Math.hypot(b[0] - a[0], b[1] - a[1]), 1)] }); this.actions.drawn(true); }
        if (tool === "scale") this.actions.scaled(a, b);
        if (tool === "axes") this.actions.axes(a, b);
        this.choose("select");
      }
      return this.actions.paint();
    }
    const line = this.lineAt(place, false);
    if (!line) return;
    sketch.remember();
    this.forgetLine();
    if (tool === "corner") sketch.addCorner(line);
    if (tool === "arc") sketch.toggleArc(line);
    if (tool === "notch") sketch.addNotch(line, this.actions.notchRadius());
    this.actions.drawn(true);
    if (tool !== "corner") this.choose("select");
  }

  close() {
    if (this.points.length < 3) return;
    const corners = this.points.map(([x, y]) => ({ x, y, arc: null, name: "" }));
    this.sketch.remember();
    this.forgetLine();
    if (this.tool === "polygon") { this.sketch.corners = corners; this.sketch.circle = null; this.sketch.nameEnds(); }
    else this.sketch.holes.push({ corners });
    this.choose("select");
    this.actions.drawn(true);
  }

  remove() {
    const handle = this.sketch.handles()[this.selected];
    if (!handle) return;
    this.sketch.remember(); handle.remove(); this.selected = null;
    this.forgetLine();
    this.actions.drawn(true);
  }

  undo() { this.sketch.undo(); this.selected = null; this.forgetLine(); this.actions.drawn(true); }

  key(e) {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }, { view } = this;
    const arrow = arrows[e.key], middle = [view.canvas.clientWidth / 2, view.canvas.clientHeight / 2];
    if (arrow) {
      const step = e.shiftKey ? 10 : 1, handles = this.sketch.handles();
      if (this.tool === "select" && this.selected !== null && handles[this.selected]) {
        this.sketch.remember();
        const at = handles[this.selected].at;
        handles[this.selected].move(this.inImage([at[0] + arrow[0] * step, at[1] + arrow[1] * step]));
        this.actions.drawn(true);
      } else if (this.tool === "select") view.pan(-arrow[0] * 40, -arrow[1] * 40);
      else { const from = this.cross || view.toImage(middle); this.cross = this.inImage([from[0] + arrow[0] * step, from[1] + arrow[1] * step]); this.actions.paint(); }
    } else if (e.key === "[" || e.key === "]") {
      const n = this.sketch.handles().length, from = this.selected ?? (e.key === "]" ? -1 : 0);
      this.selected = n ? (from + (e.key === "]" ? 1 : n - 1)) % n : null;
      this.actions.paint();
    } else if (e.key === "Enter" || e.key === " ") {
      if (e.key === "Enter" && this.points.length > 2 && this.tool.startsWith("poly")) this.close();
      else if (this.tool !== "select") { this.cross ||= view.toImage(middle); this.point(view.toScreen(this.cross)); }
    } else if (e.key === "Escape") { this.selected = null; this.choose("select"); }
    else if (e.key === "Delete" || e.key === "Backspace") this.remove();
    else if (e.key === "+" || e.key === "-") view.zoom(e.key === "+" ? 1.25 : 0.8, middle);
    else return;
    e.preventDefault();
  }
}
