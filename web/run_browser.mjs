// Jobs as in run_node.mjs, in headless Chromium with onnxruntime-web (WebAssembly, one thread).
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { openBrowser, openPage } from "./browser.mjs";
import { runJob } from "./job.mjs";

const DIST = new URL("node_modules/onnxruntime-web/dist/", import.meta.url);
const read = (name) => readFileSync(new URL(name, DIST)).toString("base64");

const browser = await openBrowser();
const { page } = await openPage(browser, "about:blank");
await page.addScriptTag({ content: readFileSync(new URL("ort.wasm.min.js", DIST), "utf8") });
await page.evaluate(([wasm, glue]) => {
  const decode = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  ort.env.wasm.numThreads = 1;
  ort.env.wasm.wasmBinary = decode(wasm).buffer;
  ort.env.wasm.wasmPaths = { mjs: URL.createObjectURL(new Blob([decode(glue)], { type: "text/javascript" })) };
}, [read("ort-wasm-simd-threaded.wasm"), read("ort-wasm-simd-threaded.mjs")]);
const version = await page.evaluate(() => ort.env.versions.web ?? ort.env.versions.common);
console.log(JSON.stringify({ runtime: "onnxruntime-web", version, host: `Chromium ${browser.version()}` }));
for await (const line of createInterface({ input: process.stdin })) {
  console.log(JSON.stringify(await page.evaluate(runJob, JSON.parse(line))));
}
await browser.close();
