// The page: fields and what follows from them. The drawing is in sketch.js, the canvas in view.js, tools.js and paint.js.

import { Refused, get, post } from "./api.js";
import { short, sparkline } from "./sparkline.js";
import { colourOf, paintAll } from "./paint.js";
import { RunWatch, element } from "./run.js";
import { Sketch } from "./sketch.js";
import { Tools } from "./tools.js";
import { View } from "./view.js";

const $ = (id) => document.getElementById(id);
const number = (id) => { const v = Number.parseFloat($(id).value.replace(",", ".")); return Number.isFinite(v) ? v : null; };
const context = $("canvas").getContext("2d");
const sketch = new Sketch();
const page = { files: null, images: "", log: null, mesh: null, scale: null, axes: null, motions: {}, componentChosen: false, noise: null, drawn: 0 };
let queued = false;
const paint = () => { if (!queued) { queued = true; requestAnimationFrame(() => { queued = false; draw(); }); } };
const view = new View($("canvas"), paint);
const watch = new RunWatch();
const tools = new Tools(view, sketch, { paint, drawn, lineChosen, scaled, axes: setAxes, notchRadius: () => 1.5 * elementSize() });

function draw() {
  paintAll(context, { view, sketch, tools, mesh: page.mesh, scale: page.scale, axes: axesNow(), showFloor: $("show-floor").checked, holeNames: holeNames() });
}

function legend() {
  const box = $("legend"), floor = page.mesh && $("show-floor").checked;
  box.hidden = !floor;
  if (floor) { const known = page.mesh.floor.filter((v) => v !== null).sort((a, b) => a - b); box.replaceChildren(`${short(known[0], 2)}`, element("i", [], "floor"), `${short(known.at(Math.floor(known.length * 0.98)) ?? known.at(-1), 2)} px`); }
}

// the drawing ---------------------------------------------------------------------------------------------
let meshTimer = 0;
function drawn(done) {
  page.drawn++;
  page.mesh = null;
  paint();
  edgeTable();
  clearTimeout(meshTimer);
  meshTimer = setTimeout(remesh, done ? 30 : 250);
}

async function remesh() {
  if (!sketch.corners.length && !sketch.circle) return;
  const number = page.drawn;
  $("mesh-text").textContent = "meshing …";
  try {
    const mesh = await post("mesh", { images: page.images, sketch: sketchRecord() });
    if (number !== page.drawn) return;
    page.mesh = mesh;
    tellMesh();
  } catch (error) { if (number === page.drawn) $("mesh-text").textContent = words(error); }
  legend(); paint();
}

function tellMesh() {
  const { mesh } = page, size = number("pixel"), floor = mesh.floor_median;
  const um = floor !== null && size ? ` = ${short(floor * size * 1000, 2)} µm` : "";
  $("mesh-text").textContent = `${mesh.elements.length} elements, ${mesh.nodes.length} nodes, smallest angle ${mesh.smallest_angle.toFixed(0)}°, ${mesh.px_per_element.toFixed(0)} px per element. ` +
    (floor === null ? "No pattern: nothing can be measured." : `Noise floor of the displacement of a whole element: ${short(floor, 2)} px${um} (median), without the smoothing of a free FE-DIC.`);
}

function sketchRecord() { return { ...sketch.record(), element_px: elementSize(), elements: $("elements").value, mesher: $("mesher").value }; }
function sizeRange() { const short = Math.min(view.width, view.height); return [Math.max(4, short / 300), short / 2]; }
function elementSize() { const [low, high] = sizeRange(); return Math.round(low * (high / low) ** ($("size").value / 100) * 10) / 10; }
function setElementSize(size) { const [low, high] = sizeRange(); $("size").value = Math.round(100 * Math.log(size / low) / Math.log(high / low)); sizeText(); }
function sizeText() { const size = number("pixel"); $("size-text").textContent = `${elementSize()} px${size ? ` = ${short(elementSize() * size, 3)} mm` : ""}`; }

