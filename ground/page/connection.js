// The way to the station: the tokens, the stream with its reconnects, and plain requests that do not need the stream.

const TOKEN = /^[0-9a-f]{64}$/i;
const REQUEST_MS = 3000;
const SIGN_IN_MS = 15000; // a key is unlocked, and its way to the ledger is made
const SILENT_MS = 5000; // states come 30 times a second: a stream that is silent for so long is dead
const FIRST_WAIT_MS = 250;
const MAX_WAIT_MS = 5000;

/// Takes the token out of the address bar, so that it is in no history and on no screenshot.
export function takeToken() {
  const found = new URLSearchParams(location.hash.slice(1)).get('token');
  if (found !== null) {
    history.replaceState(null, '', location.pathname);
    if (TOKEN.test(found) && found !== sessionStorage.getItem('token')) {
      sessionStorage.setItem('token', found);
      sessionStorage.removeItem('session'); // that was another station's
    }
  }
  return sessionStorage.getItem('token');
}

function keptSession() {
  try {
    const kept = JSON.parse(sessionStorage.getItem('session'));
    return TOKEN.test(kept?.token) ? kept : null;
  } catch {
    return null;
  }
}

/// Events: `hello`, `state`, `events`, `blocks`, `missions`, `faults` (detail: the message), `link` (detail: {up, words}), `token` (detail: why one is
/// needed), `session` (detail: what happened to it, in words).
export class Connection extends EventTarget {
  #token = null; // the page's own
  #session = null; // {token, operator, identity} of who is signed in: its token goes before the page's
  #socket = null;
  #fails = 0;
  #heard = 0;
  #wait = 0;
  #paths = {};
  #lostAt = null; // the first time since the last hello
  #newestId = 0; // of what was asked for on the stream
  #unanswered = new Map(); // id -> what takes its answer
  stateMs = 0; // of the newest state, the station's clock: a velocity says what its pilot saw
  hello = { manual: false, speed_mps: 0, cmd_timeout_ms: 0, fence: null };

  get up() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  /// Who is signed in, by name and as the ledger knows him; null: nobody.
  get operator() {
    return this.#session?.operator ?? null;
  }

  get identity() {
    return this.#session?.identity ?? null;
  }

