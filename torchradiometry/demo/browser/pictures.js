// Pictures: bounded files, decoded by the browser, as linear numbers; and shrinking them.
"use strict";
{
  const { Fault } = radiometry;

  /** Largest file and largest picture that are opened, and the longer side that is kept. */
  const MAX_BYTES = 64 * 2 ** 20;
  const MAX_PIXELS = 2 ** 26;
  const MAX_SIDE = 1024;

  /** Width and height in the header of a PNG or JPEG file; null where it is neither. */
  function storedSize(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    if (bytes.length >= 24 && view.getUint32(0) === 0x89504e47) {
      return [view.getUint32(16), view.getUint32(20)];
    }
    let at = 2;
    while (bytes[0] === 0xff && bytes[1] === 0xd8 && at + 9 <= bytes.length && bytes[at] === 0xff) {
      const marker = bytes[at + 1];
      if (marker >= 0xc0 && marker <= 0xcf && ![0xc4, 0xc8, 0xcc].includes(marker)) {
        return [view.getUint16(at + 7), view.getUint16(at + 5)];
      }
      at += marker === 0xff ? 1 : 2 + view.getUint16(at + 2);
    }
    return null;
  }

  function checkPixels(name, width, height) {
    if (width * height > MAX_PIXELS) {
      throw new Fault(`${name} has ${width} x ${height} pixels: shrink it to at most 67 million.`);
    }
  }

  /** A file as an ImageBitmap with its stored counts (no colour management, no alpha). */
  async function decode(file) {
    if (file.size > MAX_BYTES) {
      const size = (file.size / 2 ** 20).toFixed(0);
      throw new Fault(`${file.name} has ${size} MiB: pass a picture of at most 64 MiB.`);
    }
    const head = new Uint8Array(await file.slice(0, 2 ** 20).arrayBuffer());
    const size = storedSize(head);
    if (size) checkPixels(file.name, ...size);
    let bitmap;
    try {
      const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
      bitmap = await createImageBitmap(file, options);
    } catch {
      throw new Fault(`${file.name} is no picture that this browser can decode: use PNG, JPEG or WebP.`);
    }
    checkPixels(file.name, bitmap.width, bitmap.height);
    return bitmap;
  }

  /** RGBA counts of a part of a bitmap, drawn at width x height. */
  function counts(bitmap, width, height, box = null) {
    const canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext("2d", { willReadFrequently: true, alpha: false });
    context.imageSmoothingQuality = "high";
    const from = box ?? { x: 0, y: 0, width: bitmap.width, height: bitmap.height };
    context.drawImage(bitmap, from.x, from.y, from.width, from.height, 0, 0, width, height);
    return context.getImageData(0, 0, width, height);
  }

  /** A photograph of at most MAX_SIDE pixels: {name, width, height, rgba}. */
  async function readPhotograph(file, side = MAX_SIDE) {
    const bitmap = await decode(file);
    const shrink = Math.min(1, side / Math.max(bitmap.width, bitmap.height));
    const width = Math.max(1, Math.round(bitmap.width * shrink));
    const height = Math.max(1, Math.round(bitmap.height * shrink));
    const { data } = counts(bitmap, width, height);
    bitmap.close();
    return { name: file.name, width, height, rgba: data };
  }

  /** A mask (1 = object) of the given size, from a picture that is white on the object. */
  async function readMask(file, width, height) {
    const bitmap = await decode(file);
    if (Math.abs(bitmap.width / bitmap.height - width / height) > 0.02 * (width / height)) {
      const got = `${bitmap.width} x ${bitmap.height}`;
      throw new Fault(`The mask has ${got} pixels, the photograph ${width} x ${height}: make them alike.`);
    }
    const { data } = counts(bitmap, width, height);
    bitmap.close();
    const mask = brightest(data);
    if (!mask.includes(1)) throw new Fault(`${file.name} is an empty mask: paint the object white.`);
    return mask;
  }

  /** 1 where the brightest colour is above half. */
  function brightest(rgba) {
    const mask = new Uint8Array(rgba.length / 4);
    for (let i = 0; i < mask.length; i++) {
      mask[i] = Math.max(rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]) > 127.5 ? 1 : 0;
    }
    return mask;
  }

  /** Linear 0..1 of each sRGB count (IEC 61966-2-1). */
  const LINEAR = Float64Array.from({ length: 256 }, (_, v) => {
    const encoded = v / 255;
    return encoded <= 0.04045 ? encoded / 12.92 : ((encoded + 0.055) / 1.055) ** 2.4;
  });

  /** Matrix `size x old` of tent weights as rows of [first, weights]; a row sums to 1. */
  function tents(old, size) {
    const reach = Math.max(1, old / size);
    return Array.from({ length: size }, (_, row) => {
      const centre = ((row + 0.5) * old) / size - 0.5;
      const first = Math.max(0, Math.ceil(centre - reach));
      const last = Math.min(old - 1, Math.floor(centre + reach));
      const weights = [];
      for (let k = first; k <= last; k++) weights.push(Math.max(0, 1 - Math.abs(k - centre) / reach));
      const sum = weights.reduce((a, b) => a + b, 0);
      return [first, weights.map((w) => w / sum)];
    });
  }

  /** A plane `height x width` at another size: linear, averaged over the pixels that one covers. */
  function resized(plane, width, height, newWidth, newHeight) {
    const rows = tents(height, newHeight);
    const columns = tents(width, newWidth);
    const half = new Float64Array(newHeight * width);
    rows.forEach(([first, weights], y) => {
      weights.forEach((weight, k) => {
        const from = (first + k) * width;
        for (let x = 0; x < width; x++) half[y * width + x] += weight * plane[from + x];
      });
    });
    const out = new Float64Array(newHeight * newWidth);
    for (let y = 0; y < newHeight; y++) {
      columns.forEach(([first, weights], x) => {
        let sum = 0;
        for (let k = 0; k < weights.length; k++) sum += weights[k] * half[y * width + first + k];
        out[y * newWidth + x] = sum;
      });
    }
    return out;
  }

  /** The smallest box around the object, with a margin of a sixteenth of its size. */
  function boxOf(mask, width, height) {
    let [left, right, top, bottom] = [width, -1, height, -1];
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        if (!mask[y * width + x]) continue;
        left = Math.min(left, x);
        right = Math.max(right, x);
        top = Math.min(top, y);
        bottom = Math.max(bottom, y);
      }
    }
    if (right < 0) throw new Fault("The mask is empty: mark the object.");
    const span = (low, high, end) => {
      const margin = Math.floor((high - low) / 16) + 1;
      const from = Math.max(0, low - margin);
      return [from, Math.min(end, high + margin) - from];
    };
    const [x, boxWidth] = span(left, right + 1, width);
    const [y, boxHeight] = span(top, bottom + 1, height);
    return { x, y, width: boxWidth, height: boxHeight };
  }

  /** The part of a plane inside a box. */
  function cut(plane, width, box) {
    const out = new Float64Array(box.width * box.height);
    for (let y = 0; y < box.height; y++) {
      for (let x = 0; x < box.width; x++) {
        out[y * box.width + x] = plane[(box.y + y) * width + box.x + x];
      }
    }
    return out;
  }

  /** Where the object is on a grid whose longer side is at most `side`: {width, height, pixels}. */
  function gridOf(inside, box, side) {
    const shrink = Math.min(1, side / Math.max(box.width, box.height));
    const width = Math.max(1, Math.round(box.width * shrink));
    const height = Math.max(1, Math.round(box.height * shrink));
    const covered = shrink < 1 ? resized(inside, box.width, box.height, width, height) : inside;
    const pixels = [];
    covered.forEach((share, i) => { if (share >= 0.5) pixels.push(i); });
    if (!pixels.length) throw new Fault("The object in the mask is too thin: mark more of it.");
    return { width, height, pixels: Int32Array.from(pixels) };
  }

  Object.assign(radiometry, {
    LINEAR, boxOf, brightest, counts, cut, decode, gridOf, readMask, readPhotograph, resized,
  });
}
