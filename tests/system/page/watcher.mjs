// What drives of the page share: the browser, what a page says and sends, axe's findings, screenshots.
// LEDGERLINE_PAGE_NPM: where playwright-core and axe-core are installed, else build/npm-page; LEDGERLINE_CHROMIUM: the browser.
import { mkdirSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';

export const SIZES = { desktop: { width: 1280, height: 800 }, phone: { width: 390, height: 844 } };
const THEMES = ['light', 'dark'];
const CALM_MS = 2500;
const TIMEOUT_MS = 120000;
const WEBGL = ['--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist']; // drawn by the processor

const packages = process.env.LEDGERLINE_PAGE_NPM ?? join(import.meta.dirname, '../../../build/npm-page');
const { chromium, axe } = (() => {
  const require = createRequire(join(packages, 'any.js'));
  try {
    return { ...require('playwright-core'), axe: require('axe-core') };
  } catch (error) {
    console.error(`${packages} lacks what package.json names (${error.code}); copy package.json and package-lock.json there and run npm ci`);
    process.exit(2);
  }
})();

export const launch = () => chromium.launch({ executablePath: process.env.LEDGERLINE_CHROMIUM ?? '/usr/bin/chromium', args: [...WEBGL, ...(process.getuid() === 0 ? ['--no-sandbox'] : [])] });

export function cardOf(page, name) {
  const card = page.locator('.card', { has: page.locator('.name', { hasText: new RegExp(`^${name}$`) }) });
  const phase = (words, timeout) => card.locator('.phase', { hasText: new RegExp(`^(${words})$`) }).waitFor({ timeout });
  const place = async () => (await card.locator('[data-field=place]').textContent()).match(/-?\d+\.\d+/g).map(Number);
  return { card, phase, place };
}

/// Until no failsafe has held a drone for a while: what a busy host does to a pose is not what is tested here.
export async function calm(page) {
  await page.waitForFunction((calm_ms) => {
    const held = [...document.querySelectorAll('.card [data-field=failsafe]')].some((each) => !each.textContent.startsWith('not active'));
    if (held) globalThis.calmSince = undefined;
    else globalThis.calmSince ??= performance.now();
    return performance.now() - globalThis.calmSince > calm_ms;
  }, CALM_MS, { timeout: TIMEOUT_MS, polling: 50 });
}

export class Watcher {
  #outdir;
  saw;
  velocities = []; // every one that was sent by a page that is watched

  constructor(outdir, saw) {
    mkdirSync(outdir, { recursive: true });
    this.#outdir = outdir;
    this.saw = { ...saw, console_errors: [], axe: {}, wide_by_px: {}, wrong: [] };
  }

  check(good, words) {
    if (!good) this.saw.wrong.push(words);
  }

  /// `velocities`: where this page's go. `meant`: errors of the console that a step provokes.
  watch(page, { velocities = this.velocities, meant = null } = {}) {
    page.on('console', (message) => message.type() === 'error' && !meant?.test(message.text()) && this.saw.console_errors.push(message.text()));
    page.on('pageerror', (error) => this.saw.console_errors.push(String(error)));
    page.on('websocket', (socket) => socket.on('framesent', ({ payload }) => {
      const message = JSON.parse(payload);
      if (message.op === 'velocity') velocities.push(message);
    }));
  }

  async axe(page, name) {
    await page.evaluate(axe.source);
    const found = await page.evaluate(() => globalThis.axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'] }));
    this.saw.axe[name] = found.violations.map(({ id, nodes }) => `${id}: ${nodes.slice(0, 4).map((node) => node.target.join(' ')).join(', ')}`);
    this.check(this.saw.axe[name].length === 0, `axe finds violations (${name})`);
  }

  async pictures(page, size, moment, with_axe = true) {
    for (const theme of THEMES) {
      await page.emulateMedia({ colorScheme: theme });
      await page.waitForTimeout(400);
      await page.screenshot({ path: join(this.#outdir, `${moment}-${size}-${theme}.png`) });
      if (with_axe) await this.axe(page, `${moment} ${size} ${theme}`);
    }
    const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    this.saw.wide_by_px[size] = Math.max(wide, this.saw.wide_by_px[size] ?? wide);
    this.check(wide <= 0, `the page is wider than the screen (${moment}, ${size})`);
  }
}
