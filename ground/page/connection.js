// The way to the station: the token, the stream with its reconnects, and plain requests that do not need the stream.

const TOKEN = /^[0-9a-f]{64}$/i;
const REQUEST_MS = 3000;
const SILENT_MS = 5000; // states come 30 times a second: a stream that is silent for so long is dead
const FIRST_WAIT_MS = 250;
const MAX_WAIT_MS = 5000;

/// Takes the token out of the address bar, so that it is in no history and on no screenshot.
export function takeToken() {
  const found = new URLSearchParams(location.hash.slice(1)).get('token');
  if (found !== null) {
    history.replaceState(null, '', location.pathname);
    if (TOKEN.test(found)) sessionStorage.setItem('token', found);
  }
  return sessionStorage.getItem('token');
}

/// Events: `hello`, `state`, `events`, `blocks` (detail: the message), `link` (detail: {up, words}), `token` (detail: why one is needed).
export class Connection extends EventTarget {
  #token = null;
  #socket = null;
  #fails = 0;
  #heard = 0;
  #wait = 0;
  #paths = {};
  stateMs = 0; // of the newest state, the station's clock: a velocity says what its pilot saw
  hello = { manual: false, speed_mps: 0, cmd_timeout_ms: 0 };

  get up() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  start(token) {
    if (!TOKEN.test(token ?? '')) {
      this.#say('token', token ? 'A token is 64 hex digits.' : 'This page needs the token of the ground station.');
      return;
    }
    this.#token = token;
    sessionStorage.setItem('token', token);
    this.#fails = 0;
    this.#open();
  }

  /// Answers {ok, words, body}; never throws.
  async request(method, path, body) {
    try {
      const answer = await fetch(`/api/v1/${path}`, {
        method,
        headers: { Authorization: `Bearer ${this.#token}`, ...(body && { 'Content-Type': 'application/json' }) },
        body: body && JSON.stringify(body),
        signal: AbortSignal.timeout(REQUEST_MS),
        cache: 'no-store',
      });
      const said = await answer.json().catch(() => ({}));
      return { ok: answer.ok, status: answer.status, body: said, words: answer.ok ? 'accepted' : said.error ?? `refused (${answer.status})` };
    } catch (error) {
      const words = error.name === 'TimeoutError' ? `no answer within ${REQUEST_MS / 1000} s` : 'the station cannot be reached';
      return { ok: false, status: 0, body: {}, words };
    }
  }

  /// False where it was not sent. A velocity is worth nothing later, so it never waits.
  send(message) {
    if (!this.up || this.#socket.bufferedAmount > 4096) return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  /// Paths come when they change, states all the time.
  withPaths(drones) {
    return drones.map((drone) => ({ ...drone, path: this.#paths[drone.name] ?? [] }));
  }

  /// Called once a second or so: ends a stream that is open and silent.
  check(now) {
    if (this.up && now - this.#heard > SILENT_MS) this.#lost(this.#socket);
  }

  retryNow() {
    if (this.#socket || !this.#token) return;
    clearTimeout(this.#wait);
    this.#open();
  }

  #open() {
    clearTimeout(this.#wait);
    this.#socket?.close();
    const socket = new WebSocket(`ws://${location.host}/api/v1/stream`, ['ledgerline.v1', `token.${this.#token}`]);
    this.#socket = socket;
    this.#say('link', { up: false, words: 'Connecting' });
    socket.onopen = () => {
      if (socket !== this.#socket) return;
      this.#heard = performance.now();
      this.#say('link', { up: true, words: 'Connected' });
    };
    socket.onmessage = (frame) => socket === this.#socket && this.#take(frame.data);
    socket.onclose = () => this.#lost(socket);
  }

  #take(text) {
    let message;
    try {
      message = JSON.parse(text);
    } catch {
      return;
    }
    this.#heard = performance.now();
    this.#fails = 0;
    if (message.op === 'hello') this.hello = message;
    if (message.op === 'paths') this.#paths = message.paths;
    if (message.op === 'state') {
      this.stateMs = message.t_ms;
      message.drones = this.withPaths(message.drones);
    }
    if (['hello', 'state', 'events'].includes(message.op)) this.#say(message.op, message);
    if (message.op === 'blocks') this.#say('blocks', message);
  }

  async #lost(socket) {
    if (socket !== this.#socket) return;
    this.#socket = null;
    socket.onclose = null;
    socket.close();
    // Half of the wait is drawn, so that many pages do not come back all at once.
    const longest = Math.min(MAX_WAIT_MS, FIRST_WAIT_MS * 2 ** this.#fails++);
    const wait = longest / 2 + (Math.random() * longest) / 2;
    this.#wait = setTimeout(() => this.#open(), wait);
    this.#say('link', { up: false, words: `Connection lost: trying again in ${(wait / 1000).toFixed(1)} s` });
    // A refused WebSocket does not say why; a plain request does.
    const asked = await this.request('GET', 'drones');
    if (this.up || (asked.status !== 401 && asked.status !== 403)) return;
    clearTimeout(this.#wait);
    this.#socket?.close();
    this.#socket = null;
    sessionStorage.removeItem('token');
    this.#say('link', { up: false, words: 'Not connected: the station refuses the token' });
    this.#say('token', `The station refuses this token: ${asked.words}. Paste the one that it uses now.`);
  }

  #say(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