async function findArea() {
  $("area-text").textContent = "looking for the speckled area …";
  try {
    const area = await get("area", { images: page.images });
    page.noise = area.noise_gv;
    $("area-text").textContent = (area.found ? "Speckled area found; drag its corners to correct it." : "No speckled area found: draw the outline.") +
      ` Noise of this image ${short(area.noise_gv, 2)} grey values${area.speckle_px ? `, speckle ${short(area.speckle_px, 2)} px` : ""}.`;
    return area.sketch;
  } catch (error) { $("area-text").textContent = words(error); return null; }
}

function take(record) {
  tools.forgetLine();
  sketch.read(record);
  $("elements").value = record.elements; $("mesher").value = page.files.gmsh ? record.mesher : "idic";
  setElementSize(record.element_px);
  drawn(true);
}

// scale and axes ------------------------------------------------------------------------------------------
function scaled(a, b) { page.scale = [a, b]; if (number("distance")) fromDistance(); $("distance").focus(); }
function fromDistance() {
  const mm = number("distance");
  if (!page.scale || !mm) return;
  const [a, b] = page.scale;
  $("pixel").value = String(Number((mm / Math.hypot(b[0] - a[0], b[1] - a[1])).toPrecision(6)));
  pixelChanged();
}
function pixelChanged() { sizeText(); if (page.mesh) tellMesh(); wanted(); }

function setAxes(a, b) { page.axes = { origin: a, angle: Math.atan2(a[1] - b[1], b[0] - a[0]) }; axesText(); edgeTable(); }
function axesNow() {
  if (page.axes) return page.axes;
  const xs = sketch.circle ? [sketch.circle[0]] : sketch.corners.map((c) => c.x), ys = sketch.circle ? [sketch.circle[1]] : sketch.corners.map((c) => c.y);
  return xs.length ? { origin: [Math.min(...xs), Math.max(...ys)], angle: 0 } : null;
}
function axesText() { const at = axesNow(); $("axes-text").textContent = at ? `origin (${at.origin.map((v) => v.toFixed(0)).join(", ")}), x at ${(at.angle * 180 / Math.PI).toFixed(1)}°` : ""; }

// edges and log -------------------------------------------------------------------------------------------
function lineChosen(line) {
  $("edge-name-row").hidden = !line;
  if (line) { $("edge-name").value = line.corners[line.k].name; $("card-edges").open = true; if (!matchMedia("(max-width: 760px)").matches) $("edge-name").focus(); }
}
function nameLine() {
  const name = $("edge-name").value.trim().replace(/[^A-Za-z0-9_]/g, "_").replace(/^[^A-Za-z]+/, "");
  if (!tools.line) return;
  sketch.remember();
  tools.line.corners[tools.line.k].name = name;
  drawn(true);
}

function componentOf(name) { // of the mesh along which an edge faces
  const own = sketch.corners.map((c, k) => [c, sketch.corners[(k + 1) % sketch.corners.length]]).filter(([c]) => c.name === name);
  const along = own.reduce((sum, [a, b]) => [sum[0] + Math.abs(b.x - a.x), sum[1] + Math.abs(b.y - a.y)], [0, 0]);
  const turned = Math.abs(Math.sin(axesNow()?.angle || 0)) > 0.7;
  return (along[0] > along[1]) !== turned ? "y" : "x";
}

