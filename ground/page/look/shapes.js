// What stands in the three-dimensional view: each a new object of three.js, in metres.
import * as THREE from 'three';

const TRAIL_MS = 60000;

// Materials are made once for each look: a new one would be a new program for the graphics card, twenty times a second.
const looks = new Map();
function material(Kind, options) {
  const key = `${Kind.name} ${JSON.stringify(options)}`; // a colour is its number in there
  if (!looks.has(key)) looks.set(key, new Kind(options));
  return looks.get(key);
}

const points = (list) => new THREE.BufferGeometry().setFromPoints(list.map((each) => new THREE.Vector3(...each)));

/// Lets go of what a group holds, in the graphics card, too; but not of what is used repeatedly.
export function forget(group) {
  group.traverse((each) => !each.isSprite && !kept.has(each.geometry) && each.geometry?.dispose());
  group.clear();
}

/// `dashed`: how long a dash is, m.
export function line(corners, colour, { dashed = 0, dots = false } = {}) {
  const look = dashed ? material(THREE.LineDashedMaterial, { color: colour, dashSize: dashed, gapSize: 0.6 * dashed }) : material(THREE.LineBasicMaterial, { color: colour });
  const made = new THREE.Line(points(corners), look);
  if (dashed) made.computeLineDistances();
  if (!dots) return made;
  const group = new THREE.Group();
  group.add(made, new THREE.Points(points(corners), material(THREE.PointsMaterial, { color: colour, size: 6 * (devicePixelRatio || 1), sizeAttenuation: false })));
  return group;
}

/// What was flown, fading into the ground's colour.
export function trailOf(trail, now, colour, ground) {
  const made = new THREE.BufferGeometry();
  const [places, colours] = [[], []];
  const add = ({ x, y, z, t }) => {
    places.push(x, y, z);
    const age = Math.min(1, Math.max(0, (now - t) / TRAIL_MS));
    colours.push(...colour.clone().lerp(ground, 0.85 * age).toArray());
  };
  for (const each of trail) add(each);
  made.setAttribute('position', new THREE.Float32BufferAttribute(places, 3));
  made.setAttribute('color', new THREE.Float32BufferAttribute(colours, 3));
  return new THREE.Line(made, material(THREE.LineBasicMaterial, { vertexColors: true }));
}

/// The edges of a box, from its least corner to its greatest.
export function box({ min_m, max_m }, colour) {
  const size = max_m.map((each, axis) => each - min_m[axis]);
  const made = new THREE.LineSegments(new THREE.EdgesGeometry(new THREE.BoxGeometry(...size)), material(THREE.LineDashedMaterial, { color: colour, dashSize: 0.3, gapSize: 0.2 }));
  made.position.set(...min_m.map((each, axis) => each + size[axis] / 2));
  made.computeLineDistances();
  return made;
}

/// Where it took off.
export function cross([x, y, z], colour) {
  const arm = 0.09;
  const made = points([[x - arm, y - arm, z], [x + arm, y + arm, z], [x - arm, y + arm, z], [x + arm, y - arm, z]]);
  return new THREE.LineSegments(made, material(THREE.LineBasicMaterial, { color: colour }));
}

const nose = (() => {
  const shape = new THREE.Shape();
  shape.moveTo(1, 0);
  shape.lineTo(-0.75, 0.7);
  shape.lineTo(-0.4, 0);
  shape.lineTo(-0.75, -0.7);
  shape.closePath();
  return new THREE.ExtrudeGeometry(shape, { depth: 0.3, bevelEnabled: false }).translate(0, 0, -0.15);
})();
const edges = new THREE.EdgesGeometry(nose);
const kept = new Set([nose, edges]);

/// A drone, its nose where it heads; hollow: its edges alone.
export function arrow(at, yaw, size, colour, { hollow = false } = {}) {
  const group = new THREE.Group();
  group.add(new THREE.LineSegments(edges, material(THREE.LineBasicMaterial, { color: hollow ? colour : colour.clone().multiplyScalar(0.45) })));
  if (!hollow) group.add(new THREE.Mesh(nose, material(THREE.MeshBasicMaterial, { color: colour, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 })));
  group.position.set(...at);
  group.rotation.z = yaw;
  group.scale.setScalar(size);
  return group;
}