  start(token) {
    if (!TOKEN.test(token ?? '')) {
      this.#say('token', token ? 'A token is 64 hex digits.' :
        'This page needs the token of the ground station: the text of the file that token_file in its ground.toml names, here or behind /#token= in the address.');
      return;
    }
    this.#token = token;
    sessionStorage.setItem('token', token);
    this.#session = keptSession();
    this.#fails = 0;
    this.#open();
  }

  /// Answers {ok, status, words, body}; never throws. `body`: an object, or {text, type} of a file as it is.
  async request(method, path, body) {
    const session = this.#session;
    const answer = await this.#ask(session?.token ?? this.#token, method, path, body);
    if (answer.status !== 401 || !session) return answer;
    if (session === this.#session) this.#change(null, `The session of ${session.operator} is over: the station does not know it any more.`);
    return this.#ask(this.#token, method, path, body); // a stop and a landing need no session
  }

  /// `op`: stop or land, of one drone, a stop also of all (null). It goes out by the open stream and as a request, since either may be shut or full:
  /// the first way that takes it answers. It answers as request() does.
  async bringDown(op, drone = null) {
    const path = drone === null ? op : `drones/${encodeURIComponent(drone)}/${op}`;
    const ways = [this.#askByStream(drone === null ? { op } : { op, drone }), this.request('POST', path, {})];
    const taken = ways.map(async (way) => {
      const answer = await way;
      if (!answer.ok) throw answer;
      return answer;
    });
    return Promise.any(taken).catch(() => ways[1]);
  }

  #askByStream(message) {
    const none = { ok: false, status: 0, body: {}, words: 'the stream is shut' };
    if (!this.up) return Promise.resolve(none);
    const id = ++this.#newestId;
    const answer = new Promise((done) => {
      this.#unanswered.set(id, done);
      setTimeout(() => this.#answered({ id, ...none }), REQUEST_MS);
    });
    this.#socket.send(JSON.stringify({ ...message, id }));
    return answer;
  }

  #answered({ id, status, error }) {
    const done = this.#unanswered.get(id);
    this.#unanswered.delete(id);
    const ok = status >= 200 && status < 300;
    done?.({ ok, status, body: {}, words: ok ? 'accepted' : error ?? 'no answer on the stream' });
  }

  async signIn(operator, passphrase) {
    const answer = await this.#ask(this.#token, 'POST', 'session', { operator, passphrase }, SIGN_IN_MS);
    if (answer.ok) this.#change({ token: answer.body.session, operator, identity: answer.body.identity }, `${operator} is signed in.`);
    return answer;
  }

  async signOut() {
    const session = this.#session;
    if (!session) return;
    const answer = await this.#ask(session.token, 'DELETE', 'session');
    if (session !== this.#session) return;
    const is_known = answer.ok || answer.status === 401;
    this.#change(null, is_known ? `${session.operator} is signed out.` : `${session.operator} is signed out here, and the station does not know: ${answer.words}.`);
  }

  #change(session, words) {
    this.#session = session;
    if (session) sessionStorage.setItem('session', JSON.stringify(session));
    else sessionStorage.removeItem('session');
    this.#say('session', words);
    this.#fails = 0;
    this.#open();
  }

  async #ask(token, method, path, body, timeout_ms = REQUEST_MS) {
    const file = body && 'text' in body;
    try {
      const answer = await fetch(`/api/v1/${path}`, {
        method,
        headers: { Authorization: `Bearer ${token}`, ...(body && { 'Content-Type': file ? body.type : 'application/json' }) },
        body: file ? body.text : body && JSON.stringify(body),
        signal: AbortSignal.timeout(timeout_ms),
        cache: 'no-store',
      });
      const text = await answer.text(); // one that breaks off or takes too long is no answer, whatever its status
      const said = text.startsWith('{') ? JSON.parse(text) : {};
      return { ok: answer.ok, status: answer.status, body: said, words: answer.ok ? 'accepted' : said.error ?? `refused (${answer.status})` };
    } catch (error) {
      const words = error.name === 'TimeoutError' ? `no answer within ${timeout_ms / 1000} s` : 'the station cannot be reached';
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
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = new WebSocket(`${scheme}://${location.host}/api/v1/stream`, ['ledgerline.v1', `token.${this.#session?.token ?? this.#token}`]);
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
    if (message.op === 'hello') this.#greet(message);
    if (message.op === 'paths') this.#paths = message.paths;
    if (message.op === 'answer') this.#answered(message);
    if (message.op === 'state') {
      this.stateMs = message.t_ms;
      message.drones = this.withPaths(message.drones);
    }
    if (['hello', 'state', 'events', 'blocks', 'missions', 'faults'].includes(message.op)) this.#say(message.op, message);
  }

  /// `hello.back`: how long the link was lost, in words; null: it was not.
  #greet(hello) {
    const away = this.#lostAt === null ? null : ((performance.now() - this.#lostAt) / 1000).toFixed(1);
    const restarted = hello.started_ms !== this.hello.started_ms;
    hello.back = away && (restarted ? `Ground was away for ${away} s; it is back` : `The connection was lost for ${away} s; it is back`);
    this.#lostAt = null;
    this.hello = hello;
  }

  async #lost(socket) {
    if (socket !== this.#socket) return;
    this.#socket = null;
    if (this.hello.started_ms) this.#lostAt ??= performance.now();
    socket.onclose = null;
    socket.close();
    // Half of the wait is drawn, so that many pages do not come back all at once.
    const limit = Math.min(MAX_WAIT_MS, FIRST_WAIT_MS * 2 ** this.#fails++);
    const wait = limit / 2 + (Math.random() * limit) / 2;
    this.#wait = setTimeout(() => this.#open(), wait);
    this.#say('link', { up: false, words: `Connection lost: trying again in ${(wait / 1000).toFixed(1)} s` });
    // A refused WebSocket does not say why; a plain request does.
    const asked = await this.request('GET', 'drones');
    if (this.up || (asked.status !== 401 && asked.status !== 403)) return;
    clearTimeout(this.#wait);
    this.#socket?.close();
    this.#socket = null;
    sessionStorage.removeItem('token');
    sessionStorage.removeItem('session');
    this.#session = null;
    this.#say('link', { up: false, words: 'Not connected: the station refuses the token' });
    this.#say('token', `The station refuses this token: ${asked.words}. Paste the one that it uses now.`);
  }

  #say(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