function edgeNames() { return sketch.names.length ? sketch.names : ["OUTER"]; } // OUTER: the whole outline
function columnsOf(kind) { return page.log?.columns.filter((c) => c.kind === kind) || []; }
function holeNames() { return columnsOf("pressure").length ? sketch.holes.map((_, k) => `HOLE${k + 1}`) : []; } // a pressure is all that acts on a hole
function underPressure() { return [...edgeNames(), ...holeNames()].some((name) => motionOf(name).kind === "pressure"); }
function motionOf(name) {
  const hole = sketch.holes[holeNames().indexOf(name)];
  return hole ? hole.load ||= { kind: "free" } : page.motions[name] ||= { kind: "measured" };
}
function setMotion(name, motion) {
  const hole = sketch.holes[holeNames().indexOf(name)];
  if (hole) hole.load = motion; else page.motions[name] = motion;
}
function forgetColumns() { // of a log that is no longer chosen
  const gone = ({ column }) => column && !page.log?.columns.some((c) => c.name === column);
  for (const name of Object.keys(page.motions)) if (gone(page.motions[name])) delete page.motions[name];
  for (const hole of sketch.holes) if (hole.load && gone(hole.load)) delete hole.load;
}

function edgeTable() {
  const names = edgeNames(), holes = holeNames();
  const pressures = columnsOf("pressure").map((c) => new Option(`under the pressure ${c.name}`, `pressure:${c.name}`));
  const rows = [...names, ...holes].map((name) => {
    const hole = holes.includes(name), motion = motionOf(name), choose = document.createElement("select");
    choose.setAttribute("aria-label", `${hole ? "load" : "motion or load"} of ${name}`);
    if (!hole) choose.append(new Option("moves as the images show", "measured"), new Option("held", "fixed"), ...columnsOf("travel").map((c) => new Option(`moves by ${c.name}`, `column:${c.name}`)));
    choose.append(...pressures.map((option) => option.cloneNode(true)), new Option("free surface", "free"));
    choose.value = motion.column ? `${motion.kind}:${motion.column}` : motion.kind;
    choose.addEventListener("change", () => { const [kind, column] = choose.value.split(/:(.*)/); setMotion(name, { kind, column }); identifyDefaults(); });
    const chip = element("span", [], "chip");
    chip.style.background = hole ? "#ff3b3b" : colourOf(name, names);
    return element("tr", [element("td", [chip, name]), element("td", [choose])]);
  });
  $("edges").tBodies[0].replaceChildren(...rows);
  const before = $("force-edge").value;
  $("force-edge").replaceChildren(...names.map((name) => new Option(name)));
  $("force-edge").value = names.includes(before) ? before : names.find((n) => n === "TOP" || n === "RIGHT") || names[0] || "";
  forceAlong($("force-edge").value !== before);
  axesText();
}

function forceAlong(otherEdge) { // a component that the user has chosen stays as long as its edge
  if (otherEdge) page.componentChosen = false;
  if ($("force-edge").value && !page.componentChosen) $("force-component").value = componentOf($("force-edge").value);
}

async function readLog() {
  const name = $("log").value;
  page.log = null;
  if (name) try { page.log = await get("log", { name, images: page.images }); } catch (error) { $("log-text").textContent = words(error); }
  forgetColumns();
  const log = page.log, forces = log?.columns.filter((c) => c.values.length && c.kind === "force") || [];
  if (log) $("log-text").textContent = log.matches ? `${log.rows} rows for ${log.frames} frames.` : `${log.rows} rows for ${log.frames} frames: ${log.time ? "the log is read at the times of the images." : "one row per image is needed, or a column with the time."}`;
  else if (!name) $("log-text").textContent = "Without a force only ratios of stiffness can be identified.";
  $("interval-row").hidden = !log || log.matches || !log.time;
  $("columns").replaceChildren(...(log?.columns || []).map((c) => element("div", [element("span", [c.name]), document.createElement("canvas"), element("span", [c.problem || range(c)])], "spark")));
  log?.columns.forEach((c, k) => sparkline($("columns").children[k].children[1], c.values));
  const others = log?.columns.filter((c) => c.values.length && c.kind !== "force" && c.name !== log.time) || [];
  $("force").replaceChildren(new Option("none", ""), ...[...forces, ...others].map((c) => new Option(c.name)));
  $("force").value = forces[0]?.name || "";
  $("force-row").hidden = !log;
  edgeTable(); identifyDefaults(); wanted();
}
function range(c) { const known = c.values.filter((v) => v !== null); return known.length ? `${short(Math.min(...known))} … ${short(Math.max(...known))}${c.unit ? ` ${c.unit}` : ""}` : ""; }

