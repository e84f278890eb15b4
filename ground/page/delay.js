// The last minute of delay and of the states' age, as a small plot and in words.

const SPAN_MS = 60000;
const EVERY_MS = 200;
const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];

export class DelayPlot {
  #canvas;
  #ink;
  #words = document.getElementById('delay-words');
  #points = []; // {t, delay, age: the oldest state of all drones}

  constructor(canvas, ink) {
    this.#canvas = canvas;
    this.#ink = ink;
  }

  /// `delay`: null while nothing comes.
  add(now, delay, age) {
    const last = this.#points.at(-1);
    if (last && now - last.t < EVERY_MS) {
      last.delay = Math.max(last.delay ?? 0, delay ?? 0) || null; // a peak is not lost between two points
      last.age = Math.max(last.age, age);
      return;
    }
    this.#points.push({ t: now, delay, age });
    while (now - this.#points[0].t > SPAN_MS) this.#points.shift();
  }

  say() {
    const delays = this.#points.map((each) => each.delay).filter((each) => each !== null);
    if (!delays.length) return;
    const now = this.#points.at(-1).delay;
    const said = `Now ${now === null ? 'unknown' : Math.round(now)}, median ${Math.round(median(delays))}, most ${Math.round(Math.max(...delays))} ms`;
    if (this.#words.textContent !== said) this.#words.textContent = said;
  }

  draw(now) {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    if (!width) return;
    const dots = devicePixelRatio || 1;
    this.#canvas.width = Math.round(width * dots);
    this.#canvas.height = Math.round(height * dots);
    const ctx = this.#canvas.getContext('2d');
    ctx.scale(dots, dots);
    const peak = Math.max(100, ...this.#points.map((each) => Math.max(each.delay ?? 0, Math.min(each.age, 2000))));
    const top = [150, 300, 600, 1200, 2500].find((each) => each >= peak) ?? 5000;
    const left = 38;
    const bottom = height - 16;
    const x = (t) => width - ((now - t) / SPAN_MS) * (width - left);
    const y = (value) => bottom - (Math.min(value, top) / top) * (bottom - 8);
    ctx.font = '11px system-ui, sans-serif';
    ctx.lineWidth = 1;
    for (const value of [0, top / 2, top]) {
      ctx.strokeStyle = this.#ink('grid');
      ctx.beginPath();
      ctx.moveTo(left, Math.round(y(value)) + 0.5);
      ctx.lineTo(width, Math.round(y(value)) + 0.5);
      ctx.stroke();
      ctx.fillStyle = this.#ink('muted');
      ctx.textAlign = 'right';
      ctx.fillText(`${value}`, left - 5, y(value) + 4);
    }
    ctx.textAlign = 'left';
    ctx.fillText('60 s ago', left, height - 3);
    ctx.textAlign = 'right';
    ctx.fillText('now', width, height - 3);
    this.#curve(ctx, (each) => each.age, x, y, this.#ink('muted'), [4, 3]);
    this.#curve(ctx, (each) => each.delay, x, y, this.#ink('accent'), []);
  }

  #curve(ctx, valueOf, x, y, colour, dash) {
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1.75;
    ctx.setLineDash(dash);
    ctx.beginPath();
    let broken = true;
    for (const each of this.#points) {
      const value = valueOf(each);
      if (value !== null) ctx[broken ? 'moveTo' : 'lineTo'](x(each.t), y(value));
      broken = value === null;
    }
    ctx.stroke();
    ctx.setLineDash([]);
  }
}
