// Flies one drone through the ground station's page in a real browser, as a person would, and says what it saw.
//
// Usage: node drive.mjs URL OUTDIR [--drone NAME]
//   URL      of the page, with #token=...; its station flies a manual flight, the drone stands on the ground
//   OUTDIR   gets screenshots, and the file kill-ground when ground is to be killed, and started again at its port
// Prints one JSON object. Exit code: 0 all went well; 1 not (`wrong` says what); 2 usage, or no browser.
// LEDGERLINE_PAGE_NPM: where playwright-core and axe-core are installed, else build/npm-page; LEDGERLINE_CHROMIUM: the browser.
import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { cardOf, launch, SIZES, Watcher } from './watcher.mjs';
import { openSpace, pictureDelays, readBlocks, switchFaults, turnSpace, withoutLibraries } from './look.mjs';

const TAKEOFF_MS = 45000;
const PATH_MS = 60000;
const LANDED_MS = 30000;
const BACK_MS = 60000;

const [url, outdir, flag, named] = process.argv.slice(2);
if (!url || !outdir || (flag && (flag !== '--drone' || !named))) {
  console.error('usage: node drive.mjs URL OUTDIR [--drone NAME]');
  process.exit(2);
}
const watcher = new Watcher(outdir, { requests: 0, bytes: 0, phases: [], velocities_sent: 0, by_finger: 0, flown_m: 0, zeros_after_release: 0,
  waypoints_sent: 0, stop: [], alarms: [] });
const { saw, velocities } = watcher;
const check = (good, words) => watcher.check(good, words);
// While ground is away: by when its end comes, on the way to a request, in it, or before.
const watch = (page) => watcher.watch(page, { meant: /ERR_(CONNECTION_(REFUSED|RESET|CLOSED)|SOCKET_NOT_CONNECTED|EMPTY_RESPONSE)/ });
const pictures = (page, size, moment) => watcher.pictures(page, size, moment, ['flight', 'space', 'faults'].includes(moment));

async function countLoad(page) {
  const loads = [];
  const take = (request) => loads.push(request);
  page.on('requestfinished', take);
  await page.goto(url);
  await page.waitForSelector('.card', { timeout: 20000 });
  page.off('requestfinished', take);
  const files = loads.filter((request) => !request.url().includes('/api/') && !request.url().startsWith('data:'));
  const sizes = await Promise.all(files.map((request) => request.sizes()));
  saw.requests = files.length;
  saw.bytes = sizes.reduce((sum, size) => sum + size.responseBodySize + size.responseHeadersSize, 0);
  check(!page.url().includes('token'), 'the token stays in the address bar');
}

/// The plan, while it shows what is sent to that drone; soon, since nothing is shown while a busy host's drone brakes.
const committed = (page, name) => page.locator(`#map[data-committed~='${name}']`);
const isDrawn = (page, name) => committed(page, name).waitFor({ timeout: 1500 }).then(() => true, () => false);

async function takeOff(page, drone, name) {
  check((await committed(page, name).count()) === 0, 'something is drawn as sent to a drone on the ground');
  await drone.card.locator('.select').focus();
  await page.keyboard.press('Tab'); // from its name to its buttons, as the list of keys says
  for (let i = 0; i < 5 && !(await drone.card.locator('[data-action=takeoff]:focus').count()); ++i) await page.keyboard.press('Tab');
  await page.keyboard.press('Enter');
  await drone.phase('By hand', TAKEOFF_MS);
}

async function flyByKeys(page, drone, name) {
  const before = await drone.place();
  await page.keyboard.down('w');
  await page.waitForTimeout(1500);
  check(await isDrawn(page, name), 'what is sent by hand is not drawn');
  await page.keyboard.down('ArrowUp');
  await page.waitForTimeout(500);
  await page.keyboard.up('ArrowUp');
  await page.keyboard.up('w');
  await page.waitForTimeout(1500);
  const after = await drone.place();
  saw.velocities_sent = velocities.length;
  saw.flown_m = Number(Math.hypot(after[0] - before[0], after[1] - before[1]).toFixed(2));
  const moving = velocities.findLastIndex((each) => each.linear.some((part) => part !== 0) || each.yaw_rate !== 0);
  saw.zeros_after_release = velocities.length - 1 - moving;
  check(saw.flown_m > 0.2, 'held keys do not move the drone');
  check(saw.velocities_sent >= 20 && saw.velocities_sent <= 60, 'velocities are not sent some 15 times a second');
  check(saw.zeros_after_release === 1, 'zero is not sent once when the keys are let go');
  await page.keyboard.down('d');
  await page.waitForTimeout(200);
  await page.evaluate(() => dispatchEvent(new Event('blur')));
  const count = velocities.length;
  await page.waitForTimeout(400);
  check(velocities.length === count || velocities.slice(count).every((each) => each.linear.every((part) => part === 0)), 'a window that lost the focus flies on');
  await page.keyboard.up('d');
}