// law -----------------------------------------------------------------------------------------------------
function showLaw() {
  const law = page.files.laws.find((l) => l.name === $("law").value);
  $("parameters").tBodies[0].replaceChildren(...law.parameters.map((p) => {
    const value = document.createElement("input"), tick = document.createElement("input");
    value.value = String(p.typical); value.inputMode = "decimal"; value.autocomplete = "off"; value.setAttribute("aria-label", `start of ${p.name}`);
    tick.type = "checkbox"; tick.addEventListener("change", () => { row.dataset.chosen = "yes"; }); tick.setAttribute("aria-label", `identify ${p.name}`);
    const row = element("tr", [element("td", [p.name]), element("td", [value]), element("td", [p.unit === "-" ? "" : p.unit]), element("td", [tick])]);
    row.title = p.what;
    Object.assign(row.dataset, { name: p.name, stress: /Pa/.test(p.unit) ? "yes" : "" });
    return row;
  }));
  identifyDefaults();
}
function identifyDefaults() { // without a force or a pressure no stress can be identified; what the user has chosen stays
  const loaded = Boolean($("force").value) || underPressure(), rows = [...$("parameters").tBodies[0].rows];
  for (const row of rows.filter((r) => !r.dataset.chosen)) row.querySelector("[type=checkbox]").checked = row.dataset.name !== "angle" && (loaded || !row.dataset.stress);
}

// writing and running -------------------------------------------------------------------------------------
function plan() {
  const record = sketchRecord(), at = axesNow() || { origin: [0, 0], angle: 0 }, degrees = Math.round(at.angle * 180 / Math.PI * 1000) / 1000;
  const motions = {}, parameters = {};
  for (const name of [...edgeNames(), ...holeNames()]) {
    const { kind, column } = motionOf(name);
    if (kind !== "free") motions[name] = kind === "column" ? { kind, column, component: componentOf(name) } : column ? { kind, column } : { kind };
  }
  for (const row of $("parameters").tBodies[0].rows) {
    const [value, tick] = row.querySelectorAll("input"), start = Number.parseFloat(value.value.replace(",", "."));
    if (!Number.isFinite(start)) throw new Refused({ what: `the start of ${row.dataset.name} is no number`, found: value.value, remedy: "give a number" });
    parameters[row.dataset.name] = { value: start, identify: tick.checked };
  }
  const force = $("force").value && $("force-edge").value ? { column: $("force").value, edge: $("force-edge").value, component: $("force-component").value } : null;
  return { title: page.files.folder, images: page.images, loads: $("log").value || null, frame_interval_s: $("interval-row").hidden ? null : number("interval"),
    sketch: record, kind: $("kind").value, thickness_mm: number("thickness"), pixel_size_mm: number("pixel"), origin_px: at.origin, rotation_deg: degrees, motions, force, law: $("law").value, parameters };
}

function wanted() { // fields that a force needs
  for (const id of ["pixel", "thickness"]) $(id).classList.toggle("wanted", Boolean($("force").value) && !number(id));
}

function words(error) {
  const p = error.parts || { what: error.message };
  return [p.key ? `${p.what} (${p.key})` : p.what, p.expected ? `expected: ${p.expected}` : "", p.found ? `found: ${p.found}` : "", p.remedy ? `what to do: ${p.remedy}` : ""].filter(Boolean).join(". ");
}

function tell(error) {
  const p = error.parts || { what: error.message }, box = $("message");
  box.className = "bad";
  box.replaceChildren(element("b", [p.what]), ...["key", "expected", "found", "remedy"].filter((k) => p[k]).map((k) => element("div", [`${{ key: "where", remedy: "what to do" }[k] || k}: ${p[k]}`])));
}

