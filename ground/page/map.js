// The plan view: x to the right, y up, metres. Draws what is there and says where it was clicked.
import { fixed, STALE_MS } from './drones.js';
import { View } from './view.js';

const TRAIL_MS = 60000;

export class PlanView {
  #canvas;
  #ctx;
  #ink;
  #view;
  #drag = null;
  drones = [];
  trails = new Map(); // name -> [{t, x, y, z}]
  selected = null;
  draft = [];
  previews = []; // [{drone, path, begins}]: what missions fly, z may be null; `begins`: from where the drone is
  fence = null; // {min_m, max_m} of missions and paths
  cursor = null; // where the keyboard's cross stands while drawing
  onplace = () => {};
  onpick = () => {};
  drawing = false;

  constructor(canvas, ink) {
    this.#canvas = canvas;
    this.#ctx = canvas.getContext('2d');
    this.#ink = ink;
    this.#view = new View(canvas);
    canvas.addEventListener('pointerdown', (event) => (this.#drag = { x: event.offsetX, y: event.offsetY, moved: false, id: event.pointerId }));
    canvas.addEventListener('pointermove', (event) => this.#move(event));
    canvas.addEventListener('pointerup', (event) => this.#click(event));
    canvas.addEventListener('pointercancel', () => (this.#drag = null));
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoom(1.15 ** Math.sign(event.deltaY), event.offsetX, event.offsetY);
    }, { passive: false });
  }

  fit() {
    this.#view.byHand = false;
    this.#view.placed = false;
  }

  zoom(factor, atX, atY) {
    this.#view.zoom(factor, atX, atY);
  }

  /// Moves no more than is needed to see that place.
  reveal({ x, y }) {
    this.#view.reveal(x, y);
  }

  /// Takes the newest state; keeps what was flown in the last minute.
  update(drones, now) {
    this.drones = drones;
    for (const { name, position } of drones) {
      if (!position) continue;
      const trail = this.trails.get(name) ?? [];
      const last = trail.at(-1);
      if (!last || now - last.t > 100) trail.push({ t: now, x: position[0], y: position[1], z: position[2] });
      while (trail.length && now - trail[0].t > TRAIL_MS) trail.shift();
      this.trails.set(name, trail);
    }
  }

  draw(now, ageOf) {
    const { width, height } = this.#view.size(this.#ctx);
    if (!width || !height) return;
    const ctx = this.#ctx;
    if (!this.drawing || !this.#view.placed) this.#view.fit(this.#points()); // while drawing, a click lands where it was aimed
    ctx.fillStyle = this.#ink('map');
    ctx.fillRect(0, 0, width, height);
    this.#grid(width, height);
    if (this.fence) this.#fence(this.fence);
    this.drones.forEach((drone, number) => this.#way(drone, number, now));
    for (const preview of this.previews) this.#preview(preview);
    this.#draftPath();
    const seen = [...this.drones.entries()].filter(([, drone]) => drone.position);
    seen.sort(([, a], [, b]) => (a.name === this.selected) - (b.name === this.selected)); // that one above the others
    for (const [number, drone] of seen) this.#committed(drone, number);
    for (const [number, drone] of seen) this.#drone(drone, number, ageOf(drone));
    this.#canvas.dataset.committed = seen.filter(([, drone]) => drone.committed.length).map(([, drone]) => drone.name).join(' ');
  }

  #points() {
    const points = this.drones.flatMap((drone) => [drone.position, drone.origin, ...(drone.path ?? []), ...drone.committed].filter(Boolean));
    points.push(...this.previews.flatMap(({ path }) => path));
    for (const trail of this.trails.values()) points.push(...trail.map((each) => [each.x, each.y]));
    return points;
  }

  #grid(width, height) {
    const ctx = this.#ctx;
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find((each) => each * this.#view.scale > 44) ?? 200;
    const from = this.#view.metres(0, height);
    const to = this.#view.metres(width, 0);
    ctx.lineWidth = 1;
    ctx.font = '11px system-ui, sans-serif';
    const line = (value, along) => {
      ctx.strokeStyle = this.#ink(Math.abs(value) < step / 2 ? 'axis' : 'grid');
      const [px, py] = along === 'x' ? this.#view.pixels(value, 0) : this.#view.pixels(0, value);
      ctx.beginPath();
      if (along === 'x') ctx.moveTo(Math.round(px) + 0.5, 0), ctx.lineTo(Math.round(px) + 0.5, height);
      else ctx.moveTo(0, Math.round(py) + 0.5), ctx.lineTo(width, Math.round(py) + 0.5);
      ctx.stroke();
      ctx.fillStyle = this.#ink('muted');
      const said = `${Number(value.toFixed(2))}`;
      if (along === 'x' && px > 30 && px + 3 + ctx.measureText(said).width < width) ctx.fillText(said, px + 3, height - 5);
      if (along === 'y' && py > 14 && py < height - 18) ctx.fillText(said, 4, py - 3);
    };
    for (let x = Math.ceil(from.x / step) * step; x < to.x; x += step) line(x, 'x');
    for (let y = Math.ceil(from.y / step) * step; y < to.y; y += step) line(y, 'y');
    ctx.fillText('m', 4, height - 5);
  }

  /// Larger than what is flown, as a rule, so it does not count for the zoom.
  #fence({ min_m: [west, south], max_m: [east, north] }) {
    const corners = [[west, south], [east, south], [east, north], [west, north], [west, south]];
    this.#line(corners, { colour: this.#ink('muted'), dash: [14, 8], width: 1.5 });
  }

  #line(points, { colour, dash = [], width = 2, alpha = 1 }) {
    const ctx = this.#ctx;
    ctx.save();
    ctx.strokeStyle = colour;
    ctx.lineWidth = width;
    ctx.globalAlpha = alpha;
    ctx.setLineDash(dash);
    ctx.lineJoin = 'round';
    ctx.beginPath();
    points.forEach(([x, y], i) => (i ? ctx.lineTo(...this.#view.pixels(x, y)) : ctx.moveTo(...this.#view.pixels(x, y))));
    ctx.stroke();
    ctx.restore();
  }

  #way(drone, number, now) {
    const colour = this.#ink(`drone${number % 6}`);
    const trail = this.trails.get(drone.name) ?? [];
    for (let i = 1; i < trail.length; ++i) {
      const alpha = 0.7 * (1 - (now - trail[i].t) / TRAIL_MS) + 0.08;
      this.#line([[trail[i - 1].x, trail[i - 1].y], [trail[i].x, trail[i].y]], { colour, alpha: Math.max(0, alpha), width: 2.5 });
    }
    if (drone.origin) {
      const [x, y] = drone.origin;
      const arm = 6 / this.#view.scale;
      for (const side of [1, -1]) this.#line([[x - arm, y - arm * side], [x + arm, y + arm * side]], { colour, alpha: 0.6, width: 1.5 });
    }
    if (drone.path?.length) {
      this.#line(drone.path, { colour, dash: [9, 6], width: 2 });
      for (const [x, y] of drone.path) this.#dot(x, y, colour, 3.5);
    }
  }

  /// What is sent and not flown yet: a command given now changes nothing before its predicted place.
  #committed({ position, committed }, number) {
    if (committed.length) this.#line([position, ...committed], { colour: this.#ink(`drone${number % 6}`), dash: [4, 3], width: 4 });
  }

  #dot(x, y, colour, radius) {
    this.#ctx.fillStyle = colour;
    this.#ctx.beginPath();
    this.#ctx.arc(...this.#view.pixels(x, y), radius, 0, 2 * Math.PI);
    this.#ctx.fill();
  }

  #preview({ drone, path, begins }) {
    const number = this.drones.findIndex((each) => each.name === drone);
    const colour = this.#ink(number < 0 ? 'muted' : `drone${number % 6}`);
    const start = begins && this.drones[number]?.position;
    const corners = start && path.length ? [start, ...path] : path;
    this.#line(corners, { colour, dash: [12, 4, 2, 4], width: 2 });
    const ctx = this.#ctx;
    ctx.strokeStyle = colour;
    ctx.fillStyle = this.#ink('map');
    ctx.lineWidth = 1.5;
    for (const [x, y] of path) {
      const [px, py] = this.#view.pixels(x, y);
      ctx.fillRect(px - 4, py - 4, 8, 8);
      ctx.strokeRect(px - 4, py - 4, 8, 8);
    }
  }

  #draftPath() {
    const ctx = this.#ctx;
    const colour = this.#ink('text');
    const start = this.drones.find((drone) => drone.name === this.selected)?.position;
    const corners = this.draft.map(({ x, y }) => [x, y]);
    if (corners.length) this.#line(start ? [start, ...corners] : corners, { colour, dash: [2, 5], width: 2.5 });
    ctx.textAlign = 'center';
    corners.forEach(([x, y], i) => {
      this.#dot(x, y, colour, 9);
      ctx.fillStyle = this.#ink('map');
      ctx.font = 'bold 11px system-ui, sans-serif';
      const [px, py] = this.#view.pixels(x, y);
      ctx.fillText(`${i + 1}`, px, py + 4);
    });
    ctx.textAlign = 'start';
    if (!this.cursor || !this.drawing || document.activeElement !== this.#canvas) return;
    const arm = 12 / this.#view.scale;
    const { x, y } = this.cursor;
    this.#line([[x - arm, y], [x + arm, y]], { colour });
    this.#line([[x, y - arm], [x, y + arm]], { colour });
  }

  #arrow(x, y, yaw, size) {
    const ctx = this.#ctx;
    ctx.save();
    ctx.translate(...this.#view.pixels(x, y));
    ctx.rotate(-yaw);
    ctx.beginPath();
    ctx.moveTo(size, 0);
    ctx.lineTo(-size * 0.75, size * 0.7);
    ctx.lineTo(-size * 0.4, 0);
    ctx.lineTo(-size * 0.75, -size * 0.7);
    ctx.closePath();
    ctx.restore();
  }

  #drone(drone, number, age) {
    const ctx = this.#ctx;
    const colour = this.#ink(`drone${number % 6}`);
    const [x, y, z] = drone.position;
    const [px, py] = this.#view.pixels(x, y);
    const stale = age > STALE_MS;
    if (drone.sigma_m) {
      ctx.fillStyle = ctx.strokeStyle = colour;
      ctx.beginPath();
      ctx.arc(px, py, 2 * drone.sigma_m * this.#view.scale, 0, 2 * Math.PI);
      ctx.globalAlpha = 0.12;
      ctx.fill();
      ctx.globalAlpha = 0.6;
      ctx.lineWidth = 1;
      ctx.stroke();
      ctx.globalAlpha = 1;
    }
    ctx.lineWidth = 1.5;
    if (drone.predicted) {
      ctx.save();
      ctx.strokeStyle = colour;
      ctx.setLineDash([3, 3]);
      this.#arrow(drone.predicted[0], drone.predicted[1], drone.yaw ?? 0, 13);
      ctx.stroke();
      ctx.restore();
    }
    this.#arrow(x, y, drone.yaw ?? 0, 13);
    ctx.fillStyle = stale ? this.#ink('map') : colour; // hollow: it may be elsewhere by now
    ctx.strokeStyle = stale ? colour : this.#ink('map');
    ctx.fill();
    ctx.stroke();
    if (drone.name === this.selected) {
      ctx.strokeStyle = this.#ink('text');
      ctx.lineWidth = 2;
      ctx.beginPath();
      ctx.arc(px, py, 21, 0, 2 * Math.PI);
      ctx.stroke();
    }
    this.#height(px + 22, py + 28, z, colour); // below: beside it, it would hide where it goes as often as not
    this.#label(px, py - 28, stale ? `${drone.name} · ${(Math.min(age, 999000) / 1000).toFixed(1)} s old` : drone.name, stale);
  }

  #height(px, py, z, colour) {
    const ctx = this.#ctx;
    const tall = 30;
    const share = Math.max(0, Math.min(1, z / 3));
    ctx.fillStyle = this.#ink('map');
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1;
    ctx.fillRect(px, py - tall / 2, 5, tall);
    ctx.strokeRect(px + 0.5, py - tall / 2 + 0.5, 5, tall);
    ctx.fillStyle = colour;
    ctx.fillRect(px + 0.5, py + tall / 2 - tall * share, 5, tall * share);
    ctx.font = '12px system-ui, sans-serif';
    ctx.fillStyle = this.#ink('text');
    ctx.strokeStyle = this.#ink('map'); // so that it can be read on a path
    ctx.lineWidth = 3;
    ctx.strokeText(`${fixed(z, 1)} m`, px + 10, py + 4);
    ctx.fillText(`${fixed(z, 1)} m`, px + 10, py + 4);
  }

  #label(px, py, text, stale) {
    const ctx = this.#ctx;
    ctx.font = '600 13px system-ui, sans-serif';
    const wide = ctx.measureText(text).width + 10;
    ctx.fillStyle = this.#ink('map');
    ctx.globalAlpha = 0.8;
    ctx.fillRect(px - wide / 2, py - 13, wide, 18);
    ctx.globalAlpha = 1;
    ctx.fillStyle = this.#ink(stale ? 'red' : 'text');
    ctx.textAlign = 'center';
    ctx.fillText(text, px, py);
    ctx.textAlign = 'start';
  }

  #move(event) {
    if (!this.#drag || event.pointerId !== this.#drag.id || this.drawing) return;
    const [dx, dy] = [event.offsetX - this.#drag.x, event.offsetY - this.#drag.y];
    if (!this.#drag.moved && Math.hypot(dx, dy) < 6) return;
    this.#view.pan(dx, dy);
    this.#drag = { ...this.#drag, x: event.offsetX, y: event.offsetY, moved: true };
  }

  #click(event) {
    const drag = this.#drag;
    this.#drag = null;
    if (!drag || drag.moved) return;
    if (this.drawing) return this.onplace(this.#view.metres(event.offsetX, event.offsetY));
    const hit = this.drones.find((drone) => {
      if (!drone.position) return false;
      const [px, py] = this.#view.pixels(drone.position[0], drone.position[1]);
      return Math.hypot(event.offsetX - px, event.offsetY - py) < 26;
    });
    if (hit) this.onpick(hit.name);
  }
}
