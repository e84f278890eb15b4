// Delays as pictures, one at a time, and in words: over the last minute, how often each length comes, and both at once.
import { Latency, quantile, shares } from './look/latency.js';
import { drawWaterfall } from './look/waterfall.js';

const SPAN_MS = 60000;
const EVERY_MS = 200;
const KINDS = { delay: 'Round trip', state: 'Age of states', command: 'Age of commands' };
const PICTURES = ['time', 'histogram', 'waterfall'];
const at = (id) => document.getElementById(id);

export class DelayPlot {
  #canvas;
  #ink;
  #words = at('delay-words');
  #points = []; // {t, delay, age: the oldest state of all drones}
  #latency = new Latency();
  #histogram = null;
  #picture = 'time';
  #theme = '';

  /// `libraries`: whether uPlot is built in.
  constructor(canvas, ink, libraries) {
    this.#canvas = canvas;
    this.#ink = ink;
    const chosen = localStorage.getItem('delay');
    if (PICTURES.includes(chosen)) at('delay-picture').value = chosen;
    at('delay-picture').addEventListener('change', () => {
      localStorage.setItem('delay', at('delay-picture').value);
      this.#choose(libraries);
    });
    at('delay-kind').addEventListener('change', () => this.draw(performance.now()));
    this.#choose(libraries);
  }

  async #choose(libraries) {
    this.#picture = at('delay-picture').value;
    const lacks = this.#picture === 'histogram' && !libraries;
    at('delay-lacks').hidden = !lacks;
    at('delay-chart').hidden = this.#picture !== 'histogram' || lacks;
    this.#canvas.hidden = this.#picture === 'histogram';
    at('delay-kind').hidden = this.#picture === 'time';
    at('delay-legend').hidden = this.#picture !== 'time';
    if (!at('delay-chart').hidden && !this.#histogram) {
      const { Histogram } = await import('./look/histogram.js');
      this.#histogram ??= new Histogram(at('delay-chart'), this.#ink);
    }
    this.draw(performance.now());
  }

  get #kind() {
    return this.#picture === 'time' ? 'delay' : at('delay-kind').value;
  }

  /// `delay`: null while nothing comes. `drones`: as they were said; none: the age of the oldest state is `age`.
  add(now, delay, age, drones = []) {
    this.#latency.add(now, {
      delay: delay === null ? [] : [delay],
      state: drones.filter((drone) => drone.has_state).map((drone) => drone.state_age_ms),
      command: drones.map((drone) => drone.command_age_ms).filter((ms) => ms !== null),
    });
    const last = this.#points.at(-1);
    if (last && now - last.t < EVERY_MS) {
      last.delay = Math.max(last.delay ?? 0, delay ?? 0) || null; // a peak is not lost between two points
      last.age = Math.max(last.age, age);
      return;
    }
    this.#points.push({ t: now, delay, age });
    while (now - this.#points[0].t > SPAN_MS) this.#points.shift();
  }

  say(now) {
    const sorted = this.#latency.sorted(this.#kind, now, SPAN_MS / 1000);
    const ms = (value) => (value === null ? 'unknown' : `${Math.round(value)}`);
    const newest = this.#kind === 'delay' ? `now ${ms(this.#points.at(-1)?.delay ?? null)}, ` : '';
    const said = sorted.length
      ? `${KINDS[this.#kind]}: ${newest}half within ${ms(quantile(sorted, 0.5))}, 99\u00a0% within ${ms(quantile(sorted, 0.99))}, most ${ms(sorted.at(-1))} ms`
      : this.#kind === 'command' ? 'No drone has got a command in the last minute.' : 'No state has come in the last minute.';
    if (this.#words.textContent !== said) this.#words.textContent = said;
  }

  /// Each frame: redraws at once when the theme has changed.
  follow(now) {
    if (this.#theme === this.#ink('text')) return;
    this.#theme = this.#ink('text');
    this.draw(now);
  }

  draw(now) {
    if (this.#picture === 'histogram') {
      this.#histogram?.draw(shares(this.#latency.sorted(this.#kind, now, SPAN_MS / 1000)));
      return;
    }
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    if (!width) return;
    const dots = devicePixelRatio || 1;
    this.#canvas.width = Math.round(width * dots);
    this.#canvas.height = Math.round(height * dots);
    const ctx = this.#canvas.getContext('2d');
    ctx.scale(dots, dots);
    if (this.#picture === 'waterfall') drawWaterfall(ctx, width, height, this.#latency.columns(this.#kind, now), this.#ink);
    else this.#overTime(ctx, now, width, height);
  }

  #overTime(ctx, now, width, height) {
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
