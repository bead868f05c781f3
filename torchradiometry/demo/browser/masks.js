// Which pixels are the object: a threshold on the difference from the background, or a mask file,
// and on top of either what the brush added (1) or erased (-1).
"use strict";
{
  /** The median of each colour along the border. */
  function background({ width, height, rgba }) {
    const border = [];
    for (let x = 0; x < width; x++) border.push(x, (height - 1) * width + x);
    for (let y = 0; y < height; y++) border.push(y * width, y * width + width - 1);
    return [0, 1, 2].map((c) => {
      const values = border.map((i) => rgba[4 * i + c]).sort((a, b) => a - b);
      return values[values.length >> 1];
    });
  }

  class Mask {
    /** `fixed` is a mask from a file, or null to use the threshold. */
    constructor(photograph, fixed = null) {
      this.photograph = photograph;
      this.fixed = fixed;
      this.threshold = 12;
      this.brushed = new Int8Array(photograph.width * photograph.height);
      this.back = background(photograph);
    }

    /** 1 on the object, by threshold (0..100, in percent of full scale) or file, and brush. */
    values() {
      const { rgba } = this.photograph;
      const limit = 2.55 * this.threshold;
      return this.brushed.map((stroke, i) => {
        if (stroke) return stroke > 0 ? 1 : 0;
        if (this.fixed) return this.fixed[i];
        const far = Math.max(
          Math.abs(rgba[4 * i] - this.back[0]),
          Math.abs(rgba[4 * i + 1] - this.back[1]),
          Math.abs(rgba[4 * i + 2] - this.back[2]),
        );
        return far > limit ? 1 : 0;
      });
    }

    /** A stroke from one point to another, in pixels; sign 1 adds, -1 erases. */
    stroke(from, to, radius, sign) {
      const { width, height } = this.photograph;
      const steps = Math.ceil(Math.hypot(to.x - from.x, to.y - from.y) / Math.max(1, radius / 2)) + 1;
      for (let k = 0; k <= steps; k++) {
        const cx = from.x + ((to.x - from.x) * k) / steps;
        const cy = from.y + ((to.y - from.y) * k) / steps;
        for (let y = Math.max(0, Math.floor(cy - radius)); y <= Math.min(height - 1, cy + radius); y++) {
          for (let x = Math.max(0, Math.floor(cx - radius)); x <= Math.min(width - 1, cx + radius); x++) {
            if ((x - cx) ** 2 + (y - cy) ** 2 <= radius ** 2) this.brushed[y * width + x] = sign;
          }
        }
      }
    }

    forgetBrush() {
      this.brushed.fill(0);
    }
  }

  /** The photograph with a veil over what is not the object. */
  function drawMask(canvas, photograph, mask) {
    const { width, height, rgba } = photograph;
    canvas.width = width;
    canvas.height = height;
    const picture = new ImageData(width, height);
    for (let i = 0; i < mask.length; i++) {
      const stripe = ((i % width) + Math.floor(i / width)) % 8 < 2 ? 60 : 0;
      for (let c = 0; c < 3; c++) {
        const seen = rgba[4 * i + c];
        picture.data[4 * i + c] = mask[i] ? seen : 0.45 * seen + [28, 60, 110][c] + stripe * 0.4;
      }
      picture.data[4 * i + 3] = 255;
    }
    canvas.getContext("2d").putImageData(picture, 0, 0);
  }

  Object.assign(radiometry, { Mask, drawMask });
}
