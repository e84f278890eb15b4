// The missions: their list, files that are loaded, and the paths that were drawn and kept to be flown as one.
import { put } from '../drones.js';
import { Entry } from './entry.js';
import { isFlown, isOver, MAX_FILE_BYTES, missionOf, nameOfFile, phaseWords, typeOf } from './words.js';

const at = (id) => document.getElementById(id);

export class Missions {
  #connection;
  #who;
  #plan;
  #entries = new Map(); // id -> Entry
  #kept = new Map(); // drone -> {drone, waypoints, then}
  #shown = null; // id of the mission whose paths are seen
  #paths = {}; // of that one
  #making = false;
  onmade = () => {}; // the kept paths have become a mission

  /// `plan` shows paths: see its `previews`.
  constructor(connection, who, plan) {
    this.#connection = connection;
    this.#who = who;
    this.#plan = plan;
    at('missions-on').addEventListener('click', () => this.toggle());
    at('mission-load').addEventListener('click', () => at('mission-file').click());
    at('mission-file').addEventListener('change', () => {
      this.#load(at('mission-file').files[0]);
      at('mission-file').value = ''; // the same file may be chosen again, repaired
    });
    // Anywhere on the page: a file that misses would else take the page's place.
    const panel = at('missions');
    addEventListener('dragover', (event) => {
      event.preventDefault();
      panel.classList.add('drop');
    });
    addEventListener('dragleave', (event) => event.relatedTarget === null && panel.classList.remove('drop'));
    addEventListener('drop', (event) => {
      event.preventDefault();
      panel.classList.remove('drop');
      this.toggle(true);
      this.#load(event.dataTransfer.files[0]);
    });
    at('mission-make').addEventListener('submit', (event) => {
      event.preventDefault();
      this.#make();
    });
  }

  toggle(on = at('missions').hidden) {
    at('missions').hidden = !on;
    at('missions-on').setAttribute('aria-pressed', on);
  }

  /// All that the station has.
  update(missions) {
    for (const [id, entry] of this.#entries) {
      if (missions.some((each) => each.id === id)) continue;
      if (entry.element.contains(document.activeElement)) at('mission-load').focus();
      entry.element.remove();
      this.#entries.delete(id);
      this.#say(`${entry.mission.name} is removed.`);
      if (this.#shown === id) this.#see(null);
    }
    const fresh = missions.filter((mission) => this.#take(mission) && !isOver(mission)).at(-1);
    if (fresh) this.#see(fresh);
  }

  /// Who is signed in has changed.
  refresh() {
    for (const entry of this.#entries.values()) entry.show();
  }

  /// A drawn path that waits to be made a part of a mission; one a drone.
  keep(path) {
    this.#kept.set(path.drone, path);
    this.toggle(true);
    this.#showKept();
  }

  /// Whether it was not known.
  #take(mission) {
    let entry = this.#entries.get(mission.id);
    const before = entry ? phaseWords(entry.mission) : '';
    if (!entry) {
      entry = new Entry(mission, this.#connection, this.#who, (each) => this.#see(each.mission.id === this.#shown ? null : each.mission));
      this.#entries.set(mission.id, entry);
      at('mission-list').prepend(entry.element);
    }
    entry.show(mission);
    if (before !== phaseWords(mission)) this.#say(`${mission.name}: ${phaseWords(mission).toLowerCase()}`);
    if (this.#shown === mission.id && isOver(mission)) this.#see(null);
    else if (this.#shown === mission.id) this.#preview();
    return !before;
  }

  async #see(mission) {
    this.#shown = mission?.id ?? null;
    this.#paths = {};
    for (const [id, entry] of this.#entries) entry.shown = id === this.#shown;
    this.#preview();
    if (!mission) return;
    const answer = await this.#connection.request('GET', `missions/${encodeURIComponent(mission.id)}`);
    if (this.#shown !== mission.id) return;
    if (!answer.ok) this.#entries.get(mission.id)?.reply(`Its paths cannot be shown: ${answer.words}`);
    this.#paths = answer.body.paths ?? {};
    this.#preview();
  }

  #preview() {
    const kept = [...this.#kept.values()].map(({ drone, waypoints }) => ({ drone, path: waypoints.map(({ x, y, z }) => [x, y, z ?? null]), begins: true }));
    const shown = this.#entries.get(this.#shown);
    const flown = shown && isFlown(shown.mission);
    this.#plan.previews = [...Object.entries(this.#paths).map(([drone, path]) => ({ drone, path, begins: !flown })), ...kept];
    at('plan').classList.toggle('previews', this.#plan.previews.length > 0);
  }

  #showKept() {
    at('mission-make').hidden = this.#kept.size === 0;
    at('mission-kept').replaceChildren(...[...this.#kept.values()].map(({ drone, waypoints, then }) => {
      const row = document.createElement('li');
      const drop = Object.assign(document.createElement('button'), { type: 'button', textContent: 'Drop' });
      drop.setAttribute('aria-label', `Drop the path of ${drone}`);
      drop.addEventListener('click', () => {
        this.#kept.delete(drone);
        this.#showKept();
        at('mission-load').focus();
      });
      row.append(Object.assign(document.createElement('span'), { textContent: `${drone}: ${waypoints.length} waypoint${waypoints.length > 1 ? 's' : ''}, then ${then}` }), drop);
      return row;
    }));
    this.#preview();
  }

  async #load(file) {
    if (!file) return;
    if (file.size > MAX_FILE_BYTES) return this.#say(`${file.name} is not loaded: it has more than 4 MB.`);
    const type = typeOf(file);
    if (!type) return this.#say(`${file.name} is neither .json nor .csv.`);
    this.#say(`${file.name}: sent`);
    const text = await file.text();
    return this.#send(file.name, type === 'text/csv' ? `missions?name=${nameOfFile(file.name)}` : 'missions', { text, type });
  }

  async #make() {
    const name = at('mission-name');
    if (this.#making || !name.reportValidity()) return;
    const kept = [...this.#kept.values()];
    const places = Object.fromEntries(this.#plan.drones.map((drone) => [drone.name, drone.position]));
    const lost = kept.find(({ drone }) => at('mission-start').checked && !places[drone]);
    if (lost) return this.#say(`Nobody knows where ${lost.drone} is.`);
    this.#making = true;
    const made = await this.#send(name.value, 'missions', missionOf(name.value, kept, at('mission-start').checked ? places : null));
    this.#making = false;
    if (!made) return;
    this.#kept.clear();
    this.#showKept();
    name.value = '';
    this.onmade();
    at('mission-load').focus(); // a field that keeps the focus would keep the keys
  }

  /// Whether it was taken.
  async #send(what, path, body) {
    const answer = await this.#connection.request('POST', path, body);
    if (!answer.ok) this.#say(`${what} is not taken: ${answer.words}`);
    else if (this.#take(answer.body)) this.#see(answer.body);
    return answer.ok;
  }

  #say(words) {
    put(at('missions-words'), words);
  }
}
