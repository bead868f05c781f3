// Pictures of the page, for the eye: node screenshots.mjs PAGE_URL FOLDER
import { openBrowser, openPage } from "./browser.mjs";

const [url, folder] = process.argv.slice(2);
const KINDS = {
  light: { viewport: { width: 1280, height: 860 }, colorScheme: "light" },
  dark: { viewport: { width: 1280, height: 860 }, colorScheme: "dark" },
  phone: { viewport: { width: 390, height: 844 }, colorScheme: "light", deviceScaleFactor: 1, hasTouch: true, isMobile: true },
};
const browser = await openBrowser();
for (const [name, options] of Object.entries(KINDS)) {
  const { page, complaints } = await openPage(browser, url, options);
  await page.evaluate(() => radiometry.ready);
  await page.screenshot({ path: `${folder}/page-${name}.png`, fullPage: true });
  if (name === "phone") {
    const words = { name: "words.png", mimeType: "image/png", buffer: Buffer.from("no picture") };
    await page.locator("#photograph").setInputFiles(words);
    await page.waitForSelector("#error:not([hidden])");
    await page.screenshot({ path: `${folder}/page-error.png` });
  }
  console.log(name, complaints, await page.evaluate(() => document.documentElement.scrollWidth - innerWidth));
  await page.close();
}
await browser.close();
