// A card for each drone: what it does, how fresh that is, who may command it, and its buttons.

import { BatteryTime, timeLeft } from './look/battery.js';
import { Control } from './operators/control.js';
import { isStopped, nameOf, replyOf, whyNotMine } from './operators/rules.js';

export const LATE_MS = 300;
export const STALE_MS = 1000;

const PHASES = { waiting: 'Waiting', takeoff: 'Taking off', path: 'On its path', manual: 'By hand', landing: 'Landing', landed: 'Landed', failed: 'Failed' };
const LINKS = { disconnected: '■ does not reach it', on_ground: '● reaches it, on the ground', taking_off: '● reaches it, taking off', flying: '● reaches it, in the air', landing: '● reaches it, landing', landed: '● reaches it, landed' };
const MODES = { hold: 'holds its place', brake: 'brakes', land: 'lands', cut: 'motors cut' };
export const FLYING = ['takeoff', 'path', 'manual', 'landing'];

/// Those that only the holder may ask, where operators sign in; to land and to stop it is anybody's.
const HOLDERS = ['takeoff', 'pause', 'return'];

/// [the button, when it can be asked, else why not]. Why a button is grey is also in operators/rules.js and missions/words.js;
/// what the station itself refuses, in its own words, in phase_problem() of ground/service/core/api.cpp.
const ACTIONS = {
  takeoff: ['Take off', (drone) => !FLYING.includes(drone.phase), 'is in the air already: land it first'],
  land: ['Land', (drone) => FLYING.includes(drone.phase), 'is not in the air'],
  stop: ['Stop', () => true, ''],
  pause: ['Pause', (drone) => drone.paused || drone.phase === 'path', 'flies no path that could be paused'],
  return: ['Return', (drone) => drone.phase === 'path' || drone.phase === 'manual', 'is not in the air'],
};

const span = (className, text = '') => Object.assign(document.createElement('span'), { className, textContent: text });
export const put = (element, text) => element.textContent !== text && (element.textContent = text);

const numbers = (list, count) => (Array.isArray(list) && list.length === count && list.every(Number.isFinite) ? list : null);
const number = (value) => (Number.isFinite(value) ? value : null);

/// A drone as the station says it; what is missing or no number is null, so that nobody draws or adds it.
export function cleaned(drone) {
  return {
    ...drone,
    has_state: drone.has_state === true && Number.isFinite(drone.state_age_ms),
    command_age_ms: number(drone.command_age_ms),
    battery_percent: number(drone.battery_percent),
    height_m: number(drone.height_m),
    position: numbers(drone.position, 3),
    velocity: numbers(drone.velocity, 3),
    predicted: numbers(drone.predicted, 3),
    committed: (drone.committed?.points ?? []).filter((point) => numbers(point, 3)),
    origin: drone.phase === 'waiting' ? null : numbers(drone.origin, 2), // it has none before it takes off
    yaw: number(drone.yaw) ?? 0,
    sigma_m: number(drone.sigma_m),
    limit_mps: number(drone.limit_mps),
    path: (drone.path ?? []).filter((corner) => numbers(corner, 3)),
  };
}

const isDown = (drone) => drone.link_phase === 'on_ground' || drone.link_phase === 'landed';

/// Fixed digits; what rounds to zero has no sign.
export const fixed = (value, digits) => (Number(value.toFixed(digits)) + 0).toFixed(digits);

/// An age in words, and how bad it is.
export function freshness(age_ms, connected) {
  if (age_ms === null) return { words: 'none yet', level: 'none' };
  const words = age_ms < 1000 ? `${Math.round(age_ms)} ms` : age_ms < 100000 ? `${(age_ms / 1000).toFixed(1)} s` : 'over 100 s';
  if (!connected) return { words, level: 'stale' };
  if (age_ms > STALE_MS) return { words, level: 'stale' };
  return { words, level: age_ms > LATE_MS ? 'late' : 'fresh' };
}

class Card {
  #connection;
  #who;
  #control;
  #fields = {};
  #buttons = {};
  #drone = null;
  #battery = new BatteryTime();
  #replied = 0;