async function write() {
  $("message").className = ""; $("message").textContent = "reading and checking everything …";
  $("lines").hidden = true;
  try {
    const found = await post("write", { plan: plan(), replace: true });
    $("message").textContent = "experiment.toml is written.";
    $("lines").textContent = found.lines.join("\n"); $("lines").hidden = false;
    $("toml").textContent = found.toml;
    return true;
  } catch (error) { tell(error); return false; }
}

async function go() {
  $("go").disabled = true;
  try {
    if (!await write()) return;
    const name = $("run-name").value.trim();
    await post("identify", { name });
    $("message").textContent = `experiment.toml is written. idic identify was started in runs/${name}; it goes on when this page is closed.`;
    watch.watch(name);
    await listRuns(name);
    $("card-run").scrollIntoView({ behavior: "smooth", block: "start" });
  } catch (error) { tell(error); } finally { $("go").disabled = false; }
}

async function listRuns(chosen) {
  const files = await get("files");
  $("run-name").value = files.next_run;
  $("runs-row").hidden = !files.runs.length;
  $("runs").replaceChildren(new Option("–", ""), ...files.runs.map((name) => new Option(name)));
  $("runs").value = chosen || "";
}

async function showImages(images) {
  page.images = images;
  const { width, height, frames, reference } = await get("size", { images });
  $("facts").textContent = `${frames} images, ${width} × ${height} px; reference ${reference}`;
  await view.show(images, 0, width, height);
}

async function begin() {
  const files = page.files = await get("files");
  $("folder").textContent = files.folder;
  document.title = `idic draw ${files.folder}`;
  $("images").replaceChildren(...Object.entries(files.images).map(([name, count]) => new Option(`${name} (${count})`, name)));
  $("images-row").hidden = Object.keys(files.images).length < 2;
  $("mesher-row").hidden = !files.gmsh;
  $("log").replaceChildren(...files.logs.map((name) => new Option(name)), new Option("none", ""));
  $("law").replaceChildren(...files.laws.map((law) => new Option(law.name)));
  $("law").value = files.first_law;
  if (files.has_experiment) $("message").textContent = "This folder has an experiment.toml. Writing replaces it; the old one is kept as experiment.toml.before.";
  showLaw();
  await showImages($("images").value);
  performance.mark("image shown");
  const found = await findArea();
  take(files.drawn_before || found);
  await readLog();
  await listRuns(files.at_work);
  if (files.at_work) watch.watch(files.at_work);
  document.body.dataset.ready = "yes";
}

function listen(id, kind, act) { $(id).addEventListener(kind, act); }
listen("images", "change", async () => { document.body.dataset.ready = ""; await showImages($("images").value); const found = await findArea(); if (found) take(found); await readLog(); });
listen("find", "click", async () => { const found = await findArea(); if (found) take(found); });
listen("remove", "click", () => tools.remove());
listen("undo", "click", () => tools.undo());
listen("fit", "click", () => view.fit());
listen("distance", "input", fromDistance);
listen("pixel", "input", () => { page.scale = null; pixelChanged(); paint(); });
listen("thickness", "input", wanted);
listen("size", "input", () => { sizeText(); drawn(false); });
for (const id of ["elements", "mesher"]) listen(id, "change", () => drawn(true));
listen("show-floor", "change", () => { legend(); paint(); });
listen("edge-name", "change", nameLine);
listen("log", "change", readLog);
listen("force", "change", () => { identifyDefaults(); wanted(); });
listen("force-edge", "change", () => forceAlong(true));
listen("force-component", "change", () => { page.componentChosen = true; });
listen("law", "change", showLaw);
listen("write", "click", write);
listen("go", "click", go);
listen("runs", "change", () => { if ($("runs").value) watch.watch($("runs").value); });
tools.choose("select");
begin().catch((error) => tell(error));

// for scripts that drive the page: where a pixel of the image is in the window
window.placeOnScreen = (at) => { const box = $("canvas").getBoundingClientRect(), s = view.toScreen(at); return [s[0] + box.left, s[1] + box.top]; };
