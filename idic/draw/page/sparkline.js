// Numbers in few digits, and the course of a column as a small line.

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

export function sparkline(canvas, values) {
  const { context, w, h } = prepared(canvas), known = finite(values);
  if (known.length < 2) return;
  const low = Math.min(...known), high = Math.max(...known);
  context.strokeStyle = "#1f5fa8"; context.lineWidth = 1.5; context.beginPath();
  values.forEach((v, i) => { if (v !== null) context.lineTo(2 + i / (values.length - 1) * (w - 4), h - 3 - (v - low) / (high - low || 1) * (h - 6)); });
  context.stroke();
}
