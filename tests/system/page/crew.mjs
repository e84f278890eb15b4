// Two operators at two browsers, as they would: each signs in, one flies by hand, hands over to the other, stops all; both clear. And a
// mission of two drones, drawn, approved, and flown.
//
// Usage: node crew.mjs URL OUTDIR ALICES_PASS_PHRASE BOBS_PASS_PHRASE [--no-mission]
//   URL      of the page, with #token=...; its station flies tello1 and tello2 by hand, for the operators alice and bob; both stand
// Prints one JSON object. Exit code: as drive.mjs.
import { join } from 'node:path';
import { fly_mission } from './mission.mjs';
import { calm, cardOf, launch, SIZES, Watcher } from './watcher.mjs';

const LEDGER_MS = 20000;
const FLIGHT_MS = 60000;
const HELD_MS = 10000;

const [url, outdir, of_alice, of_bob, flag] = process.argv.slice(2);
if (!of_bob || (flag && flag !== '--no-mission')) {
  console.error('usage: node crew.mjs URL OUTDIR ALICES_PASS_PHRASE BOBS_PASS_PHRASE [--no-mission]');
  process.exit(2);
}
const watcher = new Watcher(outdir, { signed_in: [], refused: [], flown_m: {}, sent_in_vain: 0, stop: [], events: [] });
const { saw } = watcher;
const check = (good, words) => watcher.check(good, words);
const meant = /status of 40[0139]/; // what is refused on purpose: a file, a session that is over, a wrong pass phrase, a start

async function open(browser, size, more = {}) {
  const context = await browser.newContext({ viewport: SIZES[size], ...more });
  const page = await context.newPage();
  const velocities = [];
  watcher.watch(page, { velocities, meant });
  await page.goto(url);
  await page.waitForSelector('.card');
  await page.locator('#sign').waitFor();
  return { page, velocities, drone: (name) => cardOf(page, name) };
}

/// Open only as long as it is looked at: each page that is drawn takes the time of the flight beside it.
async function onPhone(browser, look) {
  const phone = await open(browser, 'phone', { hasTouch: true, isMobile: true, deviceScaleFactor: 2 });
  await look(phone);
  await phone.page.context().close();
}

const field = (drone, name, words) => drone.card.locator(`[data-field=${name}]`, { hasText: words }).waitFor({ timeout: LEDGER_MS });

/// By the keyboard alone. A page that was just opened shows what one may do when it has heard of its drones: hidden, it takes no keys.
async function press(drone, action) {
  const button = drone.card.locator(`[data-action=${action}]`).first();
  await button.waitFor({ timeout: LEDGER_MS });
  await button.focus();
  await drone.card.page().keyboard.press('Enter');
}

async function signed_out(alice) {
  const drone = alice.drone('tello1');
  for (const action of ['takeoff', 'acquire']) {
    await press(drone, action);
    await field(drone, 'reply', 'Sign in first');
  }
  await alice.page.locator('#fly-words', { hasText: 'Sign in first' }).waitFor();
  await watcher.pictures(alice.page, 'desktop', 'signed-out');
}

async function sign_in({ page }, name, phrase) {
  await page.locator('#sign').focus();
  await page.keyboard.press('Enter');
  const inside = () => page.evaluate(() => document.activeElement === document.body || document.querySelector('#sign-dialog').contains(document.activeElement));
  for (let i = 0; i < 9; ++i) {
    check(await inside(), 'the keyboard leaves the dialog');
    await page.keyboard.press('Tab');
  }
  await page.locator('#sign-name').focus();
  await page.keyboard.press(name[0]);
  await page.keyboard.press('Tab');
  await page.keyboard.type('not this one');
  await page.keyboard.press('Enter');
  await page.locator('#sign-refused', { hasText: 'Not signed in' }).waitFor({ timeout: LEDGER_MS });
  saw.refused.push(await page.locator('#sign-refused').textContent());
  if (name === 'alice') await watcher.pictures(page, 'desktop', 'sign-in');
  await page.keyboard.type(phrase); // the wrong one is selected
  await page.keyboard.press('Enter');
  await page.locator('#who', { hasText: `Signed in: ${name}` }).waitFor({ timeout: LEDGER_MS });
  check(await page.locator('#sign-dialog').isHidden(), 'the dialog stays');
  check(await page.evaluate(() => sessionStorage.getItem('token') !== null && JSON.parse(sessionStorage.getItem('session')).token !== sessionStorage.getItem('token')),
    "the page's own token is not kept beside the session's");
  saw.signed_in.push(name);
}

