// A headless Chromium that answers for what it did: console errors and page errors are kept.
import { existsSync } from "node:fs";
import { chromium } from "playwright-core";

/** Where Debian and others put it; CHROMIUM names another. */
const PLACES = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
const ARGUMENTS = [
  "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
  "--disable-background-networking", "--disable-component-update",
];

export async function openBrowser() {
  const executablePath = PLACES.find((path) => path && existsSync(path));
  if (!executablePath) throw new Error(`no Chromium in ${PLACES.filter(Boolean).join(", ")}`);
  return chromium.launch({ executablePath, args: ARGUMENTS });
}

/** A page and the list of what it complained about. */
export async function openPage(browser, url, options = {}) {
  const page = await browser.newPage(options);
  const complaints = [];
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) complaints.push(message.text());
  });
  page.on("pageerror", (error) => complaints.push(error.message));
  page.on("requestfailed", (request) => complaints.push(`failed: ${request.url().slice(0, 200)}`));
  await page.goto(url);
  return { page, complaints };
}
