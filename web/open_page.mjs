// Does the page open and light its sample? node open_page.mjs PAGE_URL > report.json
import { openBrowser, openPage } from "./browser.mjs";

const browser = await openBrowser();
const { page, complaints } = await openPage(browser, process.argv[2]);
await page.evaluate(() => radiometry.ready);
const status = await page.textContent("#status");
const pixels = await page.evaluate(() => radiometry.result?.pixels.length ?? 0);
console.log(JSON.stringify({ status, pixels, complaints }));
await browser.close();
