// Who may do what, and what a mission says, as the page has it; needs no browser: node --test crew.test.mjs
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

// The page's files are modules for browsers: nothing beside them says so to Node.js.
const read = (name) => readFileSync(join(import.meta.dirname, '../../../../ground/page', name), 'utf8');
const asUrl = (text) => `data:text/javascript;base64,${Buffer.from(text).toString('base64')}`;
const rules = await import(asUrl(read('operators/rules.js')));
const words = await import(asUrl(read('missions/words.js').replace('../operators/rules.js', asUrl(read('operators/rules.js')))));

const alice = 'Org2MSP CN=alice@org2,OU=client';
const bob = 'Org2MSP CN=bob@org2,OU=client';
const ground = 'Org2MSP CN=User1@org2,OU=client';
const operators = [{ name: 'alice', identity: alice }, { name: 'bob', identity: bob }];
const of_alice = { operators, operator: 'alice', identity: alice };
const signed_out = { operators, operator: null, identity: null };
const without = { operators: [], operator: null, identity: null };
const held = (holder, ours = true, more = {}) => ({ name: 'tello1', lease: { holder, commander: ours ? ground : holder, ours, epoch: 1 }, requests: [], stopped_by: [], ...more });

test('with operators only the holder flies a drone, and the words say whom to ask', () => {
  assert.equal(rules.whyNotMine(held(alice), of_alice), null);
  assert.equal(rules.whyNotMine(held(bob), of_alice), 'tello1 is held by bob: ask for it.');
  assert.equal(rules.whyNotMine(held(null, false), of_alice), 'tello1 is held by nobody: take control first.');
  assert.equal(rules.whyNotMine(held(alice), signed_out), rules.SIGN_IN);
  assert.match(rules.whyNotMine(held(alice, false), of_alice), /commanded from elsewhere/);
});

test('without operators the station flies what it commands', () => {
  assert.equal(rules.whyNotMine(held(ground), without), null);
  assert.equal(rules.whyNotMine(held(bob, false), without), 'tello1 is held by bob@org2 (Org2MSP).');
  assert.equal(rules.whyNotMine(held(null, false), without), 'tello1 is held by nobody.');
  assert.equal(rules.leaseWords(held(ground), without), 'ours: User1@org2 (Org2MSP)');
});

test('a card shows what can be signed for its drone now', () => {
  const shown = (drone, who) => Object.keys(rules.CONTROLS).filter((what) => rules.CONTROLS[what][1](drone, who));
  assert.deepEqual(shown(held(null, false), of_alice), ['acquire']);
  assert.deepEqual(shown(held(alice), of_alice), ['release']);
  assert.deepEqual(shown(held(alice, false), of_alice), ['acquire', 'release']);
  assert.deepEqual(shown(held(bob), of_alice), ['request']);
  assert.deepEqual(shown(held(bob, true, { stopped_by: [alice] }), of_alice), ['request', 'clear_stop']);
  for (const what of Object.keys(rules.CONTROLS)) assert.equal(rules.whyNotControl(what, held(bob), signed_out), rules.SIGN_IN);
  assert.match(rules.whyNotControl('request', held(bob, true, { requests: [{ msp: 'Org2MSP', subject: 'CN=alice@org2,OU=client', priority: 0 }] }), of_alice), /already/);
  assert.match(rules.whyNotControl('clear_stop', held(bob), of_alice, true), /landing/);
});

test('without operators a page may clear a stop, and nothing else', () => {
  const stopped = held(ground, true, { stopped_by: [ground] });
  assert.deepEqual(Object.keys(rules.CONTROLS).filter((what) => rules.isShown(what, stopped, without)), ['clear_stop']);
  assert.deepEqual(Object.keys(rules.CONTROLS).filter((what) => rules.isShown(what, held(ground), without)), []);
  assert.equal(rules.whyNotControl('clear_stop', stopped, without, false), null);
  assert.match(rules.whyNotControl('clear_stop', stopped, without, true), /landing/);
});

test('what is reported of an operator names that operator and nobody else', () => {
  assert.equal(rules.named(`stopped by ${alice}, ${bob}`, of_alice), 'stopped by alice, bob');
  assert.equal(rules.named(`held by ${alice}, who lets ${ground} command it`, of_alice), `held by alice, who lets ${ground} command it`);
  for (const other of [`${alice}x`, `${alice},O=org3`]) assert.equal(rules.named(`held by ${other}`, of_alice), `held by ${other}`);
});

