// A browser that looks on: it opens the page, says "open" and stays until its input ends. Then it prints how many pictures a second the
// browser drew, as far as the page could tell.
//
// Usage: node onlooker.mjs URL
import { launch, SIZES } from './watcher.mjs';

const browser = await launch();
const page = await (await browser.newContext({ viewport: SIZES.desktop })).newPage();
await page.goto(process.argv[2]);
await page.waitForSelector('.card');
await page.evaluate(() => {
  window.pictures = { count: 0, since: performance.now() };
  const count = () => {
    window.pictures.count += 1;
    requestAnimationFrame(count);
  };
  requestAnimationFrame(count);
});
console.log('open');
for await (const _ of process.stdin);
console.log(JSON.stringify(await page.evaluate(() => window.pictures.count / ((performance.now() - window.pictures.since) / 1000))));
await browser.close();
