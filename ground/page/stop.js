// Stop all: said by every way to the station and repeated until it accepts, what is confirmed for each drone since, and
// how it goes on when all are down.

const AGAIN_MS = 500;
const MAX_TRIES = 60;
const STEPS = ['sent', 'accepted', 'on ledger', 'landing', 'on ground'];
const NEXT = 'All are on the ground. Clear the stops to take off again; what somebody else has stopped, he clears.';
const DOWN = ['waiting', 'landed', 'failed'];

function stepsOf(drone) {
  const down = drone.phase === 'landed' || (DOWN.includes(drone.phase) && drone.link_phase === 'on_ground');
  return { 'on ledger': drone.stopped_by?.length > 0, landing: drone.phase === 'landing', 'on ground': down };
}

const isOnLedger = (rows) => rows.size > 0 && [...rows.values()].every(({ done }) => done.has('on ledger'));
/// Every stop was on the ledger, and is not any more.
const isCleared = (drones, rows) => isOnLedger(rows) && !drones.some((drone) => drone.stopped_by?.length > 0);

export class StopAll {
  #connection;
  #nameOf;
  #panel = document.getElementById('stop-panel');
  #words = document.getElementById('stop-words');
  #clear = document.getElementById('stop-clear');
  #list = document.getElementById('stop-list');
  #rows = new Map(); // name -> {row, done: set of steps}
  #tries = 0;
  #accepted = false;
  #running = false;
  onstop = () => {};

  /// `nameOf(identity)`: the short name of who has stopped.
  constructor(connection, nameOf) {
    this.#connection = connection;
    this.#nameOf = nameOf;
    document.getElementById('stop-all').addEventListener('click', () => this.stop());
    this.#clear.addEventListener('click', () => this.#clearAll());
    document.getElementById('stop-close').addEventListener('click', () => this.#close());
  }

  #close() {
    const held = this.#panel.contains(document.activeElement);
    this.#panel.hidden = true;
    if (held) document.getElementById('stop-all').focus();
  }

  get open() {
    return !this.#panel.hidden;
  }

  /// `drones`: those known, however old what is known of them.
  async stop(drones = this.drones ?? []) {
    this.onstop();
    this.#panel.hidden = false;
    this.#tries = 0;
    this.#accepted = false;
    this.#clear.hidden = true;
    this.#list.replaceChildren();
    this.#rows.clear();
    for (const drone of drones) this.#mark(drone.name, 'sent');
    if (this.#running) return;
    this.#running = true;
    while (!this.#accepted && this.#tries < MAX_TRIES) {
      ++this.#tries;
      this.#words.textContent = this.#tries === 1 ? 'Stop sent to all drones.' : `Stop sent again (${this.#tries}).`;
      const answer = await this.#connection.bringDown('stop');
      if (answer.ok) {
        this.#accepted = true;
        this.#words.textContent = 'The station has accepted the stop of all drones.';
        for (const name of this.#rows.keys()) this.#mark(name, 'accepted');
      } else {
        this.#words.textContent = `Stop NOT confirmed: ${answer.words}. Sending it again. Use the local stop key at the drones if you can.`;
        await new Promise((done) => setTimeout(done, AGAIN_MS));
      }
    }
    if (!this.#accepted) this.#words.textContent = 'Stop NOT confirmed. Press Stop all again, or use the local stop key at the drones.';
    this.#running = false;
  }

  /// What the newest state says; also of a drone that was not known when the stop was sent.
  update(drones) {
    this.drones = drones;
    if (!this.open || !this.#accepted) return;
    for (const drone of drones) {
      this.#mark(drone.name, 'accepted');
      for (const [step, done] of Object.entries(stepsOf(drone))) {
        if (done) this.#mark(drone.name, step, step === 'on ledger' ? `: ${drone.stopped_by.map(this.#nameOf).join(', ')}` : '');
      }
    }
    if (!this.pending && isOnLedger(this.#rows) && this.#clear.hidden) {
      this.#clear.hidden = false;
      this.#words.textContent = NEXT;
    }
    if (!this.pending && isCleared(drones, this.#rows)) this.#close();
  }

  /// What comes of it the drones' cards say; who is refused, and why, is said here.
  async #clearAll() {
    this.#words.textContent = 'Clear all stops: sent.';
    const stopped = this.drones.filter((drone) => drone.stopped_by?.length > 0);
    const answers = await Promise.all(stopped.map(({ name }) => this.#connection.request('POST', `drones/${encodeURIComponent(name)}/clear_stop`, {})));
    const refused = answers.flatMap((answer, i) => (answer.ok ? [] : [`${stopped[i].name}: ${answer.words}`]));
    if (refused.length && !this.#clear.hidden) this.#words.textContent = `Not cleared: ${refused.join('; ')}.`;
  }

  get pending() {
    return this.open && this.#accepted && [...this.#rows.values()].some((row) => !row.done.has('on ground'));
  }

  #mark(name, step, more = '') {
    let entry = this.#rows.get(name);
    if (!entry) {
      const row = document.createElement('li');
      const who = document.createElement('strong');
      who.textContent = name;
      row.append(who, ...STEPS.map((each) => {
        const mark = document.createElement('span');
        mark.className = 'step';
        mark.textContent = `– ${each}`;
        return mark;
      }));
      this.#list.append(row);
      entry = { row, done: new Set() };
      this.#rows.set(name, entry);
    }
    const mark = entry.row.children[1 + STEPS.indexOf(step)];
    const words = `✓ ${step}${more}`;
    if (mark.textContent === words) return;
    mark.textContent = words;
    entry.done.add(step);
    // It stood on the ground all the time, or its landing was not seen.
    if (step === 'on ground' && !entry.done.has('landing')) entry.row.children[1 + STEPS.indexOf('landing')].hidden = true;
    mark.classList.add('done');
  }
}