test('what came of a request is said on its card: by its signer, or why the drone does not do it', () => {
  const refused = { level: 'warning', text: `no take-off: its lease is held by ${bob}` };
  assert.equal(rules.replyOf({ level: 'info', text: 'alice: take control' }, of_alice), 'alice: take control: done');
  assert.equal(rules.replyOf({ level: 'warning', text: 'bob: take control: refused' }, of_alice), null);
  assert.equal(rules.replyOf({ level: 'info', text: 'land, asked for by alice' }, of_alice), null, 'nothing has come of it yet');
  assert.equal(rules.replyOf(refused, without), refused.text);
  assert.equal(rules.replyOf(refused, of_alice), 'no take-off: its lease is held by bob');
  assert.equal(rules.replyOf({ level: 'alarm', text: 'link does not reach it' }, without), null);
});

const mission = (more) => ({ name: 'survey', drones: ['tello1', 'tello2'], phase: 'checked', paused: false, approvals: [], approvals_needed: 2, findings: [], reached: {}, ...more });

test('a mission counts its approvals, and says whose they are', () => {
  assert.equal(words.approvalWords(mission(), of_alice), '0 of 2 approved');
  assert.equal(words.approvalWords(mission({ approvals: [alice] }), of_alice), '1 of 2 approved: alice');
  assert.equal(words.whyNot('approve', mission({ approvals: [bob] }), of_alice), null);
  assert.equal(words.whyNot('approve', mission({ approvals: [alice] }), of_alice), 'you have approved it');
  assert.equal(words.whyNot('start', mission({ approvals: [alice] }), of_alice), 'it lacks approvals');
  assert.equal(words.whyNot('start', mission({ approvals: [alice, bob], phase: 'approved' }), of_alice), null);
});

test('a finding forbids the start or warns, by sign and word', () => {
  const near = { drone: 'tello1', waypoint: 0, words: 'drone tello1, waypoint 1: too near', forbids: true };
  const fence = { drone: '', waypoint: null, words: 'no fence', forbids: false };
  assert.deepEqual(words.findingWords(near), ['■ Forbids the start', 'drone tello1, waypoint 1: too near']);
  assert.deepEqual(words.findingWords(fence), ['▲ Warning', 'no fence']);
  assert.ok(words.isForbidden(mission({ findings: [fence, near] })));
  assert.ok(!words.isForbidden(mission({ findings: [fence] })));
  assert.equal(words.phaseWords(mission({ findings: [near] })), 'May not start');
  assert.equal(words.phaseWords(mission({ findings: [fence] })), 'Checked');
  assert.match(words.whyNot('approve', mission({ findings: [near] }), of_alice), /forbids the start.*add it again/);
  assert.equal(words.whyNot('approve', mission({ findings: [fence] }), of_alice), null);
  const approved = mission({ approvals: [alice, bob], phase: 'approved', findings: [near] });
  assert.equal(words.whyNot('start', approved, of_alice), null, 'the drones may stand elsewhere by now: it is checked again');
});

test('what is flown can be paused and landed, and not removed', () => {
  for (const phase of ['taking_off', 'to_start', 'flying']) {
    const flown = mission({ phase });
    assert.equal(words.whyNot('pause', flown, of_alice), null);
    assert.equal(words.whyNot('land', flown, signed_out), null, 'to land needs no operator');
    assert.equal(words.whyNot('pause', flown, signed_out), rules.SIGN_IN);
    assert.match(words.whyNot('remove', flown, of_alice), /land it first/);
  }
  for (const phase of ['checked', 'approved', 'done', 'aborted']) {
    assert.notEqual(words.whyNot('land', mission({ phase }), of_alice), null);
    assert.equal(words.whyNot('remove', mission({ phase }), of_alice), null);
  }
  assert.match(words.whyNot('start', mission({ phase: 'done' }), of_alice), /remove it, then add it again/);
  assert.equal(words.phaseWords(mission({ phase: 'to_start', paused: true })), 'Paused');
});

test('kept paths become one mission, and a file gives it its name', () => {
  const kept = [{ drone: 'tello1', waypoints: [{ x: 1, y: 0 }], then: 'land' }, { drone: 'tello2', waypoints: [{ x: 1, y: 2, z: 1.2 }], then: 'hover' }];
  assert.deepEqual(words.missionOf('both', kept, null), { name: 'both', drones: kept });
  assert.deepEqual(words.missionOf('both', kept, { tello1: [0.004, 0, 0], tello2: [0, 2.126, 1] }).drones.map((each) => each.start), [{ x: 0, y: 0 }, { x: 0, y: 2.13 }]);
  assert.equal(words.nameOfFile('Survey 2.north.csv'), 'Survey_2_north');
  assert.equal(words.typeOf({ name: 'a.CSV', type: '' }), 'text/csv');
  assert.equal(words.typeOf({ name: 'a.json', type: '' }), 'application/json');
  assert.equal(words.typeOf({ name: 'notes.txt', type: 'text/plain' }), null);
  assert.equal(words.nameOfFile('ü.csv'), '_');
  assert.equal(words.nameOfFile('.csv'), 'mission');
});
