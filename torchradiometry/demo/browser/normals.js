// Normals and paint, as torchradiometry.deploy computes them, by the same models.
//
// A result is {width, height, pixels, normal, albedo}: the grid, the places of the object's pixels
// on it, and at each of them (`3 x pixel`, one colour or component after the other) the unit normal
// and the paint relative to its mean.
"use strict";
{
  const { Fault, LINEAR, boxOf, cut, gridOf, model, resized, run } = radiometry;

  /** The longer side of what the shading model sees; pixels in one call of the photometric one. */
  const SHADING_SIDE = 64;
  const PIXELS_AT_ONCE = 256;
  const GREY = [0.2989, 0.587, 0.114];

  /** From one photograph: crop to the object, shrink, ask the model, enlarge. */
  async function fromPhotograph(photograph, mask, side) {
    const { width, rgba } = photograph;
    const box = boxOf(mask, width, photograph.height);
    const inside = cut(mask, width, box);
    const shrink = Math.min(1, SHADING_SIDE / Math.max(box.width, box.height));
    const w = Math.max(8, Math.round(box.width * shrink));
    const h = Math.max(8, Math.round(box.height * shrink));
    const small = shrunk(rgba, width, box, inside, w, h);
    const found = await run(await model("shading"), {
      image: { data: small.image, dims: [1, 3, h, w] },
      mask: { data: small.mask, dims: [1, 1, h, w] },
    });
    const grid = gridOf(inside, box, side);
    const weight = resized(small.mask, w, h, grid.width, grid.height);
    const enlarged = (tensor, unknown) => {
      const out = new Float32Array(3 * grid.pixels.length);
      for (let c = 0; c < 3; c++) {
        const part = tensor.data.subarray(c * w * h, (c + 1) * w * h);
        const larger = resized(part, w, h, grid.width, grid.height);
        grid.pixels.forEach((pixel, k) => {
          const known = weight[pixel] > 0;
          out[c * grid.pixels.length + k] = known ? larger[pixel] / weight[pixel] : unknown[c];
        });
      }
      return out;
    };
    const normal = unit(enlarged(found.normal, [0, 0, 1]));
    return { ...grid, normal, albedo: relative(enlarged(found.albedo, [1, 1, 1])) };
  }

  /** What the model sees: linear colours averaged over the object alone, and its mask. */
  function shrunk(rgba, width, box, inside, w, h) {
    const covered = resized(inside, box.width, box.height, w, h);
    const image = new Float32Array(3 * w * h);
    for (let c = 0; c < 3; c++) {
      const colour = inside.map((share, i) => {
        const at = (box.y + Math.floor(i / box.width)) * width + box.x + (i % box.width);
        return share * LINEAR[rgba[4 * at + c]];
      });
      const smaller = resized(colour, box.width, box.height, w, h);
      smaller.forEach((value, i) => { image[c * w * h + i] = covered[i] > 0 ? value / covered[i] : 0; });
    }
    const mask = Float32Array.from(covered, (share) => (share >= 0.5 ? 1 : 0));
    if (!mask.includes(1)) mask.fill(1);
    return { image, mask };
  }

  /**
   * From a set of `readSet`: blocks of pixels through the photometric model, so that the page
   * stays alive; `report` gets a sentence and a share, `going` says whether to go on.
   */
  async function fromSet({ grid, directions, colours }, report, going) {
    const lights = directions.length;
    const count = grid.pixels.length;
    const session = await model("photometric");
    const direction = { data: Float32Array.from(directions.flat()), dims: [lights, 3] };
    const normal = new Float32Array(3 * count);
    for (let first = 0; first < count; first += PIXELS_AT_ONCE) {
      if (!going()) return null;
      report(`Normals of pixel ${first} of ${count} under ${lights} lights …`, first / count);
      const size = Math.min(PIXELS_AT_ONCE, count - first);
      const intensity = { data: grey(colours, first, size), dims: [size, lights] };
      const { normal: found } = await run(session, { intensity, direction });
      for (let k = 0; k < size; k++) {
        for (let c = 0; c < 3; c++) normal[c * count + first + k] = found.data[3 * k + c];
      }
      await new Promise((resolve) => setTimeout(resolve));
    }
    return { ...grid, normal: unit(normal), albedo: relative(paint(normal, directions, colours)) };
  }

  /** Luminance `pixel x light` of a block of pixels. */
  function grey(colours, first, size) {
    const out = new Float32Array(size * colours.length);
    colours.forEach((colour, light) => {
      for (let k = 0; k < size; k++) {
        const at = 3 * (first + k);
        out[k * colours.length + light] = GREY[0] * colour[at] + GREY[1] * colour[at + 1] + GREY[2] * colour[at + 2];
      }
    });
    return out;
  }

  /** How far an observation may be from rho max(0, n . l), as a share of it: no highlight, no shadow. */
  const MATT = 0.5;

  /** Least squares for rho in I = rho max(0, n . l) at each pixel and colour; twice, the second
   *  time without what the first calls a highlight or a shadow. */
  function paint(normal, directions, colours) {
    const count = normal.length / 3;
    const out = new Float32Array(normal.length);
    for (let k = 0; k < count; k++) {
      const lit = directions.map((l) => Math.max(0, normal[k] * l[0] + normal[count + k] * l[1] + normal[2 * count + k] * l[2]));
      for (let c = 0; c < 3; c++) {
        const fit = (first) => {
          let [sum, squares] = [0, 0];
          lit.forEach((cosine, i) => {
            const seen = colours[i][3 * k + c];
            if (first !== null && Math.abs(seen - first * cosine) > MATT * first * cosine) return;
            sum += cosine * seen;
            squares += cosine * cosine;
          });
          return squares > 0 ? sum / squares : first ?? 0;
        };
        out[c * count + k] = fit(fit(null));
      }
    }
    return out;
  }

  /** Vectors `3 x pixel` of length 1; a pixel that saw no light faces the camera. */
  function unit(normal) {
    const count = normal.length / 3;
    for (let k = 0; k < count; k++) {
      const length = Math.hypot(normal[k], normal[count + k], normal[2 * count + k]);
      if (!Number.isFinite(length)) throw new Fault("The model gave no finite normals: check the photographs.");
      for (let c = 0; c < 3; c++) normal[c * count + k] = length > 0 ? normal[c * count + k] / length : c === 2 ? 1 : 0;
    }
    return normal;
  }

  /** Divided by its mean. */
  function relative(albedo) {
    const mean = albedo.reduce((a, b) => a + b, 0) / albedo.length;
    if (!(mean > 0) || !Number.isFinite(mean)) throw new Fault("The photographs are black on the object: mark another object.");
    return albedo.map((v) => v / mean);
  }

  /** Normals as colours: (n + 1) / 2; clear outside the object. */
  function drawNormals(canvas, { width, height, pixels, normal }) {
    canvas.width = width;
    canvas.height = height;
    const picture = new ImageData(width, height);
    const count = pixels.length;
    pixels.forEach((pixel, k) => {
      for (let c = 0; c < 3; c++) picture.data[4 * pixel + c] = Math.round((normal[c * count + k] + 1) * 127.5);
      picture.data[4 * pixel + 3] = 255;
    });
    canvas.getContext("2d").putImageData(picture, 0, 0);
  }

  Object.assign(radiometry, { drawNormals, fromPhotograph, fromSet });
}
