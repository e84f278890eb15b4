// What a gamepad does, with a document and a navigator of its own: node --test pads.test.mjs
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

const text = readFileSync(join(import.meta.dirname, '../../../../ground/page/pads.js'), 'utf8');
const { flyByGamepad } = await import(`data:text/javascript;base64,${Buffer.from(text).toString('base64')}`);

/// What is read of a pad whose shoulder is pressed after it came, and what the page says of it.
const flown = (mapping) => {
  const frames = [];
  const shares = [];
  const words = { textContent: '' };
  let connected;
  let pressed = false;
  globalThis.document = { hidden: false, hasFocus: () => true };
  const pads = () => [{ mapping, axes: [0, 0, 0, -1], buttons: Array.from({ length: 17 }, () => ({ pressed })) }, null];
  Object.defineProperty(globalThis, 'navigator', { configurable: true, value: { getGamepads: pads } });
  globalThis.requestAnimationFrame = (next) => frames.push(next);
  globalThis.addEventListener = (_what, then) => (connected = then);
  flyByGamepad({ addEventListener() {}, hold: (_hand, share) => shares.push(share) }, words);
  connected();
  pressed = true;
  frames.shift()();
  return { shares, words: words.textContent };
};

test('a pad of the standard layout flies while a shoulder button is held', () => {
  const { shares, words } = flown('standard');
  assert.equal(shares.length, 1);
  assert.equal(shares[0][0], 1);
  assert.match(words, /flying/);
});

test('a pad without that layout flies nothing, and the page says so', () => {
  const { shares, words } = flown('');
  assert.equal(shares.length, 0);
  assert.match(words, /no standard layout/);
});
