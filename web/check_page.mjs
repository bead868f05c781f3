// What a person would try on the page: node check_page.mjs PAGE_URL FOLDER > report.json
//
// FOLDER holds `set/` (a sample folder), `words.png` (no picture), `huge.png` (a header that claims
// too many pixels) and `photo.png`, `mask.png`. Arrays are reported in base64.
import { readFile } from "node:fs/promises";
import { join } from "node:path";
import { openBrowser, openPage } from "./browser.mjs";
import * as keyboard from "./keyboard.mjs";

const [url, folder] = process.argv.slice(2);
const TIMEOUT = 120_000;

/** The result, the light and the pixels of the relit canvas, as they stand. */
async function observed(page) {
  return page.evaluate(() => {
    const base64 = (array) => {
      const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
      let text = "";
      for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
      return btoa(text);
    };
    const canvas = document.getElementById("relit-canvas");
    const { width, height, pixels, normal, albedo } = radiometry.result;
    const picture = canvas.getContext("2d").getImageData(0, 0, width, height).data;
    const value = (id) => Number(document.getElementById(id).value);
    return {
      width, height, pixels: base64(pixels), normal: base64(normal), albedo: base64(albedo),
      picture: base64(picture), light: radiometry.light, frames: radiometry.frames,
      surface: { albedo: value("albedo"), specular: value("specular"), shininess: 10 ** value("shininess") },
    };
  });
}

/** Do something and wait until the light has been drawn anew. */
async function lit(page, act) {
  const before = await page.evaluate(() => radiometry.frames);
  await act();
  await page.waitForFunction((n) => radiometry.frames > n, before, { timeout: TIMEOUT });
}

/** The sentence that appears after an act. */
async function sentence(page, act) {
  await act();
  await page.waitForSelector("#error:not([hidden])", { timeout: TIMEOUT });
  const text = await page.textContent("#error");
  await page.evaluate(() => { document.getElementById("error").hidden = true; });
  return text;
}

/** Do something and wait for another result. */
async function found(page, act) {
  await page.evaluate(() => { radiometry.before = radiometry.result; });
  await act();
  await page.waitForFunction(() => radiometry.result !== radiometry.before
    && document.getElementById("status").textContent.startsWith("Ready"), null, { timeout: TIMEOUT });
  return observed(page);
}

/** Let files fall on the page, as from a file manager. */
async function drop(page, ...names) {
  const files = await Promise.all(names.map(async (name) => [name, (await readFile(join(folder, name))).toString("base64")]));
  const dataTransfer = await page.evaluateHandle((files) => {
    const transfer = new DataTransfer();
    for (const [name, base64] of files) {
      const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
      transfer.items.add(new File([bytes], name, { type: "image/png" }));
    }
    return transfer;
  }, files);
  await page.dispatchEvent("body", "dragover", { dataTransfer });
  await page.dispatchEvent("body", "drop", { dataTransfer });
}

const browser = await openBrowser();
const { page, complaints } = await openPage(browser, url, { hasTouch: true });
page.setDefaultTimeout(TIMEOUT);
await page.evaluate(() => radiometry.ready);
const report = { url, first: await observed(page), mask: null, status: await page.textContent("#status") };

report.stops = await keyboard.walk(page);

const canvas = page.locator("#relit-canvas");
const box = await canvas.boundingBox();
await lit(page, () => page.mouse.move(box.x + 0.7 * box.width, box.y + 0.3 * box.height));
report.moved = await observed(page);
await lit(page, () => keyboard.press(page, "relit-canvas", "ArrowLeft"));
report.key = (await observed(page)).light;
await lit(page, () => page.touchscreen.tap(box.x + 0.25 * box.width, box.y + 0.75 * box.height));
report.touch = (await observed(page)).light;
await lit(page, () => page.locator("#shininess").fill("1"));
report.duller = await observed(page);
await lit(page, () => keyboard.press(page, "relit-canvas", "Home"));
report.home = (await observed(page)).light;
for (const [id, ...keys] of [
  ["albedo", "Home", "ArrowRight"], ["specular", "End"], ["shininess", "Home"], ["power", "End"], ["painted", "Space"],
]) await lit(page, () => keyboard.press(page, id, ...keys));
await keyboard.press(page, "brush", "ArrowDown");
report.keys = await page.evaluate(() => {
  const value = (id) => Number(document.getElementById(id).value);
  const spoken = (id) => document.getElementById(id).getAttribute("aria-valuetext");
  return {
    sliders: ["albedo", "specular", "shininess", "power"].map(value),
    spoken: ["albedo", "specular", "shininess", "power"].map(spoken),
    painted: document.getElementById("painted").checked,
    brush: document.querySelector("input[name=brush]:checked").value,
  };
});
await lit(page, () => keyboard.press(page, "painted", "Space"));
await keyboard.press(page, "brush", "ArrowUp");
await keyboard.press(page, "summary", "Enter");
report.keys.closed = await page.evaluate(() => !document.getElementById("mask-tools").open);
await keyboard.press(page, "summary", "Enter");

const photograph = page.locator("#photograph");
const choose = (...names) => photograph.setInputFiles(names.map((name) => join(folder, name)));
report.sentences = {};
for (const name of ["words.png", "huge.png"]) report.sentences[name] = await sentence(page, () => choose(name));
report.sentences.two = await sentence(page, () => choose("photo.png", "words.png"));
report.photograph = await found(page, () => keyboard.choose(page, "photograph", ["photo.png", "mask.png"].map((name) => join(folder, name))));
report.sentences.dropped = await sentence(page, () => drop(page, "words.png"));
report.sample = await found(page, () => keyboard.press(page, "sample", "Enter"));
report.keys.focus = await page.evaluate(() => document.activeElement.id);
const saved = page.waitForEvent("download");
await keyboard.press(page, "save", "Enter");
report.keys.saved = (await saved).suggestedFilename();
report.dropped = await found(page, () => drop(page, "photo.png", "mask.png"));
await found(page, () => page.locator("#sample").click());
const strokes = await page.locator("#photograph-canvas").boundingBox();
report.brushed = await found(page, async () => {
  await page.mouse.move(strokes.x + 12, strokes.y + 12);
  await page.mouse.down();
  await page.mouse.move(strokes.x + 40, strokes.y + 12, { steps: 3 });
  await page.mouse.up();
});
report.set = await found(page, () => keyboard.choose(page, "folder", join(folder, "set")));
report.sentences.folder = await sentence(page, () => page.locator("#folder").setInputFiles(join(folder, "broken")));
report.complaints = complaints;
console.log(JSON.stringify(report));
await browser.close();
