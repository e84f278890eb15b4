// What the page says of faults that are switched; needs no browser: node --test faults.test.mjs
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

const read = (name) => readFileSync(join(import.meta.dirname, '../../../../ground/page', name), 'utf8');
const asUrl = (text) => `data:text/javascript;base64,${Buffer.from(text).toString('base64')}`;
const panel = await import(asUrl(read('faults/panel.js').replace(/^import .*$/gm, '')));

const silent = { name: 'silent-tello1', drone: 'tello1', label: 'Drone silent', words: 'w', on: true };
const stalled = { name: 'ledger-stalled', drone: '', label: 'Ledger stalled', words: 'w', on: true };

test('who does not look at the switches reads which are on', () => {
  assert.equal(panel.wordsOfFaults([], ''), 'None is on.');
  assert.equal(panel.wordsOfFaults([{ ...silent, on: false }, { ...stalled, on: false }], ''), 'None is on.');
  assert.equal(panel.wordsOfFaults([silent, stalled], ''), '▲ On: tello1: Drone silent, Ledger stalled');
});

test('switches that nobody reaches are not shown as off', () => {
  assert.equal(panel.wordsOfFaults([], 'not reached'), 'not reached');
});
