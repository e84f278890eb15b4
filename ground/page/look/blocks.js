// The ledger's blocks as they come, newest first.

const MAX_SHOWN = 50;
const RATE_MS = 10000;

export class Blocks {
  #list = document.getElementById('blocks-list');
  #words = document.getElementById('blocks-words');
  #last = -1; // number of the newest block shown
  #came = []; // when the last ones came, by the station's clock
  #shown = []; // {n, t_ms, words}: what the list shows when somebody looks
  #offset_ms = null;
  #drawn = null;

  /// From the station's clock, which counts from its start, to the time of day.
  setClock(offset_ms) {
    this.#offset_ms ??= offset_ms;
  }

  /// A station that restarted may follow another ledger.
  restart() {
    this.#last = -1;
    this.#came = [];
    this.#shown = [];
    this.#drawn = null;
  }

  add(blocks) {
    for (const block of blocks) {
      if (!(block.n > this.#last)) continue;
      this.#last = block.n;
      this.#came.push(block.t_ms);
      this.#shown.unshift(block);
    }
    this.#shown.length = Math.min(this.#shown.length, MAX_SHOWN);
    while (this.#came.length && this.#came.at(-1) - this.#came[0] > RATE_MS) this.#came.shift();
  }

  /// `now_ms`: the station's clock.
  draw(now_ms) {
    const newest = this.#shown[0];
    const rate = this.#came.filter((t) => now_ms - t < RATE_MS).length / (RATE_MS / 1000);
    const words = newest ? `Block ${newest.n}, ${Math.max(0, (now_ms - newest.t_ms) / 1000).toFixed(1)} s ago; ${rate.toFixed(1)} a second` : 'No block has come yet.';
    if (this.#words.textContent !== words) this.#words.textContent = words;
    if (!this.#list.offsetParent || this.#drawn === newest?.n) return;
    this.#drawn = newest?.n ?? null;
    this.#list.replaceChildren(...this.#shown.map((block) => this.#row(block)));
  }

  #row(block) {
    const row = document.createElement('li');
    row.className = `event${block.invalid ? ' warning' : ''}`;
    const [number, time, text] = ['strong', 'time', 'span'].map((tag) => document.createElement(tag));
    number.textContent = block.invalid ? `▲ ${block.n}` : `${block.n}`;
    if (this.#offset_ms !== null) time.textContent = new Date(block.t_ms + this.#offset_ms).toTimeString().slice(0, 8);
    const kinds = Object.entries(block.kinds ?? {}).map(([kind, count]) => `${count} ${kind}`).join(', ');
    text.textContent = [kinds || 'empty', block.ours ? `${block.ours} ours` : '', block.invalid ? `${block.invalid} not valid` : ''].filter(Boolean).join(' · ');
    row.append(number, ' ', time, ' ', text);
    return row;
  }
}