  constructor(connection, who, name, number, pick) {
    this.#connection = connection;
    this.#who = who;
    this.name = name;
    this.element = document.getElementById('card').content.firstElementChild.cloneNode(true);
    this.element.classList.add(`drone${number % 6}`);
    for (const field of this.element.querySelectorAll('[data-field]')) this.#fields[field.dataset.field] = field;
    const title = this.#fields.select;
    title.append(span('number', number < 9 ? `${number + 1}` : ''), ' ', span('name', name));
    if (number < 9) title.setAttribute('aria-keyshortcuts', `${number + 1}`);
    this.element.addEventListener('click', () => pick(name));
    this.#fields.meter.setAttribute('aria-label', `Battery of ${name}`);
    for (const [what, [label]] of Object.entries(ACTIONS)) {
      const button = document.createElement('button');
      button.type = 'button';
      button.className = what === 'stop' ? 'danger' : '';
      button.dataset.action = what;
      button.textContent = label;
      button.setAttribute('aria-label', `${label} ${name}`);
      button.addEventListener('click', () => this.#ask(what));
      this.#buttons[what] = button;
      this.#fields.actions.append(button);
    }
    this.#control = new Control(name, this.#fields, connection, who, (words) => this.reply(words));
  }

  /// Why it is not to be asked now; null: it can be.
  #whyNot(action, drone) {
    const [, possible, why] = ACTIONS[action];
    const others = this.#who.operators.length && HOLDERS.includes(action) ? whyNotMine(drone, this.#who) : null;
    if (action === 'takeoff' && this.fresh && isStopped(drone)) return `${this.name} is stopped: clear the stop first.`;
    if (action === 'return' && this.fresh && !drone.position) return `${this.name} has no pose: it knows no way back.`;
    // What is stale may be wrong: then the station decides.
    return others ?? (this.fresh && !possible(drone) ? `${this.name} ${why}.` : null);
  }