async function take_off(pilot, name) {
  await press(pilot.drone(name), 'takeoff');
  await pilot.drone(name).phase('By hand', FLIGHT_MS);
}

/// How far the drone came while the key was held: until it has moved, or for long.
async function fly(pilot, name) {
  const drone = pilot.drone(name);
  await drone.card.locator('.select').click();
  await calm(pilot.page);
  const before = await drone.place();
  const flown = async () => {
    const now = await drone.place();
    return Number(Math.hypot(now[0] - before[0], now[1] - before[1]).toFixed(2));
  };
  await pilot.page.keyboard.down('w');
  for (const end = Date.now() + HELD_MS; Date.now() < end && (await flown()) < 0.3; ) await pilot.page.waitForTimeout(100);
  await pilot.page.keyboard.up('w');
  return flown();
}

async function cannot_fly(pilot, name, words) {
  await pilot.drone(name).card.locator('.select').click();
  await pilot.page.locator('#fly-words', { hasText: words }).waitFor({ timeout: LEDGER_MS });
  const count = pilot.velocities.length;
  await pilot.page.keyboard.down('w');
  await pilot.page.waitForTimeout(600);
  await pilot.page.keyboard.up('w');
  saw.sent_in_vain += pilot.velocities.length - count;
  check(pilot.velocities.length === count, `keys are sent that fly nothing (${words})`);
}

async function hand_over(alice, bob, browser) {
  await cannot_fly(bob, 'tello1', 'tello1 is held by alice: ask for it.');
  await press(bob.drone('tello1'), 'request');
  const requests = alice.drone('tello1').card.locator('.requests');
  await requests.locator('li', { hasText: 'bob asks for it' }).waitFor({ timeout: LEDGER_MS });
  await watcher.pictures(alice.page, 'desktop', 'request');
  await onPhone(browser, async (phone) => {
    await phone.drone('tello1').card.locator('.requests').waitFor({ timeout: LEDGER_MS });
    await phone.drone('tello1').card.scrollIntoViewIfNeeded();
    await watcher.pictures(phone.page, 'phone', 'request');
  });
  await press(alice.drone('tello1'), 'hand_over');
  await field(bob.drone('tello1'), 'lease', 'yours (bob)');
  await field(alice.drone('tello1'), 'lease', 'held by bob');
  await requests.waitFor({ state: 'hidden', timeout: LEDGER_MS });
  await cannot_fly(alice, 'tello1', 'tello1 is held by bob: ask for it.');
  saw.flown_m.bob = await fly(bob, 'tello1');
  check(saw.flown_m.bob > 0.2, "bob's keys do not move what he holds");
}

async function stop_all(alice, bob) {
  await press(bob.drone('tello1'), 'stop'); // two stop it: each clears his own
  await alice.page.locator('#sign').click();
  await alice.page.locator('#confirm-no:focus').waitFor();
  await alice.page.keyboard.press('Backspace'); // in a dialog, too
  check(await alice.page.locator('#confirm').isHidden(), 'a dialog covers the stop');
  for (const name of ['tello1', 'tello2']) {
    const row = alice.page.locator('#stop-list li', { has: alice.page.locator('strong', { hasText: new RegExp(`^${name}$`) }) });
    await row.locator('.done', { hasText: 'on ledger' }).waitFor({ timeout: LEDGER_MS });
    await row.locator('.done', { hasText: 'on ground' }).waitFor({ timeout: FLIGHT_MS });
    await field(alice.drone(name), 'stopped', 'alice');
  }
  await field(alice.drone('tello1'), 'stopped', 'bob');
  saw.stop = await alice.page.locator('#stop-list li').evaluateAll((rows) => rows.map((each) => [...each.children].map((part) => part.textContent).join(' ')));
  check(/on ledger: alice, bob/.test(saw.stop[0]), 'nothing says who has stopped');
  await watcher.pictures(alice.page, 'desktop', 'stopped');
  for (const name of ['tello1', 'tello2']) await press(alice.drone(name), 'clear_stop');
  await press(bob.drone('tello1'), 'clear_stop');
  for (const name of ['tello1', 'tello2']) await alice.drone(name).card.locator('[data-field=stopped]').waitFor({ state: 'hidden', timeout: LEDGER_MS });
}

