// The page's two tokens: whose a request is, and what is done when a session is over; needs no browser: node --test connection.test.mjs
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

const text = readFileSync(join(import.meta.dirname, '../../../../ground/page/connection.js'), 'utf8');
const { Connection } = await import(`data:text/javascript;base64,${Buffer.from(text).toString('base64')}`);
const own = 'a'.repeat(64);
const session = { token: 'b'.repeat(64), operator: 'alice', identity: 'Org2MSP CN=alice' };

/// A station that answers by `answer(token, method, path)`: [status, body]. `asked`: what it was asked; `streams`: with which tokens; `urls`: of these.
function station(answer, kept = null, protocol = 'http:') {
  const calls = { asked: [], streams: [], urls: [], said: [], sent: [] };
  const store = new Map(kept ? [['session', JSON.stringify(kept)]] : []);
  globalThis.sessionStorage = { getItem: (key) => store.get(key) ?? null, setItem: (key, value) => store.set(key, value), removeItem: (key) => store.delete(key) };
  globalThis.location = { protocol, host: '127.0.0.1:8800' };
  globalThis.WebSocket = class {
    static OPEN = 1;
    constructor(url, protocols) {
      calls.urls.push(url);
      calls.streams.push(protocols[1].slice('token.'.length));
      calls.socket = this;
    }
    send(text) {
      calls.sent.push(JSON.parse(text));
    }
    close() {}
  };
  globalThis.fetch = async (path, { method, headers }) => {
    const token = headers.Authorization.slice('Bearer '.length);
    calls.asked.push([token, method, path]);
    const [status, body] = answer(token, method, path);
    return new Response(JSON.stringify(body), { status });
  };
  const connection = new Connection();
  connection.addEventListener('session', ({ detail }) => calls.said.push(detail));
  connection.start(own);
  return { connection, calls, store };
}

test('a stop gets through with the own token when the session is over', async () => {
  const { connection, calls, store } = station((token) => (token === own ? [202, {}] : [401, { error: 'over' }]), session);
  assert.equal(connection.operator, 'alice');
  assert.ok((await connection.request('POST', 'stop', { cut: false })).ok);
  assert.deepEqual(calls.asked.map(([token]) => token), [session.token, own]);
  assert.equal(connection.operator, null);
  assert.match(calls.said[0], /session of alice is over/);
  assert.ok(!store.has('session') && store.get('token') === own, 'only the session is forgotten');
  assert.deepEqual(calls.streams, [session.token, own]);
});

test('a stop goes out by the open stream as well, and counts when that alone takes it', async () => {
  const { connection, calls } = station(() => [503, { error: 'full' }]);
  calls.socket.readyState = 1;
  const stopped = connection.bringDown('stop'), landed = connection.bringDown('land', 'tello1');
  assert.deepEqual(calls.sent, [{ op: 'stop', id: 1 }, { op: 'land', drone: 'tello1', id: 2 }]);
  calls.socket.onmessage({ data: '{"op":"answer","id":2,"status":202}' });
  calls.socket.onmessage({ data: '{"op":"answer","id":1,"status":503,"error":"nothing flies"}' });
  assert.ok((await landed).ok);
  const answer = await stopped;
  assert.ok(!answer.ok);
  assert.equal(answer.words, 'full');
  assert.deepEqual(calls.asked.map(([, , path]) => path), ['/api/v1/stop', '/api/v1/drones/tello1/land']);
});

test('a stop needs no open stream', async () => {
  const { connection, calls } = station(() => [202, {}]);
  assert.ok((await connection.bringDown('stop')).ok);
  assert.deepEqual(calls.sent, []);
});

test('what the own token may not is refused, and asked once', async () => {
  const { connection, calls } = station(() => [403, { error: 'sign in first' }]);
  assert.equal((await connection.request('POST', 'drones/tello1/takeoff')).words, 'sign in first');
  assert.equal(calls.asked.length, 1);
});

test('who signs in asks by his session, and signing out goes back to the own token', async () => {
  const { connection, calls, store } = station((_token, method) => (method === 'POST' ? [200, { session: session.token, identity: session.identity }] : [202, {}]));
  assert.ok((await connection.signIn('alice', 'phrase')).ok);
  await connection.request('GET', 'drones');
  await connection.signOut();
  await connection.request('GET', 'drones');
  assert.deepEqual(calls.asked.map(([token]) => token), [own, session.token, session.token, own]);
  assert.deepEqual(calls.streams, [own, session.token, own]);
  assert.deepEqual(calls.said, ['alice is signed in.', 'alice is signed out.']);
  assert.ok(!store.has('session'));
});

test('a wrong pass phrase changes nothing, and a kept session that is none is not used', async () => {
  const { connection, calls } = station(() => [403, { error: 'wrong' }], { token: 'short', operator: 'alice' });
  assert.equal(connection.operator, null);
  assert.equal((await connection.signIn('alice', 'no')).words, 'wrong');
  assert.deepEqual([connection.operator, calls.said, calls.streams], [null, [], [own]]);
});

test('the stream of a page of https is one of wss', () => {
  assert.deepEqual(station(() => [200, {}]).calls.urls, ['ws://127.0.0.1:8800/api/v1/stream']);
  assert.deepEqual(station(() => [200, {}], null, 'https:').calls.urls, ['wss://127.0.0.1:8800/api/v1/stream']);
});
