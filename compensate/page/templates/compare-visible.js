"use strict";
// Maps of what is seen of the differences from the master: codes -> just-noticeable differences
// (JND), and their colours. Black is below the line, cividis from 1 to `MOST` JND above it.
const domesimVisible = (() => {
  const { page, differences, ramps, RAMP } = domesimLight;
  const { maps } = page;
  const LINES = [1, 2, 5, 10, 20, 50, 100]; // JND
  const MOST = 512, BELOW = [22, 22, 22], LINE = [255, 255, 255], NONE = [62, 62, 62];
  const jnd = Float64Array.from({ length: 256 }, (_, c) => (c && maps ? maps.least * 2 ** ((c - 1) / maps.perOctave) : 0));
  const jodOf = (value) => maps.jod * (maps.still * value) ** maps.exponent;
  const share = (value) => Math.log(value) / Math.log(MOST); // of the scale

  const has = (view, eye) => page.views[view].kind === "master" || differences.has(`${view} ${eye}`);

  // Fills RGB of a picture as large as a map; the line is drawn where neighbours lie on its two sides.
  function fill(view, eye, line, pixels) {
    const codes = differences.get(`${view} ${eye}`), { cols } = maps;
    const plain = page.views[view].kind === "master" ? BELOW : NONE;
    const colours = Array.from(jnd, (value) =>
      value < line ? BELOW : ramps.magnitude[Math.round(Math.min(1, Math.max(0, share(value))) * (RAMP - 1))]);
    for (let i = 0; i < maps.rows * cols; i++) {
      let colour = plain;
      if (codes) {
        const above = jnd[codes[i]] >= line;
        const edge = (other, there) => there && codes[other] && (jnd[codes[other]] >= line) !== above;
        colour = above && codes[i] && (edge(i + 1, (i + 1) % cols) || edge(i - 1, i % cols) || edge(i + cols, true) || edge(i - cols, true))
          ? LINE : colours[codes[i]];
      }
      for (let c = 0; c < 3; c++) pixels[4 * i + c] = colour[c];
    }
  }

  // Share of the screen above the line.
  function above(view, eye, line, alpha) {
    const codes = differences.get(`${view} ${eye}`);
    if (!codes) return null;
    let count = 0, found = 0;
    for (let i = 0; i < codes.length; i++) {
      if (!alpha[i]) continue;
      count++;
      found += jnd[codes[i]] >= line;
    }
    return found / count;
  }

  // At a pixel of the picture: JND, or null without a map.
  function at(view, eye, row, col) {
    const codes = differences.get(`${view} ${eye}`);
    if (!codes) return null;
    return jnd[codes[Math.floor((row * maps.rows) / page.rows) * maps.cols + Math.floor((col * maps.cols) / page.cols)]];
  }

  return { maps, LINES, MOST, share, jodOf, has, fill, above, at };
})();
