// A folder of photographs under known distant lights, laid out as the DiLiGenT benchmark is:
// 001.png ..., mask.png, light_directions.txt, light_intensities.txt.
"use strict";
{
  const { Fault, boxOf, brightest, counts, cut, decode, gridOf } = radiometry;

  const MAX_LIGHTS = 400;
  const MAX_TEXT = 2 ** 20;
  /** How far from 1 the length of a direction may be: the rounding of printed decimals. */
  const UNIT = 0.01;

  /** Files by name; null where they are no folder of photographs under known lights. */
  function asSet(files) {
    const lights = files.filter((file) => file.name === "light_directions.txt");
    if (!lights.length) return null;
    if (lights.length > 1) throw new Fault("There are several sets in this folder: choose one of them.");
    const folder = parent(lights[0]);
    const inside = files.filter((file) => parent(file) === folder);
    const byName = Object.fromEntries(inside.map((file) => [file.name, file]));
    for (const name of ["mask.png", "light_intensities.txt"]) {
      if (!byName[name]) throw new Fault(`The folder holds no ${name}: put it beside light_directions.txt.`);
    }
    const photographs = inside.filter((file) => /^\d+\.(png|webp|jpe?g|bmp|avif)$/i.test(file.name));
    photographs.sort((a, b) => parseInt(a.name, 10) - parseInt(b.name, 10));
    if (!photographs.length) throw new Fault("The folder holds no photographs: name them 001.png, 002.png …");
    if (photographs.length > MAX_LIGHTS) throw new Fault(`The folder holds ${photographs.length} photographs: use at most ${MAX_LIGHTS}.`);
    return { photographs, byName };
  }

  /** The folder a file came from, as far as the browser tells. */
  function parent(file) {
    const path = file.path ?? file.webkitRelativePath ?? "";
    return path.slice(0, path.lastIndexOf("/") + 1);
  }

  /** Rows of numbers of a text file. */
  async function readTable(file, widths, count) {
    if (file.size > MAX_TEXT) throw new Fault(`${file.name} is larger than 1 MiB: it should hold one row a light.`);
    const lines = (await file.text()).split(/\r?\n/).map((line) => line.replace(/#.*/, "").trim());
    const rows = lines.filter(Boolean).map((line) => line.split(/[\s,]+/).map(Number));
    if (!rows.every((row) => widths.includes(row.length) && row.every(Number.isFinite))) {
      throw new Fault(`${file.name} is no table: write rows of ${widths.join(" or ")} numbers.`);
    }
    if (rows.length !== count) {
      throw new Fault(`${file.name} has ${rows.length} rows for ${count} photographs: give one row to each.`);
    }
    return rows;
  }

  /** Directions `light x 3`, unit. */
  async function readDirections(file, count) {
    const rows = await readTable(file, [3], count);
    if (rows.length < 3) throw new Fault(`${file.name} has ${rows.length} lights: use at least three.`);
    return rows.map((row, i) => {
      const length = Math.hypot(...row);
      if (Math.abs(length - 1) > UNIT) {
        throw new Fault(`Row ${i + 1} of ${file.name} has the length ${length.toPrecision(4)}: divide it by its length.`);
      }
      return row.map((v) => v / length);
    });
  }

  /** Intensities `light x 3`, positive. */
  async function readIntensities(file, count) {
    const rows = await readTable(file, [1, 3], count);
    if (rows.some((row) => row.some((v) => v <= 0))) throw new Fault(`${file.name} holds a value of 0 or less: intensities are positive.`);
    return rows.map((row) => (row.length === 1 ? [row[0], row[0], row[0]] : row));
  }

  /**
   * Read a set on a grid whose longer side is at most `side`.
   *
   * Returns {grid, directions, colours, first}: `colours[i]` the stored counts of photograph i at
   * the pixels of the grid (3 a pixel), divided by its light; `first` a picture to show.
   */
  async function readSet({ photographs, byName }, side, report, going) {
    const directions = await readDirections(byName["light_directions.txt"], photographs.length);
    const intensities = await readIntensities(byName["light_intensities.txt"], photographs.length);
    const maskBitmap = await decode(byName["mask.png"]);
    const { width, height } = maskBitmap;
    const mask = brightest(counts(maskBitmap, width, height).data);
    if (!mask.includes(1)) throw new Fault("mask.png is an empty mask: paint the object white.");
    const box = boxOf(mask, width, height);
    const grid = gridOf(cut(mask, width, box), box, side);
    const colours = [];
    let first = null;
    for (const [i, file] of photographs.entries()) {
      if (!going()) return null;
      report(`Reading ${file.name}, ${i + 1} of ${photographs.length} …`, i / photographs.length);
      const bitmap = await decode(file);
      if (bitmap.width !== width || bitmap.height !== height) {
        throw new Fault(`${file.name} has ${bitmap.width} x ${bitmap.height} pixels where the mask has ${width} x ${height}: make them alike.`);
      }
      const picture = counts(bitmap, grid.width, grid.height, box);
      bitmap.close();
      colours.push(perLight(picture.data, grid.pixels, intensities[i]));
      if (i === Math.floor(photographs.length / 2)) first = encoded(picture);
    }
    return { grid, directions, colours, first };
  }

  /** Linear counts as sRGB ones, for the eye. */
  function encoded(picture) {
    const data = picture.data.map((v, i) => {
      const linear = v / 255;
      if (i % 4 === 3) return v;
      return 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
    });
    return new ImageData(data, picture.width, picture.height);
  }

  /** I = (v + 1/2) / 256 / E at each pixel and colour. */
  function perLight(rgba, pixels, intensity) {
    const out = new Float32Array(3 * pixels.length);
    pixels.forEach((pixel, k) => {
      for (let c = 0; c < 3; c++) out[3 * k + c] = (rgba[4 * pixel + c] + 0.5) / 256 / intensity[c];
    });
    return out;
  }

  Object.assign(radiometry, { asSet, readSet });
}
