// The exported Phong layer, run for every place of the pointer.
//
// The layer works pixel by pixel, so the object's pixels are passed as one row: an image of
// 1 x count. Its output is linear radiance; with an irradiance of pi a white matt surface that
// faces the light has radiance 1, which is shown as white.
"use strict";
{
  const { model, run } = radiometry;

  /** sRGB counts of linear 0..1 in 65,536 steps: finer than a count everywhere. */
  const STEPS = 65535;
  const ENCODED = Uint8ClampedArray.from({ length: STEPS + 1 }, (_, i) => {
    const v = i / STEPS;
    return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
  });

  class Relighting {
    /** `result` of `fromPhotograph` or `fromSet`. */
    constructor(canvas, result) {
      this.result = result;
      canvas.width = result.width;
      canvas.height = result.height;
      // kept in memory, where pixels are put, and not on a graphics card
      this.context = canvas.getContext("2d", { willReadFrequently: true });
      this.picture = new ImageData(result.width, result.height);
      for (const pixel of result.pixels) this.picture.data[4 * pixel + 3] = 255;
      const count = result.pixels.length;
      this.albedo = new Float32Array(3 * count);
      this.specular = new Float32Array(3 * count);
      this.shininess = new Float32Array(count);
    }

    /** Paint and gloss: `albedo` is its mean, `painted` whether it varies. */
    setSurface({ albedo, specular, shininess, painted }) {
      const relative = this.result.albedo;
      for (let i = 0; i < relative.length; i++) {
        this.albedo[i] = Math.min(1, albedo * (painted ? relative[i] : 1));
      }
      this.specular.fill(specular);
      this.shininess.fill(shininess);
    }

    /** Draw under a distant light from `direction` (unit); milliseconds of layer and frame. */
    async draw(direction, irradiance) {
      const began = performance.now();
      const count = this.result.pixels.length;
      const session = await model("phong");
      const ready = performance.now();
      const { radiance } = await run(session, {
        normal: { data: this.result.normal, dims: [1, 3, 1, count] },
        albedo: { data: this.albedo, dims: [1, 3, 1, count] },
        specular: { data: this.specular, dims: [1, 3, 1, count] },
        shininess: { data: this.shininess, dims: [1, 1, 1, count] },
        source_direction: { data: Float32Array.from(direction), dims: [1, 3] },
        source_irradiance: { data: new Float32Array(3).fill(irradiance), dims: [1, 3] },
      });
      const ran = performance.now();
      this.show(radiance.data);
      return { layer: ran - ready, frame: performance.now() - began };
    }

    /** Radiance `3 x pixel` on the canvas. */
    show(radiance) {
      const { pixels } = this.result;
      const count = pixels.length;
      const out = this.picture.data;
      for (let c = 0; c < 3; c++) {
        for (let k = 0; k < count; k++) {
          const value = radiance[c * count + k];
          out[4 * pixels[k] + c] = ENCODED[value >= 1 ? STEPS : value > 0 ? Math.round(value * STEPS) : 0];
        }
      }
      this.context.putImageData(this.picture, 0, 0);
    }
  }

  /** The direction to a light that hangs over a place of the picture, x and y in -1..1. */
  function towards(x, y) {
    const length = Math.hypot(x, y);
    const most = 0.98; // a little above the horizon
    const shrink = length > most ? most / length : 1;
    const [u, v] = [x * shrink, y * shrink];
    return [u, v, Math.sqrt(1 - u * u - v * v)];
  }

  Object.assign(radiometry, { Relighting, towards });
}
