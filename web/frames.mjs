// How long a frame takes, by the number of the object's pixels: node frames.mjs PAGE_URL
//
// By the clock (median, quartiles and least of FRAMES) and by the processor: the time that the
// page's own thread was running, which other work on the machine does not lengthen much.
import { openBrowser, openPage } from "./browser.mjs";

const FRAMES = 25;
const browser = await openBrowser();
const { page } = await openPage(browser, process.argv[2]);
await page.evaluate(() => radiometry.ready);
const client = await page.context().newCDPSession(page);
await client.send("Performance.enable", { timeDomain: "threadTicks" });

/** Seconds that the page's thread has been running. */
async function running() {
  const { metrics } = await client.send("Performance.getMetrics");
  return metrics.find((metric) => metric.name === "TaskDuration").value;
}

/** A dome of side x side pixels, all of them the object. */
async function open(side) {
  await page.evaluate((side) => {
    const count = side * side;
    const result = {
      width: side, height: side, pixels: Int32Array.from({ length: count }, (_, i) => i),
      normal: new Float32Array(3 * count), albedo: new Float32Array(3 * count).fill(1),
    };
    for (let k = 0; k < count; k++) {
      const [x, y] = [0.7 * ((2 * (k % side)) / side - 1), 0.7 * (1 - (2 * Math.floor(k / side)) / side)];
      [x, y, Math.sqrt(1 - x * x - y * y)].forEach((v, c) => { result.normal[c * count + k] = v; });
    }
    radiometry.dome = new radiometry.Relighting(document.createElement("canvas"), result);
    radiometry.dome.setSurface({ albedo: 0.5, specular: 0.1, shininess: 30, painted: true });
  }, side);
}

const draw = (frames) => page.evaluate(async (frames) => {
  const times = [];
  for (let i = 0; i < frames; i++) {
    const direction = radiometry.towards(Math.cos(i / 7) * 0.6, Math.sin(i / 7) * 0.6);
    times.push((await radiometry.dome.draw(direction, Math.PI)).frame);
  }
  return times.sort((a, b) => a - b);
}, frames);

console.log("| pixels of the object | by the processor, ms | by the clock, ms (quartiles) | least |");
console.log("|---|---|---|---|");
for (const side of [64, 128, 181, 256, 512]) {
  await open(side);
  await draw(2);
  const before = await running();
  const times = await draw(FRAMES);
  const busy = (1000 * ((await running()) - before)) / FRAMES;
  const at = (share) => times[Math.round(share * (FRAMES - 1))].toFixed(1);
  console.log(`| ${side * side} | ${busy.toFixed(1)} | ${at(0.5)} (${at(0.25)} to ${at(0.75)}) | ${at(0)} |`);
}
await browser.close();
