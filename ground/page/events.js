// What happened, newest first; alarms sound until a person has seen them.

const MAX_SHOWN = 200;
const BEEP_EVERY_MS = 1400;
const CLOCK_STEP_MS = 2000; // less is the way of the message, more a new clock
const MARKS = { info: '○ Info', warning: '▲ Warning', alarm: '■ Alarm' }; // shape and word, not colour alone

/// A beep every now and then while it is on. Browsers allow sound only after a gesture.
class Beeper {
  #audio = null;
  #timer = 0;

  constructor() {
    const allow = () => {
      this.#audio ??= new AudioContext();
      this.#audio.resume();
    };
    for (const gesture of ['pointerdown', 'keydown']) addEventListener(gesture, allow, { once: true });
  }

  get allowed() {
    return this.#audio?.state === 'running';
  }

  set on(on) {
    if (on && !this.#timer) {
      this.#beep();
      this.#timer = setInterval(() => this.#beep(), BEEP_EVERY_MS);
    } else if (!on) {
      clearInterval(this.#timer);
      this.#timer = 0;
    }
  }

  #beep() {
    if (!this.allowed) return;
    const now = this.#audio.currentTime;
    for (const [after, pitch] of [[0, 880], [0.18, 660]]) {
      const tone = this.#audio.createOscillator();
      const loud = this.#audio.createGain();
      tone.frequency.value = pitch;
      loud.gain.setValueAtTime(0.0001, now + after);
      loud.gain.exponentialRampToValueAtTime(0.25, now + after + 0.02);
      loud.gain.exponentialRampToValueAtTime(0.0001, now + after + 0.15);
      tone.connect(loud).connect(this.#audio.destination);
      tone.start(now + after);
      tone.stop(now + after + 0.16);
    }
  }
}

export class Events {
  #list = document.getElementById('events-list');
  #strip = document.getElementById('alarm');
  #words = document.getElementById('alarm-words');
  #button = document.getElementById('acknowledge');
  #beeper = new Beeper();
  #last = 0; // number of the newest event shown
  #seen = Number(sessionStorage.getItem('seen') ?? 0); // number of the newest alarm that a person has acknowledged
  #open = []; // alarms nobody has acknowledged
  #offset_ms = null;
  #named;

  /// `named(text)`: with short names in it.
  constructor(named) {
    this.#named = named;
    this.#button.addEventListener('click', () => this.acknowledge());
    setInterval(() => this.#open.length && this.#tellSound(), 1000);
  }

  /// A station that restarted counts from the beginning. `started`: when this one was, as its hello says.
  restart(started) {
    if (sessionStorage.getItem('started') === `${started}`) return;
    sessionStorage.setItem('started', started);
    sessionStorage.setItem('seen', 0);
    this.#last = this.#seen = 0;
    this.#open = [];
    this.#list.replaceChildren();
    this.#show();
  }

  /// What the page itself has to say, now.
  note(text) {
    this.#list.prepend(this.#row({ level: 'info', text, t_ms: Date.now() - this.#offset_ms }));
  }

  add(events) {
    const fresh = events.filter((event) => event.n > this.#last);
    if (!fresh.length) return;
    for (const event of fresh) {
      this.#last = event.n;
      this.#list.prepend(this.#row(event));
      if (event.level === 'alarm' && event.n > this.#seen) this.#open.push(event);
    }
    while (this.#list.children.length > MAX_SHOWN) this.#list.lastElementChild.remove();
    this.#show();
  }

  /// `offset_ms`: from the station's clock, which counts from its start, to the time of day.
  setClock(offset_ms) {
    if (this.#offset_ms !== null && Math.abs(offset_ms - this.#offset_ms) < CLOCK_STEP_MS) return;
    this.#offset_ms = offset_ms;
    for (const time of this.#list.querySelectorAll('time')) this.#tellTime(time);
  }

  acknowledge() {
    if (!this.#open.length) return;
    this.#seen = this.#last;
    sessionStorage.setItem('seen', this.#seen);
    this.#open = [];
    this.#show();
  }

  #sayOf({ drone, text }) {
    return this.#named(drone ? `${drone}: ${text}` : text);
  }

  #tellTime(time) {
    if (this.#offset_ms !== null) time.textContent = new Date(Number(time.dataset.t) + this.#offset_ms).toTimeString().slice(0, 8);
  }

  #row(event) {
    const row = document.createElement('li');
    row.className = `event ${event.level in MARKS ? event.level : 'info'}`;
    const [level, time, text] = ['strong', 'time', 'span'].map((tag) => document.createElement(tag));
    level.textContent = MARKS[event.level] ?? MARKS.info;
    time.dataset.t = event.t_ms;
    this.#tellTime(time);
    text.textContent = this.#sayOf(event);
    text.title = event.text;
    row.append(level, ' ', time, ' ', text);
    return row;
  }

  #show() {
    const count = this.#open.length;
    this.#strip.classList.toggle('on', count > 0);
    this.#button.hidden = count === 0;
    const words = count === 0 ? 'No alarm' : `■ ${count > 1 ? `${count} alarms so far, the newest` : '1 alarm so far'}: ${this.#sayOf(this.#open.at(-1))}`;
    if (this.#words.textContent !== words) this.#words.textContent = words;
    this.#beeper.on = count > 0;
    this.#tellSound();
  }

  #tellSound() {
    document.getElementById('alarm-sound').hidden = this.#open.length === 0 || this.#beeper.allowed;
  }
}