async function flyPath(page, drone, name) {
  await page.locator('#draw').click();
  const box = await page.locator('#map').boundingBox();
  for (const [x, y] of [[0.56, 0.42], [0.62, 0.55]]) await page.mouse.click(box.x + box.width * x, box.y + box.height * y);
  await page.screenshot({ path: join(outdir, 'draft-desktop.png') });
  const sent = page.waitForRequest((request) => request.url().endsWith('/path'));
  await page.locator('#map').focus();
  await page.keyboard.press('Enter');
  saw.waypoints_sent = (await sent).postDataJSON().waypoints.length;
  check(saw.waypoints_sent === 2, 'two clicks are not two waypoints');
  await drone.phase('On its path', 10000);
  await page.waitForTimeout(700);
  check(await isDrawn(page, name), 'what is sent on a path is not drawn');
  await pictures(page, 'desktop', 'flight');
  await drone.phase('By hand', PATH_MS);
}

/// From so far that the fence is seen.
async function lookFromAfar(page, view) {
  for (let i = 0; i < 12; ++i) await page.locator('#zoom-out').click();
  await page.waitForTimeout(400);
  await page.screenshot({ path: join(outdir, `fence-${view}-light.png`) });
  await page.locator('#zoom-fit').click();
}

async function look(page) {
  await page.emulateMedia({ colorScheme: 'light' });
  await lookFromAfar(page, 'plan');
  await page.keyboard.press('v');
  await lookFromAfar(page, 'space');
  await turnSpace(page, () => velocities.length, check);
  await pictureDelays(page, saw, check);
  await readBlocks(page, saw, check);
  await pictures(page, 'desktop', 'space');
}

async function flyByFinger(context, page) {
  const box = await page.locator('#pad-right').boundingBox();
  const finger = await context.newCDPSession(page);
  const touch = (type, touchPoints) => finger.send('Input.dispatchTouchEvent', { type, touchPoints });
  const count = velocities.length;
  await touch('touchStart', [{ x: box.x + box.width / 2, y: box.y + 10 }]);
  await page.waitForTimeout(600);
  await touch('touchEnd', []);
  await page.waitForTimeout(400);
  const sent = velocities.slice(count).map((each) => each.linear[0]);
  saw.by_finger = sent.length;
  check(sent.length >= 5 && sent.slice(0, -1).every((ahead) => ahead > 0) && sent.at(-1) === 0, 'a finger on the pad does not fly ahead and stop');
}

async function onPhone(browser, name) {
  const context = await browser.newContext({ viewport: SIZES.phone, hasTouch: true, isMobile: true, deviceScaleFactor: 2 });
  const page = await context.newPage();
  watch(page);
  await page.goto(new URL('/', url).href); // without the token
  check((await page.locator('#token-words').textContent()).includes('token_file'), 'the page does not say where its token is');
  await page.goto('about:blank');
  await page.goto(url);
  await page.waitForSelector('.card');
  await page.waitForTimeout(600);
  await page.touchscreen.tap(60, 20);
  await page.waitForTimeout(200);
  check(await page.locator('#pads').isVisible(), 'fingers have no pads');
  await pictures(page, 'phone', 'flight');
  await page.locator('#space').tap();
  await page.locator('#scene[data-pictures]').waitFor({ timeout: 20000 });
  await page.locator('#scene').scrollIntoViewIfNeeded();
  await pictures(page, 'phone', 'space');
  await page.locator('#space').tap();
  await cardOf(page, name).card.locator('.select').tap();
  await page.locator('#fly').scrollIntoViewIfNeeded();
  await flyByFinger(context, page);
  await page.screenshot({ path: join(outdir, 'pads-phone-dark.png') });
  await page.locator('.card').last().scrollIntoViewIfNeeded();
  await page.screenshot({ path: join(outdir, 'cards-phone-dark.png') });
  await page.setViewportSize({ width: 360, height: 740 });
  check(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'the page is wider than 360 px');
  await context.close();
}

