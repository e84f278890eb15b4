// The part of a drone's card that says who holds it, and asks for what changes that.
import { confirmed } from './session.js';
import { CONTROLS, identityOf, isOurs, isShown, leaseWords, maySign, nameOf, SIGN_IN, whyNotControl } from './rules.js';

const ANSWERS = { hand_over: 'Hand over', deny: 'Deny' };

function button(label, drone, click) {
  const made = Object.assign(document.createElement('button'), { type: 'button', textContent: label });
  made.setAttribute('aria-label', `${label} ${drone}`);
  made.addEventListener('click', click);
  return made;
}

export class Control {
  #name;
  #connection;
  #who;
  #reply;
  #lease;
  #actions;
  #requests;
  #select;
  #buttons = {};
  #rows = new Map(); // identity -> row
  #drone = null;
  #flying = false;
  #fresh = false;

  /// `fields`: the card's; `who`: see rules.js; `reply(words)` says them on the card.
  constructor(name, fields, connection, who, reply) {
    this.#name = name;
    this.#connection = connection;
    this.#who = who;
    this.#reply = reply;
    this.#lease = fields.lease;
    this.#actions = fields.control;
    this.#requests = fields.requests;
    this.#select = fields.select;
    this.#requests.setAttribute('aria-label', `Who asks for ${name}`);
    for (const [what, [label]] of Object.entries(CONTROLS)) {
      this.#buttons[what] = button(label, name, () => this.#ask(what));
      this.#buttons[what].dataset.action = what;
      this.#actions.append(this.#buttons[what]);
    }
  }

  /// `flying`: whether it is in the air, as far as anybody knows; `fresh`: that is of now. What is stale forbids nothing, but a
  /// drone that was in the air when it was last heard is not given back without a question.
  show(drone, flying, fresh) {
    this.#drone = drone;
    this.#flying = flying;
    this.#fresh = fresh;
    const words = leaseWords(drone, this.#who);
    if (this.#lease.textContent !== words) this.#lease.textContent = words;
    this.#lease.title = drone.lease?.holder ?? '';
    this.#lease.classList.toggle('warn', !isOurs(drone, this.#who));
    this.#actions.hidden = !Object.keys(CONTROLS).some((what) => isShown(what, drone, this.#who));
    if (this.#actions.hidden && this.#requests.hidden && !(drone.requests ?? []).length) return;
    const focused = document.activeElement;
    const held = this.#actions.contains(focused) || this.#requests.contains(focused);
    for (const [what, each] of Object.entries(this.#buttons)) {
      each.hidden = !isShown(what, drone, this.#who);
      each.setAttribute('aria-disabled', whyNotControl(what, drone, this.#who, fresh && flying) !== null);
    }
    this.#showRequests(drone);
    // What has gone does not take the keyboard with it; nor does another button get an Enter that was meant for it.
    if (held && !focused.checkVisibility()) this.#select.focus();
  }

  #showRequests({ requests = [] }) {
    this.#requests.hidden = requests.length === 0;
    for (const [identity, row] of this.#rows) {
      if (requests.some((each) => identityOf(each) === identity)) continue;
      row.element.remove();
      this.#rows.delete(identity);
    }
    for (const request of requests) {
      const identity = identityOf(request);
      if (!this.#rows.has(identity)) this.#rows.set(identity, this.#row(request, identity));
      const row = this.#rows.get(identity);
      const own = identity === this.#who.identity;
      const mine = isOurs(this.#drone, this.#who);
      row.hand_over.hidden = !mine;
      row.deny.hidden = !mine && !own;
      const label = own && !mine ? 'Take the request back' : ANSWERS.deny;
      if (row.deny.textContent !== label) row.deny.textContent = label;
      row.deny.setAttribute('aria-label', `${label}: ${nameOf(identity, this.#who)}, ${this.#name}`);
    }
  }

  #row({ msp, subject }, identity) {
    const element = document.createElement('li');
    const says = Object.assign(document.createElement('span'), { textContent: `${nameOf(identity, this.#who)} asks for it`, title: identity });
    const row = { element };
    for (const [what, label] of Object.entries(ANSWERS)) {
      row[what] = button(label, this.#name, () => this.#send(what, `${label}: ${nameOf(identity, this.#who)}`, { to: { msp, subject } }));
      row[what].dataset.action = what;
      row[what].setAttribute('aria-label', `${label}: ${nameOf(identity, this.#who)}, ${this.#name}`);
    }
    element.append(says, row.hand_over, row.deny);
    this.#requests.append(element);
    return row;
  }

  async #ask(what) {
    const [label] = CONTROLS[what];
    const why = whyNotControl(what, this.#drone, this.#who, this.#fresh && this.#flying);
    if (why) return this.#reply(why);
    const lands = what === 'release' && this.#flying;
    if (lands && !(await confirmed(`Give back ${this.#name}?`, `${this.#name} is in the air. Nobody commands it then: it lands by its failsafe.`, 'Give back'))) return undefined;
    return this.#send(what, label, what === 'acquire' || what === 'request' ? { priority: 0 } : lands ? { confirmed: true } : {});
  }

  async #send(what, label, body) {
    if (!maySign(this.#who)) return this.#reply(SIGN_IN);
    this.#reply(`${label}: sent`);
    const answer = await this.#connection.request('POST', `drones/${encodeURIComponent(this.#name)}/${what}`, body);
    // The ledger's word comes as an event, often before this answer.
    return answer.ok || this.#reply(`${label}: ${answer.words}`);
  }
}
