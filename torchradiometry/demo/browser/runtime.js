// onnxruntime-web from files beside this page, and the models it runs.
//
// A packed file `packed-NAME.js` is a script that sets packed[NAME] to gzip in base64. Scripts are
// the one kind of file that a page opened from a disk (file://) may load; from a server it is the
// same way, so there is one path to test.
"use strict";
globalThis.packed ??= {};
const radiometry = (globalThis.radiometry ??= {});

{
  /** An error whose message is a sentence for the person at the screen. */
  class Fault extends Error {}

  const loading = new Map();

  /** Load the script of a packed file, once. */
  function load(name) {
    if (!loading.has(name)) {
      loading.set(name, new Promise((resolve, reject) => {
        const script = document.createElement("script");
        script.src = `packed-${name}.js`;
        script.onload = resolve;
        script.onerror = () => {
          loading.delete(name);
          reject(new Fault(`The file packed-${name}.js of this page is missing: build the page again.`));
        };
        document.head.append(script);
      }));
    }
    return loading.get(name);
  }

  /** The bytes of a packed file. */
  async function unpack(name) {
    await load(name);
    const text = atob(packed[name]);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  let started;

  /** Start onnxruntime once: one thread, WebAssembly and its glue from packed files. */
  function start() {
    started ??= (async () => {
      const [wasm, glue] = await Promise.all([unpack("wasm"), unpack("glue")]);
      ort.env.wasm.numThreads = 1; // more need headers that a plain file server does not send
      ort.env.wasm.wasmBinary = wasm.buffer;
      const url = URL.createObjectURL(new Blob([glue], { type: "text/javascript" }));
      ort.env.wasm.wasmPaths = { mjs: url };
    })();
    return started;
  }

  const opened = new Map();

  /** The session of a packed model, opened once. */
  function model(name) {
    if (!opened.has(name)) {
      opened.set(name, (async () => {
        const [bytes] = await Promise.all([unpack(name), start()]);
        return ort.InferenceSession.create(bytes, { executionProviders: ["wasm"] });
      })());
    }
    return opened.get(name);
  }

  /** Run a session on Float32Arrays by name, {data, dims} each; the outputs by name, the same. */
  async function run(session, inputs) {
    const feeds = {};
    for (const [name, { data, dims }] of Object.entries(inputs)) {
      feeds[name] = new ort.Tensor("float32", data, dims);
    }
    return session.run(feeds);
  }

  Object.assign(radiometry, { Fault, unpack, model, run });
}
