// Small line charts on a canvas.

function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, w, h);
  return { context, w, h };
}

const finite = (list) => list.filter((v) => v !== null && Number.isFinite(v));
export const short = (v, digits = 3) => v === null || v === undefined ? "–" : Math.abs(v) >= 1e5 || (v !== 0 && Math.abs(v) < 1e-3) ? v.toExponential(digits - 1) : String(Number(v.toPrecision(Math.max(digits, Math.ceil(Math.log10(Math.abs(v) || 1))))));
// significant digits of a value that show two digits of a step or a standard deviation
export const digitsFor = (value, step) => Math.min(8, Math.max(3, step > 0 && value ? Math.floor(Math.log10(Math.abs(value))) - Math.floor(Math.log10(step)) + 2 : 3));

export function sparkline(canvas, values) {
  const { context, w, h } = prepared(canvas), known = finite(values);
  if (known.length < 2) return;
  const low = Math.min(...known), high = Math.max(...known);
  context.strokeStyle = "#1f5fa8"; context.lineWidth = 1.5; context.beginPath();
  values.forEach((v, i) => { if (v !== null) context.lineTo(2 + i / (values.length - 1) * (w - 4), h - 3 - (v - low) / (high - low || 1) * (h - 6)); });
  context.stroke();
}

// series: [{label, values, colour, dots}]; values over 0, 1, 2 …
export function chart(canvas, series, xLabel) {
  const { context, w, h } = prepared(canvas), known = finite(series.flatMap((s) => s.values));
  if (!known.length) return;
  let low = Math.min(...known), high = Math.max(...known);
  if (low === high) { low -= Math.abs(low) * 0.1 + 1e-12; high += Math.abs(high) * 0.1 + 1e-12; }
  const count = Math.max(...series.map((s) => s.values.length), 2), left = 58, right = 8, top = 18, bottom = 30;
  const px = (i) => left + i / (count - 1) * (w - left - right), py = (v) => top + (high - v) / (high - low) * (h - top - bottom);
  context.font = "11px system-ui, sans-serif"; context.fillStyle = "#5b6875"; context.strokeStyle = "#d5dce3"; context.lineWidth = 1;
  const digits = digitsFor(Math.max(Math.abs(low), Math.abs(high)), (high - low) / 2);  // the three lines are told apart
  for (const v of [low, (low + high) / 2, high]) {
    context.beginPath(); context.moveTo(left, py(v)); context.lineTo(w - right, py(v)); context.stroke();
    context.textAlign = "right"; context.textBaseline = "middle"; context.fillText(short(v, digits), left - 5, py(v));
  }
  context.textBaseline = "top"; context.textAlign = "left"; context.fillText("0", left, h - bottom + 4);
  context.textAlign = "right"; context.fillText(String(count - 1), w - right, h - bottom + 4);
  context.textAlign = "center"; context.fillText(xLabel, (left + w - right) / 2, h - bottom + 14);
  let x = left;
  for (const s of series) {
    context.strokeStyle = context.fillStyle = s.colour; context.lineWidth = 1.8;
    if (!s.dots) { context.beginPath(); s.values.forEach((v, i) => { if (v !== null) context.lineTo(px(i), py(v)); }); context.stroke(); }
    if (s.dots || s.values.length === 1) s.values.forEach((v, i) => { if (v !== null) { context.beginPath(); context.arc(px(i), py(v), 2.4, 0, 7); context.fill(); } });
    context.textAlign = "left"; context.textBaseline = "top"; context.fillText(s.label, x, 2); x += context.measureText(s.label).width + 14;
  }
}
