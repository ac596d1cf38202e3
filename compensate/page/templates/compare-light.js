"use strict";
// The light of the compare page: payload -> codes of its cube root -> levels of halved size, and the
// colour maps for differences. compare.js shows it.
const domesimLight = (() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const { rows, cols } = page;
  const brightest = page.white * page.peak; // cd/m² of the top code
  const LUMA = [0.2126, 0.7152, 0.0722]; // BT.709

  const { top, tile } = page;
  const nits = Float64Array.from({ length: top + 1 }, (_, v) => brightest * (v / top) ** page.power);
  const codeOf = (value) => Math.min(top, Math.round(top * (value / brightest) ** (1 / page.power)));

  async function inflate(node) {
    const text = atob(node.textContent.trim());
    node.remove();
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(plain).arrayBuffer();
  }

  // Between the tiles' centres; beyond the outermost it is theirs. Fills `line` with a row.
  function interpolate(grid, start, row, line) {
    const down = Math.ceil(rows / tile), across = Math.ceil(cols / tile);
    const place = (pixel, last) => {
      const at = Math.min(last, Math.max(0, (pixel + 0.5) / tile - 0.5));
      const before = Math.min(Math.floor(at), Math.max(last - 1, 0));
      return [before, Math.min(before + 1, last), at - before];
    };
    const [above, below, part] = place(row, down - 1);
    const values = Float64Array.from({ length: across }, (_, k) =>
      grid[start + above * across + k] * (1 - part) + grid[start + below * across + k] * part);
    for (let col = 0; col < cols; col++) {
      const [left, right, share] = place(col, across - 1);
      line[col] = values[left] * (1 - share) + values[right] * share;
    }
  }

  // As compensate/page/packing.py writes: coefficients of the prediction, then what is off it.
  function decode(buffer, bases, alpha) {
    const plane = rows * cols, tiles = Math.ceil(rows / tile) * Math.ceil(cols / tile);
    const grids = bases.length ? 3 * (bases.length + 1) * tiles : 0, start = 4 * (grids + 3);
    const numbers = new Float32Array(buffer, 0, grids + 3);
    const small = new Uint8Array(buffer, start, 3 * plane);
    const large = new Uint32Array(buffer.slice(start + 3 * plane));
    const codes = new Uint16Array(3 * plane), off = new Int32Array(3 * plane);
    for (let i = 0, next = 0, value = 0; i < off.length; i++) {
      if (i % cols === 0) value = 0;
      const folded = small[i] < 255 ? small[i] : 255 + large[next++];
      off[i] = value += folded & 1 ? -((folded + 1) >> 1) : folded >> 1;
    }
    if (!bases.length) {
      for (let i = 0; i < plane; i++) {
        codes[plane + i] = off[plane + i];
        codes[i] = off[plane + i] + off[i];
        codes[2 * plane + i] = off[plane + i] + off[2 * plane + i];
      }
      return codes;
    }
    const unit = Float64Array.from({ length: top + 1 }, (_, v) => page.peak * (v / top) ** page.power);
    const known = bases.map((base) => levels[base][0].codes);
    const lines = Array.from({ length: bases.length + 1 }, () => new Float64Array(cols));
    for (let primary = 0; primary < 3; primary++) {
      const least = numbers[grids + primary];
      for (let row = 0; row < rows; row++) {
        lines.forEach((line, k) => interpolate(numbers, (primary * lines.length + k) * tiles, row, line));
        for (let col = 0, i = primary * plane + row * cols; col < cols; col++, i++) {
          if (!alpha[row * cols + col]) continue;
          let light = 0;
          for (let k = 0; k < known.length; k++) light += lines[k][col] * unit[known[k][i]];
          light = Math.max(light + lines[known.length][col], least, 0);
          codes[i] = Math.min(top, Math.floor(top * Math.cbrt(light / page.peak) + 0.5)) + off[i];
        }
      }
    }
    return codes;
  }

  const differences = new Map(); // "view eye" -> codes of a map of visible differences
  const levels = []; // levels[picture][k]: the picture at 1/2^k of its size
  async function read(progress) {
    const packed = new Uint8Array(await inflate(document.querySelector("[data-payload=mask]")));
    const alpha = new Uint8Array(rows * cols);
    for (let i = 0; i < alpha.length; i++) alpha[i] = packed[i >> 3] & (128 >> (i & 7)) ? 255 : 0;
    for (const node of document.querySelectorAll("[data-payload=picture]")) {
      const number = Number(node.dataset.picture);
      progress(number + 1);
      const codes = decode(await inflate(node), page.bases[number], alpha);
      levels[number] = [{ rows, cols, codes, alpha }];
    }
    const { maps } = page;
    for (const node of document.querySelectorAll("[data-payload=map]")) {
      const codes = new Uint8Array(await inflate(node));
      for (let i = 0; i < codes.length; i++) if (i % maps.cols) codes[i] += codes[i - 1];
      differences.set(`${node.dataset.view} ${node.dataset.eye}`, codes);
    }
  }

  // Halve a level by averaging light, not codes, over what is on the screen: averaged codes would
  // dim every star.
  function halve(from) {
    const to = { rows: (from.rows + 1) >> 1, cols: (from.cols + 1) >> 1 };
    const size = to.rows * to.cols;
    to.codes = new Uint16Array(3 * size);
    to.alpha = new Uint8Array(size);
    const plane = from.rows * from.cols;
    for (let row = 0, out = 0; row < to.rows; row++) {
      for (let col = 0; col < to.cols; col++, out++) {
        let weight = 0, r = 0, g = 0, b = 0;
        for (let y = 2 * row; y < Math.min(2 * row + 2, from.rows); y++)
          for (let x = 2 * col; x < Math.min(2 * col + 2, from.cols); x++) {
            const i = y * from.cols + x, a = from.alpha[i];
            weight += a;
            r += a * nits[from.codes[i]];
            g += a * nits[from.codes[plane + i]];
            b += a * nits[from.codes[2 * plane + i]];
          }
        to.alpha[out] = Math.round(weight / 4);
        if (!weight) continue;
        to.codes[out] = codeOf(r / weight);
        to.codes[size + out] = codeOf(g / weight);
        to.codes[2 * size + out] = codeOf(b / weight);
      }
    }
    return to;
  }

  function levelOf(picture, k) {
    while (levels[picture].length <= k) levels[picture].push(halve(levels[picture].at(-1)));
    return levels[picture][k];
  }

  function luminance(level, i) {
    const plane = level.rows * level.cols, { codes } = level;
    return LUMA[0] * nits[codes[i]] + LUMA[1] * nits[codes[plane + i]] + LUMA[2] * nits[codes[2 * plane + i]];
  }

  // Both maps are perceptually uniform. Size: cividis, in d3-scale-chromatic's polynomial. Signed:
  // from grey, OKLab lightness rises alike to both sides, blue for darker, orange for brighter.
  function cividis(t) {
    return [
      -4.54 - t * (35.34 - t * (2381.73 - t * (6402.7 - t * (7024.72 - t * 2710.57)))),
      32.49 + t * (170.73 + t * (52.82 - t * (131.46 - t * (176.58 - t * 67.37)))),
      81.24 + t * (442.36 - t * (2482.43 - t * (6167.24 - t * (6614.94 - t * 2475.67)))),
    ].map((value) => Math.min(255, Math.max(0, Math.round(value))));
  }

  function oklab(lightness, chroma, hue) {
    const a = chroma * Math.cos(hue), b = chroma * Math.sin(hue);
    const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
    const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
    const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
    return [
      4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
      -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
      -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
    ];
  }

  function signedColour(t) {
    const lightness = 0.3 + 0.52 * Math.abs(t), hue = ((t < 0 ? 245 : 65) * Math.PI) / 180;
    let chroma = 0.16 * Math.min(1, 2.5 * Math.abs(t)), rgb = oklab(lightness, chroma, hue);
    while (chroma > 0 && rgb.some((v) => v < 0 || v > 1)) rgb = oklab(lightness, (chroma -= 0.004), hue);
    return rgb.map((v) => {
      const x = Math.min(1, Math.max(0, v));
      return Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
    });
  }

  const RAMP = 511; // odd: zero has an entry of its own
  const ramps = {
    signed: Array.from({ length: RAMP }, (_, i) => signedColour((2 * i) / (RAMP - 1) - 1)),
    magnitude: Array.from({ length: RAMP }, (_, i) => cividis(i / (RAMP - 1))),
  };

  return { page, brightest, LUMA, nits, codeOf, levels, differences, read, levelOf, luminance, RAMP, ramps };
})();
