// The page's arithmetic, which needs no browser: node --test look.test.mjs
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

// The page's files are modules for browsers: nothing beside them says so to Node.js.
const load = (name) => import(`data:text/javascript,${encodeURIComponent(readFileSync(join(import.meta.dirname, '../../../../ground/page/look', name), 'utf8'))}`);
const { BatteryTime, timeLeft } = await load('battery.js');
const { Latency, bucketFrom, bucketOf, BUCKETS, quantile, shares, SPAN_S } = await load('latency.js');

/// A battery that loses `a_minute` percent from `from` on, as the station says it: in whole percent, 30 times a second.
function drained(minutes, a_minute, from = 100, battery = new BatteryTime(), start_ms = 0) {
  for (let ms = 0; ms <= minutes * 60000; ms += 33) battery.add(start_ms + ms, Math.round(from - (a_minute * ms) / 60000));
  return battery;
}

test('a battery that falls steadily lasts as long as it falls', () => {
  const left = drained(4, 6).left_s(); // 76 % are left, at 6 % a minute
  assert.ok(Math.abs(left - (76 / 6) * 60) < 25, `${left} s`);
  assert.equal(timeLeft(left).words, 'about 12 min');
});

test('nobody can tell before two minutes and three percent', () => {
  assert.equal(new BatteryTime().left_s(), null);
  assert.equal(drained(1.9, 10).left_s(), null);
  assert.equal(drained(4, 0.4).left_s(), null);
  assert.equal(timeLeft(null).words, 'not known yet');
});

test('only the last five minutes count, and a new battery starts again', () => {
  const battery = drained(10, 1);
  drained(5.1, 8, 90, battery, 600000); // it works harder now
  const left = battery.left_s();
  assert.ok(Math.abs(left - (49.2 / 8) * 60) < 40, `${left} s`);
  battery.add(910000, 100);
  assert.equal(battery.left_s(), null);
});

test('one that is not known, or rises, is no time', () => {
  const battery = new BatteryTime();
  for (let ms = 0; ms < 300000; ms += 2000) battery.add(ms, null);
  assert.equal(battery.left_s(), null);
  const charged = new BatteryTime();
  for (let ms = 0; ms < 300000; ms += 2000) charged.add(ms, 20 + ms / 20000);
  assert.equal(charged.left_s(), null);
});

test('on the ground there is no time left, and the next flight is counted on its own', () => {
  const battery = drained(4, 6);
  battery.add(241000, 76, false);
  assert.equal(battery.left_s(), null);
  for (let ms = 243000; ms < 600000; ms += 2000) battery.add(ms, 76 - ms / 60000, false);
  assert.equal(battery.left_s(), null);
  assert.notEqual(drained(4, 6, 70, battery, 600000).left_s(), null);
});

test('little time is shown as little, by text and not by colour alone', () => {
  assert.deepEqual(timeLeft(59), { words: 'less than a minute', level: 'bad' });
  assert.deepEqual(timeLeft(119), { words: 'about 1 min', level: 'bad' });
  assert.deepEqual(timeLeft(200), { words: 'about 3 min', level: 'warn' });
});

test('every delay has its bucket, and each begins where the one before ends', () => {
  assert.equal(bucketOf(0), 0);
  assert.equal(bucketOf(9.9), 0);
  assert.equal(bucketOf(10), 1);
  assert.equal(bucketOf(1e9), BUCKETS - 1);
  for (let i = 1; i < BUCKETS; ++i) {
    assert.equal(bucketOf(bucketFrom(i)), i);
    assert.equal(bucketOf(bucketFrom(i) - 0.001), i - 1);
  }
});

test('quantiles are values that came', () => {
  const values = Array.from({ length: 100 }, (_, i) => i + 1);
  assert.equal(quantile(values, 0.5), 50);
  assert.equal(quantile(values, 0.99), 99);
  assert.equal(quantile([7], 0.99), 7);
});

test('shares of a bucket sum to one', () => {
  const all = shares([5, 15, 15, 150]);
  assert.equal(all[0], 0.25);
  assert.ok(Math.abs(all.reduce((sum, each) => sum + each) - 1) < 1e-9);
});

test('old seconds go, a flood is bounded, and each kind is its own', () => {
  const latency = new Latency();
  for (let s = 0; s < 500; ++s) latency.add(s * 1000, { delay: [s], state: Array(5000).fill(20) });
  assert.equal(latency.columns('delay', 499000).length, SPAN_S);
  assert.equal(latency.columns('delay', 499000).at(-1).ago_s, 0);
  assert.deepEqual(latency.sorted('delay', 499000, 2), [498, 499]);
  assert.equal(latency.sorted('state', 499000, 1).length, 600);
  assert.deepEqual(latency.sorted('command', 499000, 60), []);
});
