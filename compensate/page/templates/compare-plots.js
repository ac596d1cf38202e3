"use strict";
// The two plots of the compare page: luminance along a row, and the histogram of the screen. A
// curve is [picture, name of its colour in the style sheet, dash].
const domesimPlots = (() => {
  const { page, brightest, levels, luminance } = domesimLight;
  const { rows, cols } = page;
  const LEFT = 44, RIGHT = 8, TOP = 6, BOTTOM = 16; // margins, CSS pixels
  const DECADES = 5, BINS = 100;

  const topDecade = Math.ceil(Math.log10(brightest) - 1e-9);
  const logShare = (value) => Math.min(1, Math.max(0, (Math.log10(value) - topDecade) / DECADES + 1));
  const decades = Array.from({ length: DECADES + 1 }, (_, i) => String(Number(`1e${topDecade - DECADES + i}`)));

  // A cleared canvas with `x` and `y` from 0..1 to its plotting box, in CSS pixels.
  function plot(id) {
    const canvas = document.getElementById(id), pen = canvas.getContext("2d");
    const width = canvas.clientWidth, height = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
    const style = getComputedStyle(canvas);
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    pen.scale(ratio, ratio);
    pen.font = `11px ${style.fontFamily}`;
    return {
      pen,
      x: (t) => LEFT + t * (width - LEFT - RIGHT),
      y: (t) => height - BOTTOM - t * (height - BOTTOM - TOP),
      colour: (name) => style.getPropertyValue(name),
    };
  }

  function tickX({ pen, x, y, colour }, t, text) {
    pen.fillStyle = colour("--line");
    pen.fillRect(Math.round(x(t)), y(1), 1, y(0) - y(1));
    pen.fillStyle = colour("--muted");
    pen.textAlign = t > 0.97 ? "right" : t < 0.03 ? "left" : "center";
    pen.textBaseline = "top";
    pen.fillText(text, x(t), y(0) + 3);
  }

  function tickY({ pen, x, y, colour }, t, text) {
    pen.fillStyle = colour("--line");
    pen.fillRect(x(0), Math.round(y(t)), x(1) - x(0), 1);
    pen.fillStyle = colour("--muted");
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillText(text, x(0) - 4, y(t));
  }

  // `points` are [x, y] in 0..1, or null where the curve is broken (outside the screen).
  function drawCurve({ pen, x, y, colour }, points, stroke, dash) {
    pen.save();
    pen.beginPath();
    pen.rect(x(0) - 1, y(1) - 1, x(1) - x(0) + 2, y(0) - y(1) + 2);
    pen.clip();
    pen.strokeStyle = colour(stroke);
    pen.lineWidth = 1.25;
    pen.setLineDash(dash);
    pen.beginPath();
    let down = false;
    for (const point of points) {
      if (point) pen[down ? "lineTo" : "moveTo"](x(point[0]), y(point[1]));
      down = Boolean(point);
    }
    pen.stroke();
    pen.restore();
  }

  function luminanceAlong(row, picture) {
    const level = levels[picture][0];
    return Array.from({ length: cols }, (_, col) => {
      const i = row * cols + col;
      return level.alpha[i] ? luminance(level, i) : null;
    });
  }

  // `at` is the probe's { row, col }, or null; the linear axis ends at one of `steps`.
  function drawProfile(curves, at, axis, steps) {
    const to = plot("profile"), across = Math.max(1, cols - 1);
    const lines = at ? curves.map(([picture, ...look]) => [luminanceAlong(at.row, picture), ...look]) : [];
    let share = logShare;
    if (axis === "log") decades.forEach((text, i) => tickY(to, i / DECADES, text));
    else {
      const most = Math.max(0, ...lines.flatMap(([values]) => values));
      const top = steps.find((step) => step >= most) || brightest;
      share = (value) => value / top;
      for (const t of [0, 0.5, 1]) tickY(to, t, at ? String(Number((t * top).toPrecision(3))) : "");
    }
    for (const col of [0, 0.25, 0.5, 0.75].map((t) => Math.round(t * cols)).concat(cols - 1))
      tickX(to, col / across, String(col));
    for (const [values, ...look] of lines)
      drawCurve(to, values.map((value, col) => (value === null ? null : [col / across, share(value)])), ...look);
    if (!at || at.col < 0 || at.col >= cols) return;
    to.pen.fillStyle = to.colour("--muted");
    to.pen.fillRect(Math.round(to.x(at.col / across)), to.y(1), 1, to.y(0) - to.y(1));
  }

  const histograms = new Map();
  function histogramOf(picture) {
    if (!histograms.has(picture)) {
      const level = levels[picture][0], bins = new Float64Array(BINS + 1);
      for (let i = 0; i < rows * cols; i++)
        if (level.alpha[i]) bins[Math.round(logShare(luminance(level, i)) * BINS)]++;
      histograms.set(picture, bins);
    }
    return histograms.get(picture);
  }

  // `black` and `white`: the luminances (cd/m²) between which the display now tells light apart.
  function drawHistogram(curves, black, white) {
    const to = plot("histogram"), { pen, x, y } = to;
    pen.fillStyle = to.colour("--raised");
    pen.fillRect(x(logShare(black)), y(1), x(logShare(white)) - x(logShare(black)), y(0) - y(1));
    decades.forEach((text, i) => tickX(to, i / DECADES, i ? text : `≤ ${text}`));
    // What is darker than the axis gathers in the first bin and would dwarf the rest: it may run
    // off the top. The root keeps small populations (stars) in sight.
    const most = Math.max(1, ...curves.flatMap(([picture]) => [...histogramOf(picture).subarray(1)]));
    for (const [picture, ...look] of curves)
      drawCurve(to, [...histogramOf(picture)].map((count, i) => [i / BINS, Math.sqrt(count / most)]), ...look);
  }

  return { drawProfile, drawHistogram };
})();