/// Ground is killed while the drone is in the air: the page says so, and that it is back.
async function loseGround(page, drone) {
  await page.evaluate(() => {
    globalThis.linkWords = new Set();
    setInterval(() => linkWords.add(document.querySelector('#link-words').textContent), 20);
  });
  writeFileSync(join(outdir, 'kill-ground'), '');
  await page.locator('#link-back', { hasText: 'Ground was away for' }).waitFor({ timeout: BACK_MS });
  saw.away = await page.locator('#link-back').textContent();
  const words = await page.evaluate(() => [...linkWords]);
  check(words.some((each) => each.startsWith('Connection lost')), 'nothing says that the connection is lost');
  await page.locator("#link[data-level='fresh']").waitFor({ timeout: BACK_MS });
  await drone.card.locator("[data-field=state][data-level='fresh']").waitFor({ timeout: BACK_MS });
  await page.locator('#events-list .event', { hasText: saw.away }).waitFor({ timeout: BACK_MS });
  await page.screenshot({ path: join(outdir, 'back-desktop.png') });
}

async function stopAll(page, name) {
  await page.keyboard.press('Backspace');
  const row = page.locator('#stop-list li', { has: page.locator('strong', { hasText: new RegExp(`^${name}$`) }) });
  await row.locator('.done', { hasText: 'on ledger' }).waitFor({ timeout: LANDED_MS });
  await pictures(page, 'desktop', 'stop');
  await row.locator('.done', { hasText: 'on ground' }).waitFor({ timeout: LANDED_MS });
  saw.stop = await page.locator('#stop-list li').evaluateAll((rows) => rows.map((each) => [...each.children].map((part) => part.textContent).join(' ')));
  saw.alarms = [await page.locator('#alarm-words').textContent()];
  if (await page.locator('#acknowledge').isVisible()) {
    await page.locator('#acknowledge').click();
    check(/^■ \d+ alarms? so far/.test(saw.alarms[0]), 'alarms that may be over read as those of now');
    saw.alarms.push(await page.locator('#alarm-words').textContent());
    check(saw.alarms[1] === 'No alarm', 'an acknowledged alarm stays');
  }
  const { card } = cardOf(page, name);
  check(await card.locator('[data-field=why]').isVisible(), 'the card does not say that it was stopped');
  await page.locator('#stop-words', { hasText: 'All are on the ground. Clear the stops' }).waitFor({ timeout: LANDED_MS });
  check(await page.locator('#stop-panel').evaluate((panel) => panel.scrollHeight <= panel.clientHeight + 1), 'the stop panel is cut off');
  await page.locator('#stop-clear').click();
  await page.locator('#stop-panel').waitFor({ state: 'hidden', timeout: LANDED_MS });
  await card.locator('[data-field=why]').waitFor({ state: 'hidden', timeout: LANDED_MS });
}

async function main() {
  const browser = await launch();
  const page = await browser.newPage({ viewport: SIZES.desktop });
  watch(page);
  try {
    await countLoad(page);
    const name = named ?? (await page.locator('.card .name').first().textContent());
    const drone = cardOf(page, name);
    await drone.card.locator('.select').click();
    await page.evaluate(() => {
      globalThis.phases = new Set();
      setInterval(() => phases.add(document.querySelector('.card.selected .phase').textContent), 50);
    });
    await openSpace(page, saw, check);
    await page.keyboard.press('v');
    await switchFaults(page, saw, check, () => pictures(page, 'desktop', 'faults'));
    await takeOff(page, drone, name);
    await flyByKeys(page, drone, name);
    await flyPath(page, drone, name);
    await look(page);
    await withoutLibraries(browser, url, watch, check);
    await onPhone(browser, name);
    await loseGround(page, drone);
    await stopAll(page, name);
  } catch (error) {
    saw.wrong.push(String(error.message).split('\n')[0]);
    await page.screenshot({ path: join(outdir, 'wrong.png') });
  }
  saw.phases = await page.evaluate(() => [...(globalThis.phases ?? [])]);
  await browser.close();
  check(saw.console_errors.length === 0, 'the console has errors');
  console.log(JSON.stringify(saw, null, 1));
  process.exit(saw.wrong.length ? 1 : 0);
}

await main();
