// One run of one model, the same in Node and in a browser: `runJob` must not refer to anything
// outside itself, because a browser gets it as text. It needs globalThis.ort.
//
// A job is {model, inputs, repeats, seconds}: the ONNX file in base64, for each input {name, type,
// dims, data} with data in base64, and how often and how long at most it is timed. The answer is
// {outputs, times}: outputs as the inputs are, times in ms; or {error}.
export async function runJob({ model, inputs, repeats, seconds }) {
  const ARRAYS = { float32: Float32Array, float64: Float64Array, bool: Uint8Array, int64: BigInt64Array, int32: Int32Array };
  const decode = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const encode = (array) => {
    const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
    let text = "";
    for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
    return btoa(text);
  };
  let session;
  try {
    session = await ort.InferenceSession.create(decode(model), {
      executionProviders: [globalThis.window ? "wasm" : "cpu"], intraOpNumThreads: 1, interOpNumThreads: 1, logSeverityLevel: 4,
    });
    const feeds = {};
    for (const { name, type, dims, data } of inputs) {
      if (!session.inputNames.includes(name)) continue; // not used by the graph
      feeds[name] = new ort.Tensor(type, new ARRAYS[type](decode(data).buffer), dims);
    }
    const found = await session.run(feeds);
    const outputs = session.outputNames.map((name) => {
      const { type, dims, data } = found[name];
      return { name, type, dims: [...dims], data: encode(data) };
    });
    const times = [];
    const end = performance.now() + 1000 * seconds;
    while (times.length < repeats && (times.length < 3 || performance.now() < end)) {
      const began = performance.now();
      await session.run(feeds);
      times.push(performance.now() - began);
    }
    return { outputs, times };
  } catch (error) {
    return { error: String(error?.message ?? error).split("\n")[0].slice(0, 300) };
  } finally {
    await session?.release?.();
  }
}
