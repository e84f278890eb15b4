// Flying by hand: every source of a command (keys, gamepad, touch pads) is a deadman. While one is held, velocities go out;
// when the last is let go, zero goes out once, and then nothing.
import { inDialog } from './operators/session.js';

const SEND_MS = 66; // 15 a second; the station holds a velocity for cmd_timeout_ms
const YAW_RATE = 1.0; // rad/s at full deflection
const CLIMB = 0.6; // of the speed: height is flown slower

// forward, left, up, turn left
const MOVES = {
  KeyW: [1, 0, 0, 0], KeyS: [-1, 0, 0, 0], KeyA: [0, 1, 0, 0], KeyD: [0, -1, 0, 0],
  ArrowUp: [0, 0, 1, 0], ArrowDown: [0, 0, -1, 0], ArrowLeft: [0, 0, 0, 1], ArrowRight: [0, 0, 0, -1],
};
const clip = (value) => Math.max(-1, Math.min(1, value));

/// Sums the sources and sends. `send(drone, linear, yaw_rate)`; `target()` names the drone that may be flown now, or null.
/// Event `release`: every source must be released and held again.
export class Hand extends EventTarget {
  #sources = new Map(); // name -> [forward, left, up, turn]
  #flown = null; // the drone that got the last velocity that was not zero
  speed_mps = 0;
  onchange = () => {};

  constructor(send, target) {
    super();
    this.send = send;
    this.target = target;
    setInterval(() => this.#tick(), SEND_MS);
    addEventListener('blur', () => this.release());
    addEventListener('pagehide', () => this.release());
    document.addEventListener('visibilitychange', () => document.hidden && this.release());
  }

  get flown() {
    return this.#flown;
  }

  /// `shares`: four shares from -1 to 1, or null when it is let go.
  hold(source, shares) {
    if (shares) this.#sources.set(source, shares);
    else if (!this.#sources.delete(source)) return;
    if (this.#sources.size === 0) this.#zero();
    else if (!this.#flown) this.#tick(); // at once, not at the next tick
  }

  /// All is released: keys that are still down must be pressed again.
  release() {
    this.#sources.clear();
    this.dispatchEvent(new Event('release'));
    this.#zero();
  }

  #tick() {
    if (this.#sources.size === 0) return;
    const drone = this.target();
    if (drone !== this.#flown) this.#zero();
    if (drone === null) return;
    const [forward, left, up, turn] = [0, 1, 2, 3].map((axis) => clip([...this.#sources.values()].reduce((sum, shares) => sum + shares[axis], 0)));
    const sideways = Math.max(1, Math.hypot(forward, left)); // diagonals are not faster
    const v = this.speed_mps;
    this.send(drone, [(forward / sideways) * v, (left / sideways) * v, up * v * CLIMB], turn * YAW_RATE);
    this.#flown = drone;
    this.onchange(drone);
  }

  #zero() {
    if (this.#flown === null) return;
    this.send(this.#flown, [0, 0, 0], 0);
    this.#flown = null;
    this.onchange(null);
  }
}

const typing = (element) => element.matches?.('input, select');

/// The keys of flight. `enabled()`: whether those keys fly now; else they stay the browser's.
export function flyByKeys(hand, enabled) {
  const down = new Set();
  const tell = () => {
    const shares = [...down].reduce((sum, code) => sum.map((share, axis) => share + MOVES[code][axis]), [0, 0, 0, 0]);
    hand.hold('keys', down.size ? shares : null);
  };
  hand.addEventListener('release', () => down.clear());
  addEventListener('keydown', (event) => {
    if (!(event.code in MOVES) || event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey) return;
    if (typing(event.target) || inDialog() || !enabled()) return;
    event.preventDefault();
    if (event.repeat) return;
    down.add(event.code);
    tell();
  });
  addEventListener('keyup', (event) => down.delete(event.code) && tell());
  // What takes the keyboard away may take the keyup with it.
  addEventListener('keydown', (event) => event.key === 'Meta' && hand.release());
  addEventListener('contextmenu', () => hand.release());
}

/// Keys that are no flight: `actions` maps event.key to what it does; it answers true when it did something.
export function bindKeys(actions) {
  addEventListener('keydown', (event) => {
    if (event.repeat || event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey) return;
    // In a field, keys are for its text; a list and a check box have no use for Backspace.
    if (typing(event.target) && !(event.key === 'Backspace' && event.target.matches('select, [type=checkbox]'))) return;
    if (inDialog() && event.key !== 'Backspace') return;
    const act = actions[event.key] ?? (/^[1-9]$/.test(event.key) ? actions.digit : undefined);
    if (act?.(event)) event.preventDefault();
  });
}
