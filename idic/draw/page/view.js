// The image on the canvas: where it lies, zoom and pan, and the detail of the part that is seen.

export class View {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.changed = changed;
    this.scale = 1; this.x = 0; this.y = 0; // screen = (image - (x, y)) * scale, CSS pixels
    this.width = this.height = 1;
    this.images = ""; this.frame = 0;
    this.overview = null; this.detail = null; this.timer = 0; this.asked = 0;
    new ResizeObserver(() => { this.touched ? this.changed() : this.fit(); }).observe(canvas);
  }

  get ratio() { return window.devicePixelRatio || 1; }
  toScreen([x, y]) { return [(x + 0.5 - this.x) * this.scale, (y + 0.5 - this.y) * this.scale]; } // pixel centres at integers
  toImage([a, b]) { return [a / this.scale + this.x - 0.5, b / this.scale + this.y - 0.5]; }

  async show(images, frame, width, height) {
    Object.assign(this, { images, frame, width, height, overview: null, detail: null });
    this.fit();
    this.overview = await this.load([0, 0, width, height], 1600);
    this.changed();
    this.refine();
  }

  fit() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (!w || !h) return;
    this.touched = false;
    this.scale = Math.min(w / this.width, h / this.height) * 0.96;
    this.x = (this.width - w / this.scale) / 2;
    this.y = (this.height - h / this.scale) / 2;
    this.moved();
  }

  zoom(factor, [a, b]) {
    const smallest = 0.5 * Math.min(this.canvas.clientWidth / this.width, this.canvas.clientHeight / this.height);
    const scale = Math.min(Math.max(this.scale * factor, smallest), 40);
    this.x += a / this.scale - a / scale;
    this.y += b / this.scale - b / scale;
    this.scale = scale;
    this.touched = true;
    this.moved();
  }

  pan(dx, dy) { this.x -= dx / this.scale; this.y -= dy / this.scale; this.touched = true; this.moved(); }
  moved() { this.changed(); clearTimeout(this.timer); this.timer = setTimeout(() => this.refine(), 120); }

  async load(box, width) {
    const [x0, y0, x1, y1] = box;
    const query = new URLSearchParams({ images: this.images, frame: this.frame, x0, y0, x1, y1, width: Math.round(width) });
    const answer = await fetch(`api/part?${query}`);
    return answer.ok ? { bitmap: await createImageBitmap(await answer.blob()), box } : null;
  }

  async refine() { // the part that is seen, where the overview is too coarse for it
    if (!this.overview || !this.images) return;
    const seen = [this.x, this.y, this.x + this.canvas.clientWidth / this.scale, this.y + this.canvas.clientHeight / this.scale];
    const box = [Math.max(0, Math.floor(seen[0])), Math.max(0, Math.floor(seen[1])), Math.min(this.width, Math.ceil(seen[2])), Math.min(this.height, Math.ceil(seen[3]))];
    const screen = (box[2] - box[0]) * this.scale * this.ratio, have = (box[2] - box[0]) * Math.min(1, 1600 / this.width);
    if (box[2] <= box[0] || box[3] <= box[1] || Math.min(screen, box[2] - box[0]) < have * 1.2) { this.detail = null; return this.changed(); }
    const number = ++this.asked, found = await this.load(box, screen);
    if (number === this.asked) { this.detail = found; this.changed(); }
  }

  paint(context) {
    const { clientWidth: w, clientHeight: h } = this.canvas, ratio = this.ratio;
    if (this.canvas.width !== Math.round(w * ratio) || this.canvas.height !== Math.round(h * ratio)) {
      this.canvas.width = Math.round(w * ratio); this.canvas.height = Math.round(h * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, w, h);
    for (const part of [this.overview, this.detail]) if (part) this.paste(context, part.bitmap, part.box);
  }

  paste(context, bitmap, [x0, y0, x1, y1]) {
    context.imageSmoothingEnabled = this.scale < 4;
    context.drawImage(bitmap, (x0 - this.x) * this.scale, (y0 - this.y) * this.scale, (x1 - x0) * this.scale, (y1 - y0) * this.scale);
  }
}
