// How long a battery lasts, by how it has gone down.

const WINDOW_MS = 300000;
const EVERY_MS = 2000;
const MIN_MS = 120000;
const MIN_DROP = 3; // percent: less may be a cell's whim
const NEW_BATTERY = 5; // percent up at once: it was changed, or is charged

/// The line through the last minutes of one battery (least squares).
export class BatteryTime {
  #points = []; // {t, percent}

  /// On the ground it says nothing of a flight: what was known is forgotten.
  add(now, percent, flies = true) {
    if (!flies) this.#points = [];
    const last = this.#points.at(-1);
    if (!flies || percent === null || (last && now - last.t < EVERY_MS)) return;
    if (last && percent > last.percent + NEW_BATTERY) this.#points = [];
    this.#points.push({ t: now, percent });
    while (now - this.#points[0].t > WINDOW_MS) this.#points.shift();
  }

  /// Seconds from the newest value until it is empty; null: not known yet.
  left_s() {
    const [first, last] = [this.#points[0], this.#points.at(-1)];
    if (!first || last.t - first.t < MIN_MS || first.percent - last.percent < MIN_DROP) return null;
    const count = this.#points.length;
    const mean = (of) => this.#points.reduce((sum, each) => sum + of(each), 0) / count;
    const [t, percent] = [mean((each) => each.t), mean((each) => each.percent)];
    const falls = mean((each) => (each.t - t) * (each.percent - percent)) / mean((each) => (each.t - t) ** 2);
    if (falls >= 0) return null;
    return Math.max(0, (-(percent + falls * (last.t - t)) / falls) / 1000);
  }
}

/// Words, and how bad it is: '', 'warn' or 'bad'.
export function timeLeft(left_s) {
  if (left_s === null) return { words: 'not known yet', level: '' };
  if (left_s < 60) return { words: 'less than a minute', level: 'bad' };
  const minutes = Math.floor(left_s / 60);
  return { words: `about ${minutes} min`, level: minutes < 2 ? 'bad' : minutes < 4 ? 'warn' : '' };
}
