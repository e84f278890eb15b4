// The view in three dimensions: the map's frame as it is (ENU: x east, y north, z up), in metres. It is drawn when there is something
// new to see and not else, and nothing in it moves by itself.
import { OrbitControls } from 'three/orbit';
import * as THREE from 'three';
import { fixed, STALE_MS } from '../drones.js';
import { arrow, box, cross, disc, forget, label, line, stand, trailOf } from './shapes.js';

const EVERY_MS = 50; // states come 30 times a second; more than twenty pictures of them nobody needs
const KEY_TURN = Math.PI / 24;
const KEY_ZOOM = 0.85;
const START = [-0.75, -1, 0.9]; // from where it looks at first: south-west, and above
const MIN_SPAN_M = 3;
const NEAREST_M = 0.5;
const FARTHEST_M = 500;
const MOVED_PX = 0.5; // less nobody sees
const TURNED = 0.03; // rad

const rounded = (list, digits) => list?.map((each) => each.toFixed(digits)).join();

export class SpaceView {
  #canvas;
  #ink;
  #renderer;
  #scene = new THREE.Scene();
  #camera = new THREE.PerspectiveCamera(45, 1, 0.05, 4 * FARTHEST_M);
  #controls;
  #fixed = new THREE.Group(); // grid, axes and their numbers
  #moving = new THREE.Group();
  #fitted = false;
  #turned = true; // the camera has moved since the last picture
  #shown = ''; // what the last picture shows, and where the drones are in it
  #places = [];
  #reach = 0;
  #drawn = 0; // when
  #lit = ''; // the ground that it stands on: the extent, the theme
  #size = '';
  drones = [];
  trails = new Map();
  selected = null;
  fence = null; // {min_m, max_m} of missions and paths
  previews = []; // [{drone, path}] of missions; a path without heights is the plan's alone

