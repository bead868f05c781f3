// What the person does, and what the page says back.
"use strict";
{
  const {
    Fault, Mask, Relighting, asSet, drawMask, drawNormals, fromPhotograph, fromSet, readMask,
    readPhotograph, readSet, towards, unpack,
  } = radiometry;
  const at = (id) => document.getElementById(id);
  const canvas = { photograph: at("photograph-canvas"), normals: at("normals-canvas"), relit: at("relit-canvas") };
  const LIGHT_AT_FIRST = { x: -0.45, y: 0.5 };
  const MAX_DROPPED = 2000;

  /** What is open: {photograph, mask} or {set}; and the number of the newest job. */
  const state = { photograph: null, mask: null, set: null, job: 0, light: { ...LIGHT_AT_FIRST } };
  let relighting = null;

  // ---- what the page says ------------------------------------------------------------------

  function say(sentence, share = null) {
    at("status").textContent = sentence;
    at("progress").hidden = share === null;
    at("progress").value = share ?? 0;
  }

  function complain(error) {
    const sentence = error instanceof Fault ? error.message : `This did not work: ${error.message ?? error}.`;
    at("error").textContent = sentence;
    at("error").hidden = false;
    say(relighting ? "The last result is still shown." : "Nothing is open.");
  }

  /**
   * Run one job; a newer one makes `going` false in the older. A fault becomes a sentence, and
   * what a job holds when it is overtaken is thrown away.
   */
  async function job(work) {
    const mine = ++state.job;
    const going = () => mine === state.job;
    at("error").hidden = true;
    try {
      await work(going);
    } catch (error) {
      if (going()) complain(error);
    } finally {
      if (going()) at("progress").hidden = true;
    }
  }

  /** A canvas as large as its square frame allows. */
  function fit(element) {
    const wide = element.width >= element.height;
    element.style.width = wide ? "100%" : "auto";
    element.style.height = wide ? "auto" : "100%";
  }

  // ---- opening -----------------------------------------------------------------------------

  const openFiles = (files) => job(async (going) => {
    const set = asSet(files);
    if (set) {
      await openSet(set, going);
      return;
    }
    const pictures = files.filter((file) => !/\.txt$/i.test(file.name));
    if (!pictures.length) throw new Fault("There is no picture among these files: drop a PNG, JPEG or WebP file.");
    const isMask = (file) => /mask/i.test(file.name);
    const maskFile = pictures.length === 2 ? pictures.find(isMask) : null;
    const photographs = pictures.filter((file) => file !== maskFile);
    if (photographs.length > 1) {
      throw new Fault("These are several photographs without light_directions.txt: drop one photograph, or a folder with its lights.");
    }
    await openPhotograph(photographs[0], maskFile, going);
  });

  async function openPhotograph(file, maskFile, going) {
    say(`Reading ${file.name} …`);
    const photograph = await readPhotograph(file);
    const fixed = maskFile ? await readMask(maskFile, photograph.width, photograph.height) : null;
    if (!going()) return;
    state.photograph = photograph;
    state.mask = new Mask(photograph, fixed);
    state.mask.threshold = Number(at("threshold").value);
    state.set = null;
    showSource();
    await find(going);
  }

  async function openSet(set, going) {
    const side = Number(at("detail").value);
    const found = await readSet(set, side, say, going);
    if (!found || !going()) return;
    Object.assign(state, { photograph: null, mask: null, set });
    showSource(found);
    const result = await fromSet(found, (sentence, share) => say(sentence, share), going);
    if (result && going()) await showResult(result, `${found.directions.length} lights`, going);
  }

  function showSource(found = null) {
    at("mask-tools").hidden = Boolean(found);
    at("set-note").hidden = !found;
    if (found) {
      const { grid, directions, first } = found;
      at("set-note").textContent = `${directions.length} photographs, taken as linear and divided by light_intensities.txt; mask.png says what the object is.`;
      canvas.photograph.width = grid.width;
      canvas.photograph.height = grid.height;
      canvas.photograph.getContext("2d").putImageData(first, 0, 0);
    } else {
      at("threshold").disabled = Boolean(state.mask.fixed);
      drawMask(canvas.photograph, state.photograph, state.mask.values());
    }
    fit(canvas.photograph);
  }

  /** Normals of the open photograph with its present mask. */
  async function find(going) {
    if (!state.photograph) return;
    say("Looking for normals …");
    await new Promise((resolve) => setTimeout(resolve)); // lets the sentence be drawn
    const side = Number(at("detail").value);
    const result = await fromPhotograph(state.photograph, state.mask.values(), side);
    if (going()) await showResult(result, "one photograph", going);
  }

  async function showResult(result, from, going) {
    radiometry.result = result; // for programs, and for the tests
    drawNormals(canvas.normals, result);
    relighting = new Relighting(canvas.relit, result);
    recent = [];
    fit(canvas.normals);
    fit(canvas.relit);
    at("found").textContent = `From ${from}: ${result.pixels.length.toLocaleString("en")} pixels, ${result.width} x ${result.height}.`;
    setSurface();
    await light();
    if (going()) say("Ready: move the pointer, a finger or the arrow keys over the last picture.");
  }

  // ---- relighting --------------------------------------------------------------------------

  let drawing = false;
  let again = false;
  /** Milliseconds of the last frames, the newest last; the first one warms up and is left out. */
  let recent = [];
  const RECENT = 15;

  /** Draw a frame; while one is being drawn, only the newest wish is kept. */
  async function light() {
    if (!relighting) return;
    if (drawing) {
      again = true;
      return;
    }
    drawing = true;
    try {
      do {
        again = false;
        await new Promise((resolve) => requestAnimationFrame(resolve));
        const direction = towards(state.light.x, state.light.y);
        const times = await relighting.draw(direction, Math.PI * Number(at("power").value));
        if (relighting.warm) showLight(direction, times);
        else again = relighting.warm = true;
      } while (again);
    } catch (error) {
      complain(error);
    } finally {
      drawing = false;
    }
  }

  const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

  function showLight(direction, times) {
    recent = [...recent, times].slice(-RECENT);
    const layer = median(recent.map((t) => t.layer));
    const frame = median(recent.map((t) => t.frame));
    radiometry.frames = (radiometry.frames ?? 0) + 1;
    radiometry.light = { direction, irradiance: Math.PI * Number(at("power").value) };
    at("light").textContent = `Light from (${direction.map((v) => v.toFixed(2)).join(", ")}).`;
    at("frame").textContent = `${frame.toFixed(1)} ms a frame, ${layer.toFixed(1)} ms of it the layer.`;
    const box = canvas.relit.getBoundingClientRect();
    const frameBox = canvas.relit.parentElement.getBoundingClientRect();
    const radius = Math.min(box.width, box.height) / 2;
    at("lamp").style.left = `${box.left - frameBox.left + box.width / 2 + direction[0] * radius}px`;
    at("lamp").style.top = `${box.top - frameBox.top + box.height / 2 - direction[1] * radius}px`;
  }

  const gloss = () => 10 ** Number(at("shininess").value);

  /** What a slider stands for, beside it and for a screen reader. */
  function tell(id, text) {
    at(`${id}-value`).textContent = text;
    at(id).setAttribute("aria-valuetext", text);
  }

  function setSurface() {
    tell("albedo", Number(at("albedo").value).toFixed(2));
    tell("specular", Number(at("specular").value).toFixed(2));
    tell("shininess", gloss().toFixed(gloss() < 10 ? 1 : 0));
    tell("power", `${Number(at("power").value).toFixed(2)} π`);
    relighting?.setSurface({
      albedo: Number(at("albedo").value),
      specular: Number(at("specular").value),
      shininess: gloss(),
      painted: at("painted").checked,
    });
  }

  function moveLight(event) {
    const box = canvas.relit.getBoundingClientRect();
    const radius = Math.min(box.width, box.height) / 2;
    state.light.x = (event.clientX - box.left - box.width / 2) / radius;
    state.light.y = -(event.clientY - box.top - box.height / 2) / radius;
    light();
  }

  canvas.relit.addEventListener("pointermove", moveLight);
  canvas.relit.addEventListener("pointerdown", (event) => {
    canvas.relit.setPointerCapture(event.pointerId);
    moveLight(event);
  });
  canvas.relit.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (event.key === "Home") {
      state.light = { ...LIGHT_AT_FIRST };
    } else if (steps[event.key]) {
      const [dx, dy] = steps[event.key];
      state.light.x = Math.max(-1, Math.min(1, state.light.x + 0.08 * dx));
      state.light.y = Math.max(-1, Math.min(1, state.light.y + 0.08 * dy));
    } else {
      return;
    }
    event.preventDefault();
    light();
  });
  for (const id of ["albedo", "specular", "shininess", "painted", "power"]) {
    at(id).addEventListener("input", () => {
      setSurface();
      light();
    });
  }

  // ---- the mask ----------------------------------------------------------------------------

  const brushRadius = () => (Number(at("brush-size").value) / 200) * Math.max(state.photograph.width, state.photograph.height);
  const brushSign = () => Number(document.querySelector("input[name=brush]:checked").value);
  let last = null;

  function place(event) {
    const box = canvas.photograph.getBoundingClientRect();
    return {
      x: ((event.clientX - box.left) / box.width) * canvas.photograph.width,
      y: ((event.clientY - box.top) / box.height) * canvas.photograph.height,
    };
  }

  function brush(event) {
    const here = place(event);
    state.mask.stroke(last ?? here, here, brushRadius(), brushSign());
    last = here;
    drawMask(canvas.photograph, state.photograph, state.mask.values());
  }

  canvas.photograph.addEventListener("pointerdown", (event) => {
    if (!state.mask || !at("mask-tools").open) return;
    canvas.photograph.setPointerCapture(event.pointerId);
    last = null;
    brush(event);
  });
  canvas.photograph.addEventListener("pointermove", (event) => {
    if (last && state.mask) brush(event);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.photograph.addEventListener(end, () => {
      if (last) job(find);
      last = null;
    });
  }
  function showTools() {
    tell("threshold", `by ${at("threshold").value} %`);
    tell("brush-size", `${at("brush-size").value} %`);
  }
  at("brush-size").addEventListener("input", showTools);
  at("threshold").addEventListener("input", () => {
    showTools();
    if (!state.mask) return;
    state.mask.threshold = Number(at("threshold").value);
    drawMask(canvas.photograph, state.photograph, state.mask.values());
  });
  at("threshold").addEventListener("change", () => job(find));
  at("undo-brush").addEventListener("click", () => job(async (going) => {
    if (!state.mask) return;
    state.mask.forgetBrush();
    drawMask(canvas.photograph, state.photograph, state.mask.values());
    await find(going);
  }));

  // ---- files -------------------------------------------------------------------------------

  /** Call `open` with the files of a field, and empty it so that the same may be chosen again. */
  function onFiles(id, open) {
    at(id).addEventListener("change", () => {
      const files = [...at(id).files];
      at(id).value = "";
      if (files.length) open(files);
    });
  }
  onFiles("photograph", openFiles);
  onFiles("folder", openFiles);
  onFiles("mask-file", ([file]) => job(async (going) => {
    if (!state.photograph) return;
    const fixed = await readMask(file, state.photograph.width, state.photograph.height);
    state.mask = new Mask(state.photograph, fixed);
    showSource();
    await find(going);
  }));

  /** Every file that was dropped, also those in folders, at most MAX_DROPPED. */
  async function dropped(transfer) {
    const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
    if (!entries.length) return [...transfer.files];
    const files = [];
    const visit = async (entry, path) => {
      if (entry.isFile) {
        const file = await new Promise((resolve, reject) => entry.file(resolve, reject));
        file.path = path + file.name;
        files.push(file);
        if (files.length > MAX_DROPPED) throw new Fault(`There are more than ${MAX_DROPPED} files in this folder: drop one set.`);
        return;
      }
      const reader = entry.createReader();
      const read = () => new Promise((resolve, reject) => reader.readEntries(resolve, reject));
      for (let some = await read(); some.length; some = await read()) {
        for (const inner of some) await visit(inner, `${path}${entry.name}/`);
      }
    };
    for (const entry of entries) await visit(entry, "");
    return files;
  }

  addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) document.body.classList.remove("dropping");
  });
  addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dropping");
    dropped(event.dataTransfer).then((files) => files.length && openFiles(files), complain);
  });

  // ---- samples, saving, start --------------------------------------------------------------

  /** A packed sample: a JSON object of file name -> text, or picture in base64. */
  async function sampleFiles(name) {
    const files = JSON.parse(new TextDecoder().decode(await unpack(name)));
    return Object.entries(files).map(([path, { text, base64 }]) => {
      const bytes = base64 ? Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)) : text;
      return new File([bytes], path);
    });
  }

  async function openSample(name) {
    try {
      await openFiles(await sampleFiles(name));
    } catch (error) {
      complain(error);
    }
  }
  at("sample").addEventListener("click", () => openSample("sample"));
  at("sample-set").addEventListener("click", () => openSample("sample-set"));
  at("detail").addEventListener("change", () => job(async (going) => {
    if (state.set) await openSet(state.set, going);
    else await find(going);
  }));
  at("save").addEventListener("click", () => canvas.normals.toBlob((blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = "normals.png";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }));
  addEventListener("resize", () => light());
  at("mask-tools").open = !matchMedia("(max-width: 40rem)").matches; // a phone shows pictures first
  showTools();
  setSurface();
  radiometry.ready = openSample("sample"); // settles when the first picture is lit
}