/// Where on the ground a drone is: a line down to it, and a spot.
export function stand([x, y, z], size, colour) {
  const group = new THREE.Group();
  group.add(line([[x, y, 0], [x, y, z]], colour));
  const spot = new THREE.Mesh(new THREE.CircleGeometry(size * 0.5, 24), material(THREE.MeshBasicMaterial, { color: colour, transparent: true, opacity: 0.35, depthWrite: false }));
  spot.position.set(x, y, 0.004);
  group.add(spot);
  return group;
}

/// A level circle around a place; ring: its edge alone.
export function disc(at, radius, colour, { ring = false } = {}) {
  const group = new THREE.Group();
  const edge = Array.from({ length: 48 }, (_, i) => [radius * Math.cos((i * Math.PI) / 24), radius * Math.sin((i * Math.PI) / 24), 0]);
  group.add(new THREE.LineLoop(points(edge), material(THREE.LineBasicMaterial, { color: colour })));
  if (!ring) group.add(new THREE.Mesh(new THREE.CircleGeometry(radius, 48), material(THREE.MeshBasicMaterial, { color: colour, transparent: true, opacity: 0.18, side: THREE.DoubleSide, depthWrite: false })));
  group.position.set(...at);
  return group;
}

const MAX_LABELS = 200;
const labels = new Map(); // words and look -> {look, width, height}; the least recently used one goes first

function painted(words, ink, ground, px) {
  const key = [words, ink, ground, px, devicePixelRatio].join('\n');
  const known = labels.get(key);
  labels.delete(key);
  const made = known ?? paint(words, ink, ground, px);
  labels.set(key, made);
  if (labels.size > MAX_LABELS) {
    const [oldest, { look }] = labels.entries().next().value;
    look.map.dispose();
    look.dispose();
    labels.delete(oldest);
  }
  return made;
}

function paint(words, ink, ground, px) {
  const dots = Math.min(devicePixelRatio || 1, 2) * 2;
  const canvas = document.createElement('canvas');
  const ctx = canvas.getContext('2d');
  const font = `${px > 11 ? 600 : 400} ${px}px system-ui, 'DejaVu Sans', sans-serif`;
  ctx.font = font;
  const [width, height] = [Math.ceil(ctx.measureText(words).width) + 8, px + 6];
  [canvas.width, canvas.height] = [width * dots, height * dots];
  ctx.scale(dots, dots);
  if (ground) {
    ctx.globalAlpha = 0.8;
    ctx.fillStyle = ground;
    ctx.fillRect(0, 0, width, height);
    ctx.globalAlpha = 1;
  }
  ctx.font = font;
  ctx.fillStyle = ink;
  ctx.textBaseline = 'middle';
  ctx.fillText(words, 4, height / 2 + 0.5);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.generateMipmaps = false;
  texture.minFilter = THREE.LinearFilter;
  return { look: new THREE.SpriteMaterial({ map: texture, transparent: true, depthTest: false, sizeAttenuation: false }), width, height };
}

/// Words that face the viewer, as large from far away as from near. `px`: font size.
export function label(words, at, ink, ground = '', px = 11) {
  const { look, width, height } = painted(words, ink, ground, px);
  const sprite = new THREE.Sprite(look);
  sprite.position.set(...at);
  sprite.center.set(0.5, 0);
  sprite.onBeforeRender = (renderer, _scene, camera) => {
    const tall = 2 * Math.tan((camera.fov * Math.PI) / 360) / renderer.domElement.clientHeight; // of a pixel, at a distance of 1
    sprite.scale.set(width * tall, height * tall, 1);
    sprite.updateMatrixWorld();
  };
  sprite.renderOrder = 1;
  return sprite;
}
