// What drive.mjs looks at beside flying: the view in three dimensions, the delays' pictures, the ledger's blocks, and the page as it is
// built without its libraries. Each takes what it found to `saw`, and what is not right to `check(good, words)`.
const MAX_IDLE_PICTURES = 3; // a second, of drones that stand still

const picturesOf = async (page) => Number(await page.locator('#scene').getAttribute('data-pictures'));

/// How many colours a part of the page shows, by a screenshot of it.
async function coloursOf(page, selector) {
  const shot = (await page.locator(selector).screenshot()).toString('base64');
  return page.evaluate(async (base64) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(base64), (each) => each.charCodeAt(0))], { type: 'image/png' }));
    const canvas = new OffscreenCanvas(image.width, image.height);
    const ctx = canvas.getContext('2d');
    ctx.drawImage(image, 0, 0);
    return new Set(new Uint32Array(ctx.getImageData(0, 0, image.width, image.height).data.buffer)).size;
  }, shot);
}

/// By key and by mouse; on the ground, so that nothing moves. Loads what the view needs, once.
export async function openSpace(page, saw, check) {
  const loads = [];
  const take = (request) => loads.push(request);
  page.on('requestfinished', take);
  await page.keyboard.press('v');
  await page.locator('#scene[data-pictures]').waitFor({ timeout: 20000 });
  page.off('requestfinished', take);
  const files = loads.filter((request) => request.url().includes('/page/'));
  const sizes = await Promise.all(files.map((request) => request.sizes()));
  saw.space = { requests: files.length, bytes: sizes.reduce((sum, size) => sum + size.responseBodySize + size.responseHeadersSize, 0) };
  check(await page.locator('#map').isHidden(), 'plan and space are seen at once');
  await page.waitForTimeout(500);
  saw.space.colours = await coloursOf(page, '#scene');
  check(saw.space.colours > 50, 'nothing is seen in three dimensions');
  const before = await picturesOf(page);
  await page.waitForTimeout(2000);
  saw.space.idle_pictures_a_second = ((await picturesOf(page)) - before) / 2;
  check(saw.space.idle_pictures_a_second <= MAX_IDLE_PICTURES, 'pictures are made while nothing changes');
  await page.locator('#space').click();
  check(await page.locator('#map').isVisible(), 'the button does not lead back to the plan');
  const hidden = await picturesOf(page);
  await page.waitForTimeout(400);
  check((await picturesOf(page)) === hidden, 'pictures are made that nobody sees');
  await page.locator('#space').click();
  check(await page.locator('#scene').isVisible(), 'the button does not lead to three dimensions');
}

/// While a drone flies; `sent`: how many velocities the page has sent.
export async function turnSpace(page, sent, check) {
  const shot = () => page.locator('#scene').screenshot();
  const velocities = sent();
  const before = [await picturesOf(page), await shot()];
  await page.locator('#scene').focus();
  for (const key of ['ArrowLeft', 'ArrowLeft', 'ArrowUp', '+']) await page.keyboard.press(key);
  await page.waitForTimeout(300);
  check((await picturesOf(page)) > before[0] && !(await shot()).equals(before[1]), 'keys do not turn the view');
  check(sent() === velocities, 'keys that turn the view fly the drone');
  await page.keyboard.press('0');
}

export async function pictureDelays(page, saw, check) {
  saw.delays = {};
  for (const picture of ['waterfall', 'histogram', 'time']) {
    await page.locator('#delay-picture').selectOption(picture);
    await page.waitForTimeout(700);
    const seen = picture === 'histogram' ? '#delay-chart' : '#delay';
    saw.delays[picture] = [await coloursOf(page, seen), await page.locator('#delay-words').textContent()];
    check(saw.delays[picture][0] > 8, `the delays' ${picture} is empty`);
    check(/half within \d+, 99.% within \d+/.test(saw.delays[picture][1]), `the delays' ${picture} has no words`);
  }
  await page.locator('#delay-picture').selectOption('histogram'); // remembered
}

export async function readBlocks(page, saw, check) {
  await page.locator('#blocks-on').click();
  await page.locator('#blocks-list li').nth(5).waitFor({ timeout: 10000 });
  await page.waitForTimeout(700);
  saw.blocks = { words: await page.locator('#blocks-words').textContent(), rows: await page.locator('#blocks-list li').allTextContents() };
  const numbers = saw.blocks.rows.map((row) => Number(/\d+/.exec(row)[0]));
  saw.blocks.rows.length = 5;
  check(/^Block \d+, [\d.]+ s ago; [\d.]+ a second$/.test(saw.blocks.words), 'the newest block is not said');
  check(numbers.length <= 50 && numbers.every((number, i) => i === 0 || number === numbers[i - 1] - 1), 'blocks are missing, or more than fifty');
  check(saw.blocks.rows.some((row) => / set/.test(row)), 'nothing says what blocks hold');
  await page.locator('#blocks-on').click();
}

/// By the keyboard alone, and on the ground.
export async function switchFaults(page, saw, check, picture) {
  await page.locator('#map').focus();
  await page.keyboard.press('f');
  const delayed = page.locator('[data-fault=ledger-delayed]');
  await delayed.waitFor();
  saw.faults = await page.locator('#faults-list [role=switch]').evaluateAll((all) => all.map((each) => each.dataset.fault));
  await page.locator('#faults-open').focus();
  await page.keyboard.press('Tab');
  check((await page.evaluate(() => document.activeElement.dataset.fault)) === 'ledger-delayed', 'the keyboard does not reach the switches');
  await page.keyboard.press('Space');
  await page.locator('#faults-words', { hasText: 'On: Ledger delayed' }).waitFor({ timeout: 10000 });
  check(await page.locator('#faults.on').isVisible(), 'a fault that is on has no colour');
  await page.locator('#events-list .event', { hasText: 'Ledger delayed: switched on' }).waitFor({ timeout: 10000 });
  await picture();
  await page.locator('#faults-off').focus();
  await page.keyboard.press('Enter');
  await page.locator('#faults-words', { hasText: 'None is on.' }).waitFor({ timeout: 10000 });
  check((await page.evaluate(() => document.activeElement.id)) === 'faults-open', 'a button that goes takes the keyboard with it');
  check((await delayed.getAttribute('aria-checked')) === 'false', 'a fault that is off looks on');
  await page.locator('#map').focus();
  await page.keyboard.press('f');
  check(await page.locator('#faults-list').isHidden(), 'F does not close the switches');
}

/// As it is built where npm or the network was missing.
export async function withoutLibraries(browser, url, watch, check) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 } });
  const page = await context.newPage();
  watch(page);
  const asked = [];
  await page.route('**/page/lib/**', (route) => {
    asked.push(new URL(route.request().url()).pathname);
    return route.request().url().endsWith('/built.js') ? route.fulfill({ contentType: 'text/javascript', body: 'export const libraries = false;' }) : route.fulfill({ status: 404 });
  });
  await page.goto(url);
  await page.waitForSelector('.card');
  await page.keyboard.press('v');
  check(/built without its 3-D view/.test(await page.locator('#space-words').textContent()), 'a page without its libraries does not say so');
  check(await page.locator('#map').isVisible(), 'a page without its libraries has no plan');
  await page.locator('#delay-picture').selectOption('histogram');
  check(await page.locator('#delay-lacks').isVisible(), 'a page without its charts does not say so');
  await page.locator('#delay-picture').selectOption('waterfall');
  check(await page.locator('#delay').isVisible(), 'a page without its libraries has no waterfall');
  check(asked.length === 1, 'a page without its libraries asks for them');
  await context.close();
}
