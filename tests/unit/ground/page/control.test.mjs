// What a card asks before it gives a drone back, with a document of its own: node --test control.test.mjs
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

const read = (name) => readFileSync(join(import.meta.dirname, '../../../../ground/page/operators', name), 'utf8');
const asUrl = (text) => `data:text/javascript;base64,${Buffer.from(text).toString('base64')}`;
const session = asUrl('export const confirmed = async (...words) => (globalThis.questions.push(words), globalThis.sure);');
const { Control } = await import(asUrl(read('control.js').replace('./rules.js', asUrl(read('rules.js'))).replace('./session.js', session)));

class Element {
  dataset = {};
  classList = { toggle() {} };
  children = [];
  setAttribute() {}
  contains() {
    return false;
  }
  addEventListener(_what, then) {
    this.click = then;
  }
  append(...more) {
    this.children.push(...more);
  }
}
globalThis.document = { activeElement: null, createElement: () => new Element() };

const alice = 'Org2MSP CN=alice';
const who = { operators: [{ name: 'alice', identity: alice }], operator: 'alice', identity: alice };
const drone = { name: 'tello1', lease: { holder: alice, commander: alice, ours: true }, requests: [], stopped_by: [] };

/// What is asked of the person and of the station when Give back is pressed.
async function giveBack(flying, fresh, sure = false) {
  globalThis.questions = [];
  globalThis.sure = sure;
  const asked = [];
  const fields = Object.fromEntries(['lease', 'control', 'requests', 'select'].map((name) => [name, new Element()]));
  const control = new Control('tello1', fields, { request: async (...words) => (asked.push(words), { ok: true }) }, who, () => {});
  control.show(drone, flying, fresh);
  await fields.control.children.find((each) => each.dataset.action === 'release').click();
  return [globalThis.questions.length, asked.length, asked[0]?.[2]];
}

test('a drone in the air is not given back without a question, also when nothing new is known of it', async () => {
  assert.deepEqual(await giveBack(true, true), [1, 0, undefined]);
  assert.deepEqual(await giveBack(true, false), [1, 0, undefined]);
  assert.deepEqual(await giveBack(false, true), [0, 1, {}]);
});

test('who is sure confirms it to the station, which would refuse it otherwise', async () => {
  assert.deepEqual(await giveBack(true, true, true), [1, 1, { confirmed: true }]);
});
