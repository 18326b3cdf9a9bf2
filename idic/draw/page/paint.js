// What is drawn over the image: mesh, noise floor, lines with their names, handles, scale and axes.

import { middle, points } from "./sketch.js";

const COLOURS = ["#ff7a1a", "#21c7d9", "#e05ad6", "#a5d020", "#ffd21f", "#8f8bff"];
export const colourOf = (name, names) => COLOURS[Math.max(names.indexOf(name), 0) % COLOURS.length];

export function paintAll(context, { view, sketch, tools, mesh, scale, axes, showFloor, holeNames }) {
  view.paint(context);
  if (mesh) paintMesh(context, view, mesh, showFloor);
  const names = sketch.names;
  paintLoop(context, view, sketch.corners, names);
  if (sketch.circle) paintCircle(context, view, sketch.circle);
  for (const hole of sketch.holes) hole.circle ? paintCircle(context, view, hole.circle) : paintLoop(context, view, hole.corners, []);
  if (tools.line) stroke(context, view, points(tools.line.corners, tools.line.k), "#fff", 6, 0.6);
  paintNames(context, view, sketch, names);
  holeNames.forEach((name, k) => { const [x, y] = view.toScreen(middle(sketch.holes[k])); label(context, view, name, x, y + 18, "#ff3b3b"); }); // below the point in its middle
  sketch.handles().forEach((handle, k) => paintHandle(context, view, handle, k === tools.selected));
  if (scale) { stroke(context, view, scale, "#ffe14d", 2); scale.forEach((at) => cross(context, view, at, "#ffe14d")); }
  if (axes) paintAxes(context, view, axes);
  if (tools.points.length) {
    stroke(context, view, [...tools.points, ...(tools.cross ? [tools.cross] : [])], "#fff", 2);
    tools.points.forEach((at) => paintHandle(context, view, { at, kind: "corner" }, false));
  }
  if (tools.tool !== "select" && tools.cross) cross(context, view, tools.cross, "#fff");
}

function path(context, view, list, closed) {
  context.beginPath();
  for (const at of list) context.lineTo(...view.toScreen(at));
  if (closed) context.closePath();
}

function stroke(context, view, list, colour, width, alpha = 1) {
  path(context, view, list, false);
  context.globalAlpha = alpha; context.strokeStyle = colour; context.lineWidth = width; context.stroke(); context.globalAlpha = 1;
}

function paintMesh(context, view, mesh, showFloor) {
  const at = mesh.nodes.map((node) => view.toScreen(node));
  if (showFloor) {
    const known = mesh.floor.filter((v) => v !== null).sort((a, b) => a - b), low = known[0], high = known[Math.floor(known.length * 0.98)] || low;
    mesh.elements.forEach((cell, k) => {
      context.beginPath();
      for (const n of cell) context.lineTo(...at[n]);
      context.closePath();
      context.fillStyle = heat(mesh.floor[k] === null ? 1 : (mesh.floor[k] - low) / (high - low || 1)); context.globalAlpha = 0.6; context.fill();
    });
    context.globalAlpha = 1;
  }
  context.beginPath();
  for (const cell of mesh.elements) cell.forEach((n, k) => { context[k ? "lineTo" : "moveTo"](...at[n]); if (k === cell.length - 1) context.lineTo(...at[cell[0]]); });
  context.strokeStyle = "#4fb0ff"; context.globalAlpha = mesh.elements.length > 8000 ? 0.35 : 0.8; context.lineWidth = 1; context.stroke(); context.globalAlpha = 1;
}

function heat(t) {
  const stops = [[48, 164, 108], [242, 201, 76], [192, 57, 43]], s = Math.min(Math.max(t, 0), 1) * 2, k = Math.min(Math.floor(s), 1);
  return `rgb(${[0, 1, 2].map((i) => Math.round(stops[k][i] + (s - k) * (stops[k + 1][i] - stops[k][i]))).join(",")})`;
}

function paintLoop(context, view, corners, names) {
  corners.forEach((corner, k) => stroke(context, view, points(corners, k), corner.name ? colourOf(corner.name, names) : "#ff3b3b", corner.name ? 4 : 2));
}

function paintCircle(context, view, [x, y, r]) {
  const [a, b] = view.toScreen([x, y]);
  context.beginPath(); context.arc(a, b, r * view.scale, 0, 7); context.strokeStyle = "#ff3b3b"; context.lineWidth = 2; context.stroke();
}

function paintNames(context, view, sketch, names) {
  for (const name of names) {
    const own = sketch.corners.flatMap((corner, k) => corner.name === name ? points(sketch.corners, k) : []);
    const [x, y] = view.toScreen(own.reduce((sum, p) => [sum[0] + p[0] / own.length, sum[1] + p[1] / own.length], [0, 0]));
    label(context, view, name, x, y, colourOf(name, names));
  }
}

function label(context, view, name, x, y, colour) {
  context.font = "600 13px system-ui, sans-serif"; context.textAlign = "center"; context.textBaseline = "middle";
  const w = context.measureText(name).width + 12, at = Math.min(Math.max(x, w / 2 + 2), view.canvas.clientWidth - w / 2 - 2);
  const up = Math.min(Math.max(y, 12), view.canvas.clientHeight - 12);
  context.fillStyle = "#1c2733d0"; context.fillRect(at - w / 2, up - 10, w, 20);
  context.fillStyle = colour; context.fillText(name, at, up);
}

function paintHandle(context, view, handle, selected) {
  const [x, y] = view.toScreen(handle.at), r = selected ? 7 : 4.5;
  context.beginPath();
  if (handle.kind === "corner") context.rect(x - r, y - r, 2 * r, 2 * r); else context.arc(x, y, r, 0, 7);
  context.fillStyle = selected ? "#f2a900" : "#fff"; context.fill(); context.strokeStyle = "#1c2733"; context.lineWidth = 1.2; context.stroke();
}

function cross(context, view, at, colour) {
  const [x, y] = view.toScreen(at);
  context.beginPath(); context.moveTo(x - 9, y); context.lineTo(x + 9, y); context.moveTo(x, y - 9); context.lineTo(x, y + 9);
  context.strokeStyle = colour; context.lineWidth = 1.5; context.stroke();
}

function paintAxes(context, view, { origin, angle }) {
  const [x, y] = view.toScreen(origin);
  context.font = "700 13px system-ui, sans-serif"; context.textAlign = "center"; context.textBaseline = "middle";
  for (const [label, turn, colour] of [["x", angle, "#ff5c5c"], ["y", angle + Math.PI / 2, "#5cff7e"]]) {
    const dx = Math.cos(turn), dy = -Math.sin(turn);
    for (const [ink, width] of [["#1c2733", 6], [colour, 2.5]]) { // dark around: an axis may lie on an edge
      context.beginPath(); context.moveTo(x, y); context.lineTo(x + 40 * dx, y + 40 * dy); context.strokeStyle = ink; context.lineWidth = width; context.stroke();
    }
    context.strokeStyle = "#1c2733"; context.lineWidth = 4; context.strokeText(label, x + 50 * dx, y + 50 * dy);
    context.fillStyle = colour; context.fillText(label, x + 50 * dx, y + 50 * dy);
  }
}