  /// Throws where the browser has no WebGL.
  constructor(canvas, ink) {
    this.#canvas = canvas;
    this.#ink = ink;
    this.#renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.#camera.up.set(0, 0, 1);
    this.#scene.add(this.#fixed, this.#moving);
    this.#controls = new OrbitControls(this.#camera, canvas);
    Object.assign(this.#controls, { minDistance: NEAREST_M, maxDistance: FARTHEST_M, maxPolarAngle: Math.PI / 2 - 0.02, zoomToCursor: true });
    this.#controls.addEventListener('change', () => (this.#turned = true));
    canvas.addEventListener('webglcontextrestored', () => (this.#turned = true));
    canvas.addEventListener('keydown', (event) => this.#key(event));
  }

  fit() {
    this.#fitted = false;
    this.#reach = 0;
    this.#turned = true;
  }

  zoom(factor) {
    if (factor < 1) this.#controls.dollyIn(factor);
    else this.#controls.dollyOut(1 / factor);
  }

  draw(now, ageOf) {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    if (!width || !height || document.hidden || now - this.#drawn < EVERY_MS) return;
    const seen = [...this.drones.map((drone) => this.#seen(drone, ageOf(drone))), ...this.#ahead().map(({ drone, path }) => `${drone} ${path}`)].join('|');
    const size = `${width} ${height} ${devicePixelRatio}`;
    const lit = `${this.#extent()} ${this.#ink('map')} ${JSON.stringify(this.fence)}`;
    if (!this.#turned && seen === this.#shown && size === this.#size && lit === this.#lit && !this.#moved(height)) return;
    if (size !== this.#size) {
      this.#renderer.setPixelRatio(Math.min(devicePixelRatio || 1, 2));
      this.#renderer.setSize(width, height, false);
      this.#camera.aspect = width / height;
      this.#camera.updateProjectionMatrix();
    }
    if (!this.#fitted && this.drones.some((drone) => drone.position)) this.#fit();
    if (lit !== this.#lit) this.#ground();
    this.#things(now, ageOf);
    this.#renderer.render(this.#scene, this.#camera);
    this.#canvas.dataset.pictures = Number(this.#canvas.dataset.pictures ?? 0) + 1;
    this.#turned = false;
    this.#places = this.drones;
    [this.#shown, this.#size, this.#lit, this.#drawn] = [seen, size, lit, now];
  }

  /// Whether a drone is elsewhere than in the last picture.
  #moved(height) {
    const pixel = (2 * this.#controls.getDistance() * Math.tan((this.#camera.fov * Math.PI) / 360)) / height; // m, in the middle
    const far = (a, b) => a && b && Math.hypot(...a.map((each, axis) => each - b[axis])) > MOVED_PX * pixel;
    return this.drones.some((drone, i) => {
      const before = this.#places[i];
      return ['position', 'predicted', 'origin'].some((which) => far(drone[which], before[which])) ||
        far(drone.committed.at(-1), before.committed.at(-1)) || Math.abs(drone.yaw - before.yaw) > TURNED;
    });
  }

  /// All else of a drone that a picture shows.
  #seen(drone, age) {
    const stale = age > STALE_MS ? (age / 1000).toFixed(1) : '';
    return [drone.name, drone.position !== null, drone.predicted !== null, drone.committed.length > 0, drone.sigma_m?.toFixed(1),
      drone.origin !== null, drone.path.map((corner) => rounded(corner, 2)).join(' '), stale, drone.name === this.selected].join(';');
  }

  #points() {
    const ahead = this.#ahead().flatMap(({ path }) => path);
    return [...this.drones.flatMap((drone) => [drone.position, drone.origin && [...drone.origin, 0], ...drone.path].filter(Boolean)), ...ahead];
  }

  #ahead() {
    return this.previews.filter(({ path }) => path.length > 1 && path.every((corner) => corner.every(Number.isFinite)));
  }

  /// How far the ground reaches to each side of the origin, m; it only grows, until it is fitted again.
  #extent() {
    const farthest = Math.max(0, ...this.#points().flatMap(([x, y]) => [Math.abs(x), Math.abs(y)]));
    this.#reach = Math.max(this.#reach, [4, 6, 10, 20, 50, 100, 200].find((each) => each >= farthest + 0.9) ?? 500);
    return this.#reach;
  }

  #fit() {
    const box = new THREE.Box3().setFromPoints(this.#points().map((point) => new THREE.Vector3(...point)));
    box.expandByPoint(new THREE.Vector3(box.min.x, box.min.y, 0));
    const centre = box.getCenter(new THREE.Vector3());
    const radius = Math.max(MIN_SPAN_M, box.getSize(new THREE.Vector3()).length()) / 2;
    const half = (this.#camera.fov * Math.PI) / 360;
    const distance = radius / Math.sin(Math.atan(Math.tan(half) * Math.min(1, this.#camera.aspect)));
    this.#controls.target.copy(centre);
    this.#camera.position.copy(centre).addScaledVector(new THREE.Vector3(...START).normalize(), Math.min(distance, FARTHEST_M));
    this.#controls.update();
    this.#fitted = true;
  }

  #ground() {
    forget(this.#fixed);
    const reach = this.#extent();
    const step = [1, 2, 5, 10, 20, 50].find((each) => reach / each <= 10) ?? 100;
    const colour = (name) => new THREE.Color(this.#ink(name));
    this.#scene.background = colour('map');
    const grid = new THREE.GridHelper(2 * reach, (2 * reach) / step, colour('axis'), colour('grid'));
    grid.rotation.x = Math.PI / 2;
    this.#fixed.add(grid);
    const high = Math.min(reach, 3);
    const axes = [['x east', [reach, 0, 0], 'axis-x'], ['y north', [0, reach, 0], 'axis-y'], ['z up', [0, 0, high], 'axis-z']];
    for (const [words, end, ink] of axes) {
      this.#fixed.add(line([[0, 0, 0.004], end.map((each) => each + 0.004)], colour(ink)));
      this.#fixed.add(label(`${words} ${Math.max(...end)} m`, end.map((each) => each * 1.04), this.#ink(ink), this.#ink('map')));
    }
    for (let at = step; at < reach; at += step) {
      this.#fixed.add(label(`${at}`, [at, 0, 0], this.#ink('muted')), label(`${at}`, [0, at, 0], this.#ink('muted')));
    }
    for (let at = 1; at < high; ++at) this.#fixed.add(label(`${at}`, [0, 0, at], this.#ink('muted')));
    if (this.fence) this.#fixed.add(box(this.fence, colour('muted')));
  }

  #things(now, ageOf) {
    forget(this.#moving);
    for (const { drone, path } of this.#ahead()) {
      const number = this.drones.findIndex((each) => each.name === drone);
      this.#moving.add(line(path, new THREE.Color(this.#ink(number < 0 ? 'muted' : `drone${number % 6}`)), { dashed: 0.12, dots: true }));
    }
    this.drones.forEach((drone, number) => {
      const colour = new THREE.Color(this.#ink(`drone${number % 6}`));
      const trail = this.trails.get(drone.name);
      if (trail?.length > 1) this.#moving.add(trailOf(trail, now, colour, new THREE.Color(this.#ink('map'))));
      if (drone.origin) this.#moving.add(cross([...drone.origin, 0.005], colour));
      if (drone.path.length) this.#moving.add(line(drone.path, colour, { dashed: 0.12, dots: true }));
      if (drone.position) this.#drone(drone, colour, ageOf(drone));
    });
  }

  #drone(drone, colour, age) {
    const [x, y, z] = drone.position;
    const stale = age > STALE_MS;
    const size = Math.max(0.16, 0.022 * this.#camera.position.distanceTo(new THREE.Vector3(x, y, z))); // seen from afar, too
    this.#moving.add(stand(drone.position, size, colour));
    if (drone.sigma_m) this.#moving.add(disc(drone.position, 2 * drone.sigma_m, colour));
    if (drone.committed.length) this.#moving.add(line([drone.position, ...drone.committed], colour, { dashed: 0.05 }));
    if (drone.predicted) this.#moving.add(arrow(drone.predicted, drone.yaw, size, colour, { hollow: true }));
    this.#moving.add(arrow(drone.position, drone.yaw, size, colour, { hollow: stale })); // hollow: it may be elsewhere by now
    if (drone.name === this.selected) this.#moving.add(disc(drone.position, size * 1.7, new THREE.Color(this.#ink('text')), { ring: true }));
    const words = stale ? `${drone.name} · ${(Math.min(age, 999000) / 1000).toFixed(1)} s old` : `${drone.name} · ${fixed(z, 1)} m`;
    this.#moving.add(label(words, [x, y, z + size * 2], this.#ink(stale ? 'red' : 'text'), this.#ink('map'), 13));
  }

  #key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (turns) {
      this.#controls.rotateLeft(turns[0] * KEY_TURN);
      this.#controls.rotateUp(turns[1] * KEY_TURN);
    } else if (['+', '='].includes(event.key)) this.zoom(KEY_ZOOM);
    else if (event.key === '-') this.zoom(1 / KEY_ZOOM);
    else if (event.key === '0') this.fit();
    else return;
    event.preventDefault(); // and so they do not fly
  }
}
