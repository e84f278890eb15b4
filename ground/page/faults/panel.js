// The switches of a simulated flight's faults: shown where the station has any, amber while one is on.
import { put } from '../drones.js';
import { SIGN_IN } from '../operators/rules.js';

const at = (id) => document.getElementById(id);

/// "tello1: Drone silent"; what is of all has no drone.
export const nameOfFault = ({ drone, label }) => (drone ? `${drone}: ${label}` : label);

/// What is on, for one who does not look at the switches.
export function wordsOfFaults(faults, why) {
  if (why) return why;
  const on = faults.filter((each) => each.on);
  return on.length ? `▲ On: ${on.map(nameOfFault).join(', ')}` : 'None is on.';
}

export class Faults {
  #connection;
  #who;
  #rows = new Map(); // name -> {element, button, state, fault}

  /// `who`: see operators/rules.js.
  constructor(connection, who) {
    this.#connection = connection;
    this.#who = who;
    at('faults-open').addEventListener('click', () => this.toggle());
    at('faults-off').addEventListener('click', () => this.#allOff());
  }

  /// Whether there are any to be seen.
  toggle() {
    if (at('faults').hidden) return false;
    const open = at('faults-list').hidden;
    at('faults-list').hidden = !open;
    at('faults-open').setAttribute('aria-expanded', open);
    return true;
  }

  /// All that the station has; `why`: it does not reach them.
  update(faults, why = '') {
    at('faults').hidden = faults.length === 0 && !why;
    for (const [name, row] of this.#rows) {
      if (faults.some((each) => each.name === name)) continue;
      if (row.element.contains(document.activeElement)) at('faults-open').focus();
      row.element.remove();
      this.#rows.delete(name);
    }
    for (const fault of faults) this.#show(fault);
    const on = faults.some((each) => each.on);
    at('faults').classList.toggle('on', on || why !== '');
    if (!on && document.activeElement === at('faults-off')) at('faults-open').focus();
    at('faults-off').hidden = !on;
    put(at('faults-words'), wordsOfFaults(faults, why));
  }

  #show(fault) {
    if (!this.#rows.has(fault.name)) this.#rows.set(fault.name, this.#row(fault));
    const row = this.#rows.get(fault.name);
    row.fault = fault;
    row.button.setAttribute('aria-checked', fault.on);
    put(row.state, fault.on ? 'on' : 'off');
  }

  #row(fault) {
    const make = (tag, more) => Object.assign(document.createElement(tag), more);
    const element = make('li');
    const button = make('button', { type: 'button' });
    button.setAttribute('role', 'switch');
    button.dataset.fault = fault.name;
    const state = make('span', { className: 'state' });
    state.setAttribute('aria-hidden', 'true');
    button.append(make('span', { textContent: nameOfFault(fault) }), state);
    const words = make('span', { className: 'words', id: `fault-${fault.name}`, textContent: fault.words });
    button.setAttribute('aria-describedby', words.id);
    button.addEventListener('click', () => this.#switch(fault.name, !this.#rows.get(fault.name).fault.on));
    element.append(button, words);
    at('faults-list').append(element);
    return { element, button, state, fault };
  }

  async #switch(name, on) {
    if (on && this.#who.operators.length > 0 && !this.#who.identity) return this.#say(SIGN_IN);
    const answer = await this.#connection.request('POST', 'faults', { name, on });
    if (answer.ok) this.update(answer.body.faults);
    return this.#say(answer.ok ? '' : `${on ? 'Not switched on' : 'Not switched off'}: ${answer.words}`);
  }

  async #allOff() {
    for (const [name, { fault }] of this.#rows) if (fault.on) await this.#switch(name, false);
  }

  #say(words) {
    put(at('faults-reply'), words);
  }
}
