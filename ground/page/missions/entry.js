// One mission in the panel's list: what is known of it, and its buttons.
import { put } from '../drones.js';
import { nameOf } from '../operators/rules.js';
import { confirmed } from '../operators/session.js';
import { ACTIONS, approvalWords, droneWords, findingWords, isForbidden, phaseWords, whyNot } from './words.js';

const HASH_SHOWN = 12;

function button(label, click) {
  const made = Object.assign(document.createElement('button'), { type: 'button', textContent: label });
  made.addEventListener('click', click);
  return made;
}

export class Entry {
  #connection;
  #who;
  #fields = {};
  #buttons = {};
  #findings = '[]';
  mission;

  /// `see(entry)`: its paths are to be shown, or not any more.
  constructor(mission, connection, who, see) {
    this.mission = mission;
    this.#connection = connection;
    this.#who = who;
    this.element = document.getElementById('mission').content.firstElementChild.cloneNode(true);
    for (const field of this.element.querySelectorAll('[data-field]')) this.#fields[field.dataset.field] = field;
    const { name, hash } = mission;
    const fields = this.#fields;
    put(fields.name, name);
    put(fields.hash, `${hash.slice(0, HASH_SHOWN)}…`);
    fields.hash.title = hash;
    const copy = button('Copy', () => this.#copy());
    copy.title = hash;
    copy.setAttribute('aria-label', `Copy the digest of ${name}`);
    fields.hash.after(' ', copy);
    fields.findings.setAttribute('aria-label', `Findings of ${name}`);
    this.#buttons.show = button('Show', () => see(this));
    for (const [what, [label]] of Object.entries(ACTIONS)) this.#buttons[what] = button(label, () => this.#ask(what));
    for (const [what, each] of Object.entries(this.#buttons)) {
      each.dataset.action = what;
      each.setAttribute('aria-label', `${each.textContent} ${name}`);
      fields.actions.append(each);
    }
    this.shown = false;
  }

  set shown(on) {
    this.#buttons.show.setAttribute('aria-pressed', on);
  }

  show(mission = this.mission) {
    this.mission = mission;
    const fields = this.#fields;
    put(fields.phase, phaseWords(mission));
    fields.phase.dataset.phase = mission.phase === 'aborted' ? 'failed' : mission.phase;
    put(fields.drones, droneWords(mission));
    put(fields.approvals, approvalWords(mission, this.#who));
    fields.approvals.title = mission.approvals.join('; ');
    this.#optional('by', mission.by ? nameOf(mission.by, this.#who) : '');
    this.#optional('why', mission.why);
    this.#showFindings(mission.findings);
    const pause = mission.paused ? 'Resume' : 'Pause';
    if (this.#buttons.pause.textContent !== pause) {
      this.#buttons.pause.textContent = pause;
      this.#buttons.pause.setAttribute('aria-label', `${pause} ${mission.name}`);
    }
    for (const what of Object.keys(ACTIONS)) {
      const why = whyNot(what, mission, this.#who);
      this.#buttons[what].setAttribute('aria-disabled', why !== null);
      this.#buttons[what].title = why ?? '';
    }
  }

  reply(words) {
    put(this.#fields.reply, words);
  }

  #showFindings(findings) {
    const said = findings.map((each) => findingWords(each));
    if (JSON.stringify(said) === this.#findings) return;
    this.#findings = JSON.stringify(said);
    this.#fields.findings.hidden = said.length === 0;
    this.#fields.findings.replaceChildren(...said.map(([mark, words], i) => {
      const row = Object.assign(document.createElement('li'), { className: findings[i].forbids ? 'bad' : 'warn' });
      row.append(Object.assign(document.createElement('strong'), { textContent: mark }), `: ${words}`);
      return row;
    }));
  }

  #optional(name, text) {
    this.#fields[name].parentElement.hidden = !text;
    put(this.#fields[name], text ?? '');
  }

  async #copy() {
    try {
      await navigator.clipboard.writeText(this.mission.hash);
      this.reply('The digest is copied.');
    } catch {
      this.reply(`This browser does not let a page copy: ${this.mission.hash}`);
    }
  }

  async #ask(what) {
    const { id, name, paused, drones } = this.mission;
    const label = this.#buttons[what].textContent;
    const why = whyNot(what, this.mission, this.#who);
    if (why) return this.reply(`${label}: ${why}`);
    const flies = `${drones.join(', ')} take off, and fly their paths together.${isForbidden(this.mission) ? ' A finding forbade that when it was checked last: it is checked again.' : ''}`;
    if (what === 'start' && !(await confirmed(`Start ${name}?`, flies, 'Start'))) return undefined;
    this.reply(`${label}: sent`);
    const path = `missions/${encodeURIComponent(id)}`;
    const answer = what === 'remove' ? await this.#connection.request('DELETE', path) : await this.#connection.request('POST', `${path}/${what === 'pause' && paused ? 'resume' : what}`, {});
    return this.reply(`${label}: ${answer.words}`);
  }
}
