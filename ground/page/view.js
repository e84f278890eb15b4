// Which part of the world a canvas shows: pixels to metres and back; x to the right, y up.

const ROOM_PX = 46; // around what is there, for names
const RIGHT_PX = 78; // there heights are written, too
const EDGE_PX = 24;
const MIN_SPAN_M = 3;
const calm = matchMedia('(prefers-reduced-motion: reduce)');

export class View {
  #canvas;
  #x = 0;
  #y = 0;
  #span = 6; // metres along the shorter side
  byHand = false; // moved or zoomed by a person: not fitted any more
  placed = false;

  constructor(canvas) {
    this.#canvas = canvas;
  }

  /// Makes the canvas as fine as the screen; answers its size in CSS pixels.
  size(ctx) {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    const dots = devicePixelRatio || 1;
    if (this.#canvas.width !== Math.round(width * dots) || this.#canvas.height !== Math.round(height * dots)) {
      this.#canvas.width = Math.round(width * dots);
      this.#canvas.height = Math.round(height * dots);
    }
    ctx.setTransform(dots, 0, 0, dots, 0, 0);
    return { width, height };
  }

  /// Pixels a metre.
  get scale() {
    return Math.min(this.#canvas.clientWidth, this.#canvas.clientHeight) / this.#span;
  }

  pixels(x, y) {
    const { clientWidth, clientHeight } = this.#canvas;
    return [clientWidth / 2 + (x - this.#x) * this.scale, clientHeight / 2 - (y - this.#y) * this.scale];
  }

  metres(px, py) {
    const { clientWidth, clientHeight } = this.#canvas;
    return { x: this.#x + (px - clientWidth / 2) / this.scale, y: this.#y - (py - clientHeight / 2) / this.scale };
  }

  pan(dx, dy) {
    this.#x -= dx / this.scale;
    this.#y += dy / this.scale;
    this.byHand = true;
  }

  reveal(x, y) {
    const { clientWidth, clientHeight } = this.#canvas;
    const [px, py] = this.pixels(x, y);
    const beyond = (at, size) => Math.min(0, at - EDGE_PX) + Math.max(0, at - size + EDGE_PX);
    this.#x += beyond(px, clientWidth) / this.scale;
    this.#y -= beyond(py, clientHeight) / this.scale;
  }

  zoom(factor, atX = this.#canvas.clientWidth / 2, atY = this.#canvas.clientHeight / 2) {
    const before = this.metres(atX, atY);
    this.#span = Math.max(1, Math.min(400, this.#span * factor));
    const after = this.metres(atX, atY);
    this.#x += before.x - after.x;
    this.#y += before.y - after.y;
    this.byHand = true;
  }

  /// Moves, a little at each call, to where all points are seen.
  fit(points) {
    if (this.byHand || !points.length) return;
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    const [xs, ys] = [points.map((point) => point[0]), points.map((point) => point[1])];
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const short = Math.min(width, height);
    const needed = (metres, pixels) => (metres * short) / Math.max(40, pixels);
    const span = Math.max(MIN_SPAN_M, needed(right - left, width - ROOM_PX - RIGHT_PX), needed(high - low, height - 2 * ROOM_PX));
    const aside = ((RIGHT_PX - ROOM_PX) / 2) * (span / short);
    const ease = this.placed && !calm.matches ? 0.08 : 1;
    this.#x += ((left + right) / 2 + aside - this.#x) * ease;
    this.#y += ((low + high) / 2 - this.#y) * ease;
    this.#span += (span - this.#span) * ease;
    this.placed = true;
  }
}
