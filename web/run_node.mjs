// Jobs (see job.mjs), one JSON object a line on standard input; answers the same on standard output.
import { createInterface } from "node:readline";
import ort from "onnxruntime-node";
import { runJob } from "./job.mjs";

globalThis.ort = ort;
console.log(JSON.stringify({ runtime: "onnxruntime-node", version: ort.env.versions.node ?? ort.env.versions.common, host: `Node ${process.version}` }));
for await (const line of createInterface({ input: process.stdin })) {
  console.log(JSON.stringify(await runJob(JSON.parse(line))));
}