  async #ask(action) {
    const [label] = ACTIONS[action];
    const why = this.#drone && this.#whyNot(action, this.#drone);
    if (why) return this.reply(why);
    const what = action === 'pause' && this.#drone?.paused ? 'resume' : action;
    const said = what === 'resume' ? 'Resume' : label;
    this.reply(`${said}: sent`);
    const answer = what === 'stop' || what === 'land' ? await this.#connection.bringDown(what, this.name) : await this.#connection.request('POST', `drones/${encodeURIComponent(this.name)}/${what}`);
    // Why nothing comes of it may have come before this answer.
    return answer.ok && this.#fields.reply.textContent !== `${said}: sent` ? undefined : this.reply(`${said}: ${answer.words}`);
  }

  /// Says what came of something, for a while.
  reply(words) {
    put(this.#fields.reply, words);
    this.#replied = performance.now();
  }

  /// Every state, also while nobody looks.
  take(drone, now) {
    if (drone.has_state) this.#battery.add(now, drone.battery_percent, !isDown(drone));
  }

  show(drone, ages, connected, selected, now) {
    this.#drone = drone;
    const state = freshness(ages.state, connected);
    const command = isDown(drone) ? { words: 'none, on the ground', level: 'none' } : freshness(ages.command, connected);
    this.fresh = state.level === 'fresh' || state.level === 'late';
    const fields = this.#fields;
    this.element.classList.toggle('selected', selected);
    this.element.classList.toggle('stale', !this.fresh);
    fields.select.setAttribute('aria-pressed', selected);
    put(fields.phase, drone.paused ? 'Paused' : PHASES[drone.phase] ?? drone.phase);
    fields.phase.dataset.phase = drone.phase;
    put(fields.battery, drone.battery_percent === null ? 'unknown' : `${drone.battery_percent} %`);
    fields.meter.hidden = drone.battery_percent === null;
    fields.meter.value = drone.battery_percent ?? 0;
    const left = timeLeft(this.fresh ? this.#battery.left_s() : null);
    put(fields.left, left.words);
    for (const level of ['warn', 'bad']) fields.left.classList.toggle(level, left.level === level);
    const reached = drone.has_state && drone.link_phase !== 'disconnected';
    put(fields.link, !drone.has_state ? '– no word of it yet' : this.fresh ? LINKS[drone.link_phase] ?? drone.link_phase : '▲ unknown now');
    fields.link.className = !this.fresh ? 'warn' : reached ? 'good' : 'bad';
    this.#age(fields.state, drone.has_state ? state : { words: 'none yet', level: 'none' });
    this.#age(fields.command, command);
    const calm = drone.mode === 'none';
    const warning = calm && FLYING.includes(drone.phase) && drone.cause_words ? `; ${drone.cause_words}` : '';
    const failsafe = calm ? `not active${warning}` : `${MODES[drone.mode] ?? drone.mode}: ${drone.cause_words || drone.cause}`;
    put(fields.failsafe, !drone.has_state ? '–' : this.fresh ? failsafe : `▲ unknown now; last: ${failsafe}`);
    fields.failsafe.classList.toggle('bad', !calm);
    fields.failsafe.classList.toggle('warn', calm && (warning !== '' || !this.fresh));
    this.#control.show(drone, FLYING.includes(drone.phase), this.fresh);
    const high = drone.height_m === null ? '' : `; ${fixed(drone.height_m, 1)} m high by its own sensor`;
    put(fields.place, drone.position ? `${drone.position.map((each) => fixed(each, 2)).join(', ')} m at ${Math.hypot(...(drone.velocity ?? [0])).toFixed(2)} m/s` : `no pose${high}`);
    this.#optional('stopped', (drone.stopped_by ?? []).map((each) => nameOf(each, this.#who)).join(', '));
    fields.stopped.title = (drone.stopped_by ?? []).join('; ');
    this.#optional('limit', drone.limit_mps === null ? '' : `${drone.limit_mps.toFixed(2)} m/s`);
    fields.limit.classList.toggle('warn', drone.limit_mps < this.#connection.hello.speed_mps);
    this.#optional('why', [drone.why, drone.ledger_untrusted ? 'the ledger is not trusted' : ''].filter(Boolean).join('; '));
    for (const [what, button] of Object.entries(this.#buttons)) button.setAttribute('aria-disabled', this.#whyNot(what, drone) !== null);
    const pause = drone.paused ? 'Resume' : 'Pause';
    if (this.#buttons.pause.textContent !== pause) {
      this.#buttons.pause.textContent = pause;
      this.#buttons.pause.setAttribute('aria-label', `${pause} ${this.name}`);
    }
    if (now - this.#replied > 8000) put(fields.reply, '');
  }

  #age(field, { words, level }) {
    put(field, words);
    field.dataset.level = level;
  }

  #optional(name, text) {
    this.#fields[name].parentElement.hidden = text === '';
    put(this.#fields[name], text);
  }
}

/// The cards, who is selected, and how old what is known is.
export class Fleet {
  #connection;
  #who;
  #list = document.getElementById('drones');
  #cards = new Map();
  #heard = 0;
  drones = [];
  selected = null;
  onselect = () => {};

  constructor(connection, who) {
    this.#connection = connection;
    this.#who = who;
  }

  get drone() {
    return this.drones.find((drone) => drone.name === this.selected);
  }

  update(drones, now) {
    this.drones = drones;
    this.#heard = now;
    for (const [number, drone] of drones.entries()) {
      if (!this.#cards.has(drone.name)) {
        const card = new Card(this.#connection, this.#who, drone.name, number, (name) => this.select(name));
        this.#cards.set(drone.name, card);
        this.#list.append(card.element);
      }
      this.#cards.get(drone.name).take(drone, now);
    }
    for (const [name, card] of this.#cards) {
      if (drones.some((drone) => drone.name === name)) continue;
      card.element.remove();
      this.#cards.delete(name);
    }
    if (!this.drone && drones.length) this.select(drones[0].name);
  }

  /// What came of a request is said on the drone's card, too.
  hear(events) {
    for (const event of events) {
      const words = replyOf(event, this.#who);
      if (words) this.#cards.get(event.drone)?.reply(words);
    }
  }

  select(name) {
    if (!name || name === this.selected) return;
    this.selected = name;
    this.onselect(name);
    const card = this.#cards.get(name)?.element;
    if (card && this.#list.scrollHeight > this.#list.clientHeight) card.scrollIntoView({ block: 'nearest' }); // the list, not the page
  }

  /// Ages go on while nothing comes.
  age(drone, now = performance.now()) {
    return !drone.has_state ? Infinity : drone.state_age_ms + now - this.#heard;
  }

  silent(now) {
    return now - this.#heard;
  }

  show(connected, now) {
    for (const drone of this.drones) {
      const command = drone.command_age_ms === null ? null : drone.command_age_ms + now - this.#heard;
      this.#cards.get(drone.name)?.show(drone, { state: this.age(drone, now), command }, connected, drone.name === this.selected, now);
    }
  }
}
