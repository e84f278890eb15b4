// A mission of two drones at the page: one that is forbidden, from a file; one that is drawn, approved, flown, paused, resumed, to its end.
import { calm } from './watcher.mjs';

const LEDGER_MS = 20000;
const FLIGHT_MS = 120000;
const HEADING = 'drone,x,y,z,speed';
const NEAR = [HEADING, 'tello1,1,0,1.2,', 'tello2,1,0.1,1.2,', ''].join('\n'); // both to one place

const entryOf = (page, name) => page.locator('.mission', { has: page.locator('h3', { hasText: new RegExp(`^${name}$`) }) });
const phase = (entry, words, timeout = LEDGER_MS) => entry.locator('.phase', { hasText: words }).waitFor({ timeout });

async function press(entry, action) {
  await entry.locator(`[data-action=${action}]`).focus();
  await entry.page().keyboard.press('Enter');
}

async function approve(entry) {
  await press(entry, 'approve');
  await entry.locator('[data-field=approvals]', { hasText: '1 of 1 approved: alice' }).waitFor({ timeout: LEDGER_MS });
  await phase(entry, 'Approved');
}

async function start(entry) {
  await press(entry, 'start');
  await entry.page().locator('#confirm-yes').focus();
  await entry.page().keyboard.press('Enter');
}

async function drop_nonsense(page, watcher) {
  const file = await page.evaluateHandle((text) => {
    const data = new DataTransfer();
    data.items.add(new File([text], 'bad.csv', { type: 'text/csv' }));
    return data;
  }, `${HEADING}\ntello1,nan,0,,\n`);
  await page.dispatchEvent('#map', 'drop', { dataTransfer: file });
  await page.locator('#missions-words', { hasText: 'bad.csv is not taken: line 2: x "nan"' }).waitFor({ timeout: LEDGER_MS });
  watcher.saw.not_taken = await page.locator('#missions-words').textContent();
}

async function load_forbidden(page, watcher) {
  await page.locator('#mission-file').setInputFiles({ name: 'too near.csv', mimeType: 'text/csv', buffer: Buffer.from(NEAR) });
  const entry = entryOf(page, 'too_near');
  await entry.locator('.findings li', { hasText: '■ Forbids the start' }).first().waitFor({ timeout: LEDGER_MS });
  watcher.saw.findings = await entry.locator('.findings li').allTextContents();
  await press(entry, 'start');
  await entry.locator('.reply', { hasText: 'it lacks approvals' }).waitFor();
  await phase(entry, 'May not start');
  await press(entry, 'approve');
  await entry.locator('.reply', { hasText: /^Approve: its check forbids the start/ }).waitFor();
}

/// A path of two waypoints ahead of a drone, by the cross that arrow keys move.
async function draw(page, number) {
  await page.keyboard.press(`${number}`);
  if ((await page.locator('#draw').getAttribute('aria-pressed')) === 'false') {
    await page.locator('#draw').focus();
    await page.keyboard.press('Enter');
  }
  await page.locator('#map').focus();
  for (const keys of [4, 12]) {
    for (let i = 0; i < keys; ++i) await page.keyboard.press('ArrowUp');
    await page.keyboard.press('Space');
  }
  await page.locator('#draft-then').selectOption('land');
  await page.locator('#draft-speed').fill('0.2'); // slow: there is time to pause it
  await page.locator('#draft-keep').focus();
  await page.keyboard.press('Enter');
  await page.locator('#mission-kept li', { hasText: `tello${number}: 2 waypoints, then land` }).waitFor();
}

export async function fly_mission(alice, onPhone, watcher) {
  const { page } = alice;
  const { saw } = watcher;
  await drop_nonsense(page, watcher); // opens the panel
  await page.locator('#map').focus();
  for (const hidden of [true, false]) {
    await page.keyboard.press('m');
    watcher.check((await page.locator('#missions').isHidden()) === hidden, 'M does not open and close the missions');
  }
  await load_forbidden(page, watcher);
  for (const number of [1, 2]) await draw(page, number);
  await page.locator('#mission-name').focus();
  await page.keyboard.type('both');
  await page.keyboard.press('Enter');
  const entry = entryOf(page, 'both');
  await phase(entry, 'Checked');
  await page.waitForTimeout(1000);
  await watcher.pictures(page, 'desktop', 'missions');
  await onPhone(async (phone) => {
    await phone.page.locator('#missions-on').tap();
    await entryOf(phone.page, 'both').waitFor({ timeout: LEDGER_MS });
    await phone.page.locator('#missions').scrollIntoViewIfNeeded();
    await watcher.pictures(phone.page, 'phone', 'missions');
  });
  await approve(entry);
  await calm(page);
  await start(entry);
  await phase(entry, 'Flying', FLIGHT_MS);
  await press(entry, 'pause');
  await phase(entry, 'Paused');
  for (const name of ['tello1', 'tello2']) await alice.drone(name).phase('Paused', LEDGER_MS);
  await calm(page);
  await press(entry, 'pause');
  await phase(entry, 'Flying', LEDGER_MS);
  await phase(entry, 'Done', FLIGHT_MS);
  saw.mission = { approvals: await entry.locator('[data-field=approvals]').textContent(), drones: await entry.locator('[data-field=drones]').textContent() };
  for (const name of ['tello1', 'tello2']) await alice.drone(name).phase('Landed', FLIGHT_MS);
  await press(entry, 'remove');
  await entry.waitFor({ state: 'detached', timeout: LEDGER_MS });
}
