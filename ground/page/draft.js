// A path that is being drawn for the selected drone: by clicks on the map, or by a cross that the arrow keys move.

const MAX_WAYPOINTS = 500;
const MIN_APART_M = 0.01;
const STEP_M = 0.25;
const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

const round = (value) => Math.round(value * 100) / 100;
const field = (id) => document.getElementById(id);

export class Draft {
  #map;
  #canvas;
  #connection;
  #words = field('draft-words');
  #selected; // () => the drone as last seen, or undefined
  #sending = false;
  #keeping = false; // paths of several drones are drawn, one after the other
  onkeep = () => {};

  constructor(map, canvas, connection, selected) {
    this.#map = map;
    this.#canvas = canvas;
    this.#connection = connection;
    this.#selected = selected;
    map.onplace = (point) => this.add(point);
    field('draw').addEventListener('click', () => this.toggle());
    field('draft-tools').addEventListener('submit', (event) => {
      event.preventDefault();
      this.fly();
    });
    field('draft-keep').addEventListener('click', () => this.#keep());
    field('draft-undo').addEventListener('click', () => this.#set(this.#map.draft.slice(0, -1)));
    field('draft-clear').addEventListener('click', () => this.clear());
    canvas.addEventListener('keydown', (event) => this.#cross(event));
    this.#set([]);
  }

  get on() {
    return this.#map.drawing;
  }

  toggle(on = !this.on) {
    this.#map.drawing = on;
    this.#keeping = false;
    field('draw').setAttribute('aria-pressed', on);
    field('map').classList.toggle('drawing', on);
    field('draft-tools').hidden = !on;
    this.#begin(on);
  }

  /// Another drone is selected: what is drawn was the other's.
  reselect() {
    if (!this.#keeping) return this.toggle(false);
    this.#set([]);
    return this.#begin(true);
  }

  #begin(on) {
    const drone = this.#selected();
    this.#map.cursor = on && drone?.position ? { x: round(drone.position[0]), y: round(drone.position[1]) } : on ? { x: 0, y: 0 } : null;
    if (!on) this.#set([]);
    else this.#say(drone ? `Click on the map to add waypoints for ${drone.name}.` : 'Select a drone first.');
  }

  add({ x, y }) {
    const drone = this.#selected();
    const last = this.#map.draft.at(-1);
    if (!drone) return this.#say('Select a drone first.');
    if (this.#map.draft.length >= MAX_WAYPOINTS) return this.#say(`A path has ${MAX_WAYPOINTS} waypoints at most.`);
    if (last && Math.hypot(last.x - x, last.y - y) < MIN_APART_M) return undefined; // the second half of a double click
    return this.#set([...this.#map.draft, { x: round(x), y: round(y) }]);
  }

  /// True when there was something to clear, or drawing to end.
  clear() {
    if (this.#map.draft.length) this.#set([]);
    else if (this.on) this.toggle(false);
    else return false;
    return true;
  }

  /// True when a path was there to be sent.
  fly() {
    if (!this.on || this.#sending) return false;
    const path = this.#path();
    if (path) this.#send(path);
    return true;
  }

  #keep() {
    const path = this.#path();
    if (!path) return;
    this.onkeep(path);
    this.#keeping = true;
    this.#set([]);
    this.#canvas.focus();
    this.#say(`The path of ${path.drone} is kept. Select another drone and draw, or make a mission of what is kept.`);
  }

  /// What is drawn, with the fields' words; null where something lacks, which is said.
  #path() {
    const drone = this.#selected();
    const bad = ['draft-height', 'draft-speed'].map(field).find((each) => !each.checkValidity());
    if (bad) bad.reportValidity();
    else if (!drone || !this.#map.draft.length) this.#say(drone ? 'Add a waypoint first.' : 'Select a drone first.');
    if (bad || !drone || !this.#map.draft.length) return null;
    const extra = {};
    if (field('draft-height').value) extra.z = Number(field('draft-height').value);
    if (field('draft-speed').value) extra.speed = Number(field('draft-speed').value);
    return { drone: drone.name, waypoints: this.#map.draft.map((point) => ({ ...point, ...extra })), then: field('draft-then').value };
  }

  async #send({ drone, waypoints, then }) {
    this.#sending = true;
    this.#say(`Path for ${drone}: sent`);
    const answer = await this.#connection.request('POST', `drones/${encodeURIComponent(drone)}/path`, { waypoints, then });
    this.#sending = false;
    if (answer.ok) this.toggle(false);
    this.#canvas.focus(); // a field that keeps the focus would keep the keys
    this.#say(`Path for ${drone}: ${answer.words}`); // refused: the draft stays, to be repaired
  }

  #set(points) {
    this.#map.draft = points;
    for (const id of ['draft-fly', 'draft-keep', 'draft-undo', 'draft-clear']) field(id).setAttribute('aria-disabled', points.length === 0);
    const last = points.at(-1);
    this.#say(last ? `${points.length} waypoint${points.length > 1 ? 's' : ''}; the last at x ${last.x}, y ${last.y} m` : '');
  }

  #cross(event) {
    if (!this.on || !this.#map.cursor || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key in ARROWS) {
      const [dx, dy] = ARROWS[event.key];
      const { x, y } = this.#map.cursor;
      this.#map.cursor = { x: round(x + dx * STEP_M), y: round(y + dy * STEP_M) };
      this.#map.reveal(this.#map.cursor);
      this.#say(`Cross at x ${this.#map.cursor.x}, y ${this.#map.cursor.y} m; Space adds a waypoint`);
    } else if (event.key === ' ') this.add(this.#map.cursor);
    else return;
    event.preventDefault(); // and so they do not fly
  }

  #say(words) {
    this.#words.textContent = words;
  }
}