/// A session that another one has ended: said aloud, and the page looks on with its own token.
async function over(browser, alice) {
  const other = await open(browser, 'desktop');
  await sign_in(other, 'alice', of_alice);
  await alice.page.locator('#sign-words', { hasText: 'The session of alice is over' }).waitFor({ timeout: LEDGER_MS });
  await alice.page.locator('#link-words', { hasText: /^Connected$/ }).waitFor({ timeout: LEDGER_MS });
  await press(other.drone('tello2'), 'release');
  await field(other.drone('tello2'), 'lease', 'nobody holds it');
  await press(other.drone('tello2'), 'acquire');
  await field(other.drone('tello2'), 'lease', 'yours (alice)');
  await other.page.locator('#sign').click();
  await other.page.locator('#confirm-words', { hasText: 'tello2' }).waitFor();
  await other.page.locator('#confirm-yes').click();
  await other.page.locator('#sign-words', { hasText: 'alice is signed out.' }).waitFor({ timeout: LEDGER_MS });
  await other.page.locator('#who', { hasText: 'Nobody signed in' }).waitFor();
  await field(other.drone('tello2'), 'lease', 'nobody holds it');
}

/// In the air it is asked; Esc is no.
async function keep({ page, drone }, name) {
  await press(drone(name), 'release');
  await page.locator('#confirm-words', { hasText: 'lands by its failsafe' }).waitFor();
  await watcher.pictures(page, 'desktop', 'give-back');
  await page.keyboard.press('Escape');
  await page.waitForTimeout(500);
  await field(drone(name), 'lease', 'yours');
}

async function main() {
  const browser = await launch();
  const alice = await open(browser, 'desktop');
  let bob = null;
  try {
    await onPhone(browser, ({ page }) => watcher.pictures(page, 'phone', 'signed-out'));
    await signed_out(alice);
    await sign_in(alice, 'alice', of_alice);
    for (const name of ['tello1', 'tello2']) {
      await press(alice.drone(name), 'acquire');
      await field(alice.drone(name), 'lease', 'yours (alice)');
      check((await alice.page.evaluate(() => document.activeElement.className)) === 'select', 'a button that goes takes the keyboard with it');
    }
    await watcher.pictures(alice.page, 'desktop', 'signed-in');
    await alice.page.reload(); // the tab keeps the session
    await alice.page.locator('#who', { hasText: 'Signed in: alice' }).waitFor({ timeout: LEDGER_MS });
    await field(alice.drone('tello1'), 'lease', 'yours (alice)');
    if (!flag) await fly_mission(alice, (look) => onPhone(browser, look), watcher);
    await take_off(alice, 'tello1');
    saw.flown_m.alice = await fly(alice, 'tello1');
    check(saw.flown_m.alice > 0.2, "alice's keys do not move what she holds");
    await keep(alice, 'tello1');
    bob = await open(browser, 'desktop');
    await sign_in(bob, 'bob', of_bob);
    await hand_over(alice, bob, browser);
    await stop_all(alice, bob);
    await over(browser, alice);
  } catch (error) {
    saw.wrong.push(String(error.message).split('\n')[0] + (error.stack.match(/crew\.mjs:\d+|mission\.mjs:\d+/g) ?? []).slice(0, 3).map((each) => ` ${each}`).join(''));
    for (const [who, at] of Object.entries({ alice, bob })) await at?.page.screenshot({ path: join(outdir, `wrong-${who}.png`) });
  }
  saw.events = await alice.page.locator('#events-list .event span').evaluateAll((all) => all.slice(0, 150).map((each) => each.textContent).reverse());
  await browser.close();
  check(saw.console_errors.length === 0, 'the console has errors');
  console.log(JSON.stringify(saw, null, 1));
  process.exit(saw.wrong.length ? 1 : 0);
}

await main();
