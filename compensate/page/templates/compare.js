"use strict";
// The viewer of the compare page. The data's way: codes of light (compare-light.js) -> exposure and display
// encoding, one table of all codes -> 8-bit canvas per picture -> placed in cells on the picture, or on
// the dome (compare-dome.js). A view has one picture, or one for each eye (compare-stereo.js).
// Everything on screen follows from `state`; handlers change it and call `draw`.
(() => {
  const byId = (id) => document.getElementById(id);
  const all = (selector) => [...document.querySelectorAll(selector)];
  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

  const { page, brightest, LUMA, nits, codeOf, levels, levelOf, luminance, RAMP, ramps } = domesimLight;
  const { PLAIN, pictureOf, anaglyph, ghost, meanResidual } = domesimStereo;
  const { drawProfile, drawHistogram } = domesimPlots;
  const visible = domesimVisible, theatre = domesimDome;
  const { rows, cols, white, views, stereo } = page;
  const pictures = stereo ? 2 * views.length : views.length;
  const NEUTRAL = { exposure: 0, gamma: "sRGB" };
  const MAX_ZOOM = 64;
  const LEAST_STOPS = -8;
  const HOLD_MS = 350; // a press longer than this was a look, not a flip

  const master = views.findIndex((view) => view.kind === "master");
  const seen = views.map((view, i) => (view.kind === "seen" ? i : -1)).filter((i) => i >= 0);
  const state = {
    mode: "split",
    a: seen.length > 1 ? seen[0] : 0,
    b: seen.length ? seen[seen.length - 1] : views.length - 1,
    shown: 0, // in flip mode
    split: 0.5, // of the picture's width
    fit: true,
    zoom: 1, // device pixels per picture pixel
    centre: { row: rows / 2, col: cols / 2 },
    ...NEUTRAL,
    darkRoom: false,
    area: 1,
    probe: null, // { row, col }
    pinned: false,
    signed: true,
    scaleStep: 0,
    scaleAuto: true,
    axis: "log",
    eye: "left", // left, right, both, difference, anaglyph, wiggle or ghost
    phase: "left", // the wiggle's eye
    playing: false, // the wiggle
    rate: 4, // of the wiggle, pictures a second
    ghostOf: "both",
    ghostGain: 4, // stops, on top of the exposure
    layer: "light", // or visible: maps of what is seen of the differences
    line: 1, // their threshold line, JND
    place: "flat", // or dome: seen from a seat
    seat: theatre ? Math.max(0, theatre.seats.findIndex(({ name }) => name === "centre")) : 0,
    look: null, // { turn, rise, field }, degrees
    displayWhite: 200, // of the reader's display, cd/m²
    presenting: false,
  };
  if (theatre) state.look = theatre.facing(state.seat);
  const inDome = () => state.place === "dome";
  state.shown = state.a;
  const reference = () => (master >= 0 ? master : state.a);

  // ---------------------------------------------------------------- from light to display codes

  function encode(light) {
    if (state.gamma !== "sRGB") return light ** (1 / Number(state.gamma));
    return light <= 0.0031308 ? 12.92 * light : 1.055 * light ** (1 / 2.4) - 0.055;
  }

  const table = { key: "", codes: new Uint8Array(page.top + 1) };
  function displayTable() {
    const key = `${state.exposure} ${state.gamma}`;
    if (table.key !== key) {
      const gain = 2 ** state.exposure / white;
      for (let v = 0; v <= page.top; v++) table.codes[v] = Math.round(255 * encode(Math.min(1, gain * nits[v])));
      table.key = key;
    }
    return table;
  }

  const painted = new Map(); // "view/level" -> { key, canvas }
  function paint(name, key, level, fill) {
    let entry = painted.get(name);
    if (!entry) {
      const canvas = document.createElement("canvas");
      canvas.width = level.cols;
      canvas.height = level.rows;
      painted.set(name, (entry = { key: null, canvas }));
    }
    if (entry.key !== key) {
      const context = entry.canvas.getContext("2d", { willReadFrequently: true });
      const image = context.createImageData(level.cols, level.rows);
      fill(image.data);
      for (let i = 0; i < level.alpha.length; i++) image.data[4 * i + 3] = level.alpha[i];
      context.putImageData(image, 0, 0);
      entry.key = entry.canvas.painted = key;
    }
    return entry.canvas;
  }

  function paintPicture(picture, k) {
    const level = levelOf(picture, k), { key, codes: display } = displayTable();
    return paint(`${picture}/${k}`, key, level, (pixels) => {
      const size = level.rows * level.cols, { codes } = level;
      for (let i = 0; i < size; i++) {
        pixels[4 * i] = display[codes[i]];
        pixels[4 * i + 1] = display[codes[size + i]];
        pixels[4 * i + 2] = display[codes[2 * size + i]];
      }
    });
  }

  // `lightAt` puts a pixel's linear light, cd/m², into its second argument.
  function paintLight(name, level, gainStops, lightAt) {
    const gain = 2 ** (state.exposure + gainStops) / white, light = [0, 0, 0];
    return paint(name, `${displayTable().key} ${gainStops}`, level, (pixels) => {
      for (let i = 0; i < level.alpha.length; i++) {
        lightAt(i, light);
        for (let c = 0; c < 3; c++) pixels[4 * i + c] = Math.round(255 * encode(clamp(gain * light[c], 0, 1)));
      }
    });
  }

  let mapAlpha = null; // of the screen, at the maps' size
  function paintVisible(view, eye) {
    const { maps } = visible, { alpha } = levels[0][0];
    mapAlpha ||= Uint8Array.from({ length: maps.rows * maps.cols }, (_, i) =>
      alpha[Math.floor((Math.floor(i / maps.cols) * rows) / maps.rows) * cols + Math.floor(((i % maps.cols) * cols) / maps.cols)]);
    const canvas = paint(`visible/${view}/${eye}`, String(state.line), { ...maps, alpha: mapAlpha },
      (pixels) => visible.fill(view, eye, state.line, pixels));
    canvas.whole = true;
    return canvas;
  }

  function paintView(view, eye, k) {
    if (state.layer === "visible") return paintVisible(view, eye);
    const at = (of, which) => levelOf(pictureOf(of, which), k);
    const left = at(view, "left"), right = stereo && at(view, "right"), shown = at(view, eye);
    if (state.eye === "difference") return paintDifference(`eyes/${view}/${k}`, left, right);
    if (state.eye === "anaglyph")
      return paintLight(`anaglyph/${view}/${k}`, left, 0, (i, light) => anaglyph(left, right, i, light));
    if (state.eye === "ghost") {
      const wanted = at(reference(), eye);
      return paintLight(`ghost/${view}/${reference()}/${eye}/${k}`, shown, state.ghostGain,
        (i, light) => ghost(shown, wanted, i, light));
    }
    return paintPicture(pictureOf(view, eye), k);
  }

  // ---------------------------------------------------------------- difference

  const steps = []; // 1, 2, 5, 10, ... cd/m²
  for (let e = Math.floor(Math.log10(white)) - 5; e < 5; e++)
    for (const digit of [1, 2, 5]) if (digit * 10 ** e <= 2 * brightest) steps.push(Number(`${digit}e${e}`));

  function differenceAt(level, other, i) {
    return luminance(level, i) - luminance(other, i);
  }

  // The two pictures that the scale is made for. Between the eyes it is the reference's: all views
  // get one scale.
  function pictureDifference() {
    if (state.eye === "difference") return [pictureOf(reference(), "left"), pictureOf(reference(), "right")];
    return [pictureOf(state.b, plottedEye()), pictureOf(reference(), plottedEye())];
  }

  // The smallest step that holds 95 % of the picture; a quarter-size level is enough to tell.
  let automatic = { key: "", step: 0 };
  function automaticStep() {
    const [one, other] = pictureDifference(), key = `${one} ${other}`;
    if (automatic.key === key) return automatic.step;
    const b = levelOf(one, 2), m = levelOf(other, 2), sizes = [];
    for (let i = 0; i < b.alpha.length; i++) if (b.alpha[i]) sizes.push(Math.abs(differenceAt(b, m, i)));
    const most = quantile(Float64Array.from(sizes), 0.95);
    const step = steps.findIndex((value) => value >= most);
    automatic = { key, step: step < 0 ? steps.length - 1 : step };
    return automatic.step;
  }

  function paintFromReference(eye, k) {
    const b = pictureOf(state.b, eye), wanted = pictureOf(reference(), eye);
    return paintDifference(`${b}-${wanted}/${k}`, levelOf(b, k), levelOf(wanted, k));
  }

  function quantile(values, share) {
    return values.length ? values.sort()[Math.min(values.length - 1, Math.floor(share * values.length))] : 0;
  }

  function paintDifference(name, level, other) {
    const { signed } = state, scale = steps[state.scaleStep];
    const ramp = signed ? ramps.signed : ramps.magnitude;
    return paint(name, `${signed} ${scale}`, level, (pixels) => {
      for (let i = 0; i < level.alpha.length; i++) {
        const t = differenceAt(level, other, i) / scale;
        const at = signed ? (t + 1) / 2 : Math.abs(t);
        const colour = ramp[Math.round(clamp(at, 0, 1) * (RAMP - 1))];
        pixels[4 * i] = colour[0];
        pixels[4 * i + 1] = colour[1];
        pixels[4 * i + 2] = colour[2];
      }
    });
  }

  // ---------------------------------------------------------------- where things are

  const picture = byId("picture"), frame = byId("frame");
  const context = picture.getContext("2d");
  let domeView = theatre && theatre.renderer(byId("dome"));
  const ratio = () => window.devicePixelRatio || 1;
  const GAP = 4, LABEL = 22; // CSS pixels of the grid

  // The eyes that are shown beside each other. What is made of both eyes counts as the left's.
  function eyesShown() {
    const eye = { wiggle: state.phase, ghost: state.ghostOf }[state.eye] || state.eye;
    return eye === "both" ? ["left", "right"] : [eye === "right" ? "right" : "left"];
  }
  const plottedEye = () => (state.eye === "wiggle" ? "left" : eyesShown()[0]);

  // Cells of the picture in device pixels: one for each view of the grid, and for each eye shown.
  function cells() {
    const { width, height } = picture, eyes = eyesShown(), grid = state.mode === "grid";
    if (!grid && eyes.length === 1) return [{ view: state.shown, eye: eyes[0], x: 0, y: 0, w: width, h: height }];
    const gap = Math.round(GAP * ratio()), label = Math.round(LABEL * ratio());
    const tiles = grid ? views.map((_, view) => view) : [state.shown];
    let best = null;
    for (let across = 1; across <= tiles.length; across++) {
      const down = Math.ceil(tiles.length / across), columns = across * eyes.length;
      const w = Math.floor((width - gap * (columns - 1)) / columns);
      const room = Math.floor((height - gap * (down - 1)) / down);
      const h = grid ? Math.min(room, Math.ceil((w * rows) / cols) + label) : room; // no gap below the names
      const scale = Math.min(w / cols, (h - label) / rows), top = Math.floor((room - h) * down / 2);
      if (!best || scale > best.scale) best = { scale, across, w, h, top };
    }
    return tiles.flatMap((view, tile) => eyes.map((eye, side) => ({
      view,
      eye,
      x: ((tile % best.across) * eyes.length + side) * (best.w + gap),
      y: best.top + Math.floor(tile / best.across) * (best.h + gap) + label,
      w: best.w,
      h: best.h - label,
    })));
  }

  const fitZoom = (cell) => Math.max(1 / 64, 0.985 * Math.min(cell.w / cols, cell.h / rows));

  // The picture's top left corner on the canvas, on whole pixels: at 1:1 nothing is resampled.
  function origin(cell) {
    return {
      x: Math.round(cell.x + cell.w / 2 - state.centre.col * state.zoom),
      y: Math.round(cell.y + cell.h / 2 - state.centre.row * state.zoom),
    };
  }

  function toDevice(event) {
    const box = picture.getBoundingClientRect();
    return { x: (event.clientX - box.left) * ratio(), y: (event.clientY - box.top) * ratio() };
  }

  // Where the middle of a picture's pixel is on the canvas, or null if that is behind the reader.
  function placeIn(cell, row, col) {
    if (!inDome()) {
      const { x, y } = origin(cell);
      return { x: x + (col + 0.5) * state.zoom, y: y + (row + 0.5) * state.zoom };
    }
    const at = theatre.placeOf(theatre.seats[state.seat].eye, state.look, row + 0.5, col + 0.5, cell.w, cell.h);
    return at && { x: cell.x + at.x, y: cell.y + at.y };
  }

  function cellAt(point) {
    const inside = (c) => point.x >= c.x && point.x < c.x + c.w && point.y >= c.y && point.y < c.y + c.h;
    return cells().find(inside) || cells()[0];
  }

  function toPicture(point, cell = cellAt(point)) {
    if (inDome()) {
      const ray = theatre.rayAt(state.look, point.x - cell.x, point.y - cell.y, cell.w, cell.h);
      return theatre.pictureAt(theatre.seats[state.seat].eye, ray);
    }
    const { x, y } = origin(cell);
    return { row: (point.y - y) / state.zoom, col: (point.x - x) / state.zoom };
  }

  function settleZoom() {
    const cell = cells()[0];
    if (state.fit) {
      state.zoom = fitZoom(cell);
      state.centre = { row: rows / 2, col: cols / 2 };
    }
    state.zoom = clamp(state.zoom, Math.min(1, fitZoom(cell)) / 2, MAX_ZOOM);
    state.centre.row = clamp(state.centre.row, 0, rows);
    state.centre.col = clamp(state.centre.col, 0, cols);
  }

  // Zoom so that the picture's point below `point` stays there.
  function zoomTo(zoom, point = null) {
    if (inDome()) return narrow(state.zoom / zoom);
    const cell = point ? cellAt(point) : cells()[0];
    const at = point || { x: cell.x + cell.w / 2, y: cell.y + cell.h / 2 };
    const held = toPicture(at, cell);
    state.fit = false;
    state.zoom = zoom;
    settleZoom();
    state.centre.col = held.col - (at.x - cell.x - cell.w / 2) / state.zoom;
    state.centre.row = held.row - (at.y - cell.y - cell.h / 2) / state.zoom;
    draw();
  }

  function fit() {
    state.fit = true;
    if (inDome()) state.look = theatre.facing(state.seat);
    draw();
  }

  // Another direction, and a wider or narrower field, from the seat; degrees.
  function lookAround(right, up, wider = 1) {
    const { turn, rise, field } = state.look;
    state.look = {
      turn: ((turn + right + 540) % 360) - 180,
      rise: clamp(rise + up, -89.9, 89.9),
      field: clamp(field * wider, theatre.NEAR, theatre.WIDE),
    };
    draw();
  }
  const narrow = (factor) => lookAround(0, 0, factor);

  // ---------------------------------------------------------------- drawing

  let pending = false;
  function draw() {
    if (pending || !levels.length) return;
    pending = true;
    requestAnimationFrame(() => {
      pending = false;
      drawNow();
    });
  }

  function drawNow() {
    if (levels.length < pictures) return;
    settleZoom();
    if (state.scaleAuto) state.scaleStep = automaticStep();
    drawPicture();
    drawControls();
    drawReadings();
  }

  function drawPicture() {
    context.clearRect(0, 0, picture.width, picture.height);
    if (inDome()) domeView.clear();
    cells().forEach((cell, number) => {
      if (state.mode === "split") drawSplit(cell, number > 0);
      else place(cell, cell, painterOf(cell));
      markProbe(cell);
    });
  }

  const painterOf = (cell) => (k) =>
    state.mode === "difference" ? paintFromReference(cell.eye, k) : paintView(cell.view, cell.eye, k);

  // The first cell's line is the handle; the second eye's is drawn.
  function drawSplit(cell, drawLine) {
    const cut = Math.round(state.split * cell.w);
    place(cell, { ...cell, w: cut }, (k) => paintView(state.a, cell.eye, k));
    place(cell, { ...cell, x: cell.x + cut, w: cell.w - cut }, (k) => paintView(state.b, cell.eye, k));
    if (!drawLine) return;
    context.fillStyle = getComputedStyle(picture).getPropertyValue("--strong");
    context.fillRect(cell.x + cut, cell.y, ratio(), cell.h);
  }

  // Put a painted view into `cell`, as far as it lies in `part`.
  function place(cell, part, painter) {
    if (inDome()) return placeOnDome(cell, part, painter(0));
    const k = state.zoom < 1 ? Math.min(6, Math.floor(Math.log2(1 / state.zoom) + 1e-6)) : 0;
    const canvas = painter(k), { x, y } = origin(cell), scale = state.zoom * 2 ** k;
    const [wide, high] = canvas.whole ? [cols * state.zoom, rows * state.zoom] : [canvas.width * scale, canvas.height * scale];
    context.save();
    context.beginPath();
    context.rect(part.x, part.y, part.w, part.h);
    context.clip();
    context.imageSmoothingEnabled = state.zoom < 2 && scale !== 1;
    context.imageSmoothingQuality = "high";
    context.drawImage(canvas, x, y, wide, high);
    context.restore();
  }

  function placeOnDome(cell, part, canvas) {
    const box = ({ x, y, w, h }) => [Math.round(x), Math.round(picture.height - y - h), Math.round(w), Math.round(h)];
    const matrix = theatre.basis(state.look, cell.w, cell.h);
    domeView.draw(canvas, canvas.painted, theatre.seats[state.seat].eye, matrix, box(cell), box(part));
  }

  function markProbe(cell) {
    if (!state.probe || !(state.pinned || cells().length > 1)) return;
    const { row, col } = state.probe, unit = ratio(), at = placeIn(cell, row, col);
    if (!at) return;
    const half = inDome() ? 4 * unit : Math.max((state.area / 2) * state.zoom, 4 * unit), { x: px, y: py } = at;
    context.save();
    context.beginPath();
    context.rect(cell.x, cell.y, cell.w, cell.h);
    context.clip();
    for (const [colour, width] of [["rgb(0 0 0 / .7)", 3], ["rgb(255 255 255 / .9)", 1]]) {
      context.strokeStyle = colour;
      context.lineWidth = width * unit;
      context.strokeRect(px - half, py - half, 2 * half, 2 * half);
    }
    context.fillStyle = "rgb(255 255 255 / .22)"; // the row of the profile
    if (state.pinned && !inDome()) {
      const line = Math.round(py);
      context.fillRect(cell.x, line, Math.max(0, px - half - cell.x), unit);
      context.fillRect(px + half, line, Math.max(0, cell.x + cell.w - px - half), unit);
    }
    context.restore();
  }

  function make(element, className, text) {
    return Object.assign(document.createElement(element), { className, textContent: text });
  }

  function label(view, tag = "", eye = "") {
    const node = make("span", "label", "");
    if (tag) node.append(make("b", `tag-${tag.toLowerCase()}`, tag));
    node.append(make("span", "number", view + 1), make("span", "name", views[view].name));
    if (eye) node.append(make("span", "eye", eye));
    return node;
  }

  function eyeText(eye) {
    if (!stereo) return "";
    if (state.layer === "visible") return `${eye} eye`;
    const made = { difference: "left minus right", anaglyph: "anaglyph", ghost: `ghost only, ${eye} eye` };
    return made[state.eye] || (state.playing ? "wiggle" : `${eye} eye`);
  }
  const tagOf = (view) => (view === state.a ? "A" : view === state.b ? "B" : "");

  let labelled = "";
  function drawLabels() {
    const strip = byId("labels"), grid = [];
    strip.style.setProperty("--split", `${100 * state.split}%`);
    const key = JSON.stringify([state.mode, state.a, state.b, state.shown, state.eye, state.playing, state.layer, cells()]);
    if (key === labelled) return;
    labelled = key;
    const eyes = eyesShown(), paired = eyes.length > 1, eye = paired ? "" : eyeText(eyes[0]);
    strip.className = `strip top ${state.mode === "split" && paired ? "" : state.mode}`;
    if (state.mode === "split") strip.replaceChildren(label(state.a, "A", eye), label(state.b, "B", eye));
    else if (state.mode === "flip") strip.replaceChildren(label(state.shown, tagOf(state.shown), eye));
    else if (state.mode === "difference") strip.replaceChildren(label(state.b, "B"), "minus", label(reference(), "", eye));
    else strip.replaceChildren(["All views", eye || eyeText("each"), "one exposure and zoom"].filter(Boolean).join(", "));
    for (const cell of state.mode === "grid" || paired ? cells() : []) {
      const named = state.mode === "grid"; // once, above both eyes
      if (named && cell.eye !== eyes[0]) continue;
      const node = named ? label(cell.view, tagOf(cell.view)) : make("span", "label", eyeText(cell.eye));
      const width = (named ? eyes.length : 1) * cell.w;
      node.style.cssText = `left:${cell.x / ratio()}px;top:${cell.y / ratio() - LABEL}px;width:${width / ratio()}px`;
      grid.push(node);
    }
    byId("cell-labels").replaceChildren(...grid);
  }

  const stops = (value) => `${value > 0 ? "+" : value < 0 ? "−" : ""}${Math.abs(value).toFixed(1)}`;
  function drawControls() {
    drawLabels();
    const split = byId("split"), cell = cells()[0];
    const maps = state.layer === "visible";
    const difference = !maps && (state.mode === "difference" || state.eye === "difference");
    const ghostly = maps || state.eye === "ghost";
    split.hidden = state.mode !== "split";
    split.style.top = `${cell.y / ratio()}px`;
    split.style.left = `${(100 * (cell.x + state.split * cell.w)) / picture.width}%`;
    split.setAttribute("aria-valuenow", Math.round(100 * state.split));
    split.setAttribute("aria-valuetext", `${Math.round(100 * state.split)} % A`);
    byId("zoom-value").textContent = inDome() ? `${Math.round(state.look.field)}°` : `${Math.round(100 * state.zoom)} %`;
    byId("zoom-fit").setAttribute("aria-pressed", state.fit && !inDome());
    byId("zoom-one").setAttribute("aria-pressed", state.zoom === 1 && !inDome());
    byId("zoom-one").disabled = inDome();

    for (const name of ["mode", "a", "b", "gamma", "area", "axis", "eye", "ghostOf", "layer", "place"])
      for (const input of all(`input[name=${name}]`)) input.checked = input.value === String(state[name]);
    const shown = { split: [state.a, state.b], flip: [state.shown], grid: [], difference: [] }[state.mode];
    for (const button of all("[data-show]"))
      button.classList.toggle("visible", shown.includes(Number(button.dataset.show)));

    byId("exposure").value = state.exposure;
    byId("exposure-value").textContent = `${stops(state.exposure)} stops`;
    byId("dark-room").setAttribute("aria-pressed", state.darkRoom);
    document.documentElement.classList.toggle("dark-room", state.darkRoom);
    const changed = [];
    if (state.exposure !== 0) changed.push(`${stops(state.exposure)} stops`);
    if (state.gamma !== NEUTRAL.gamma) changed.push(`gamma ${state.gamma}`);
    byId("badge").textContent = `Not neutral: ${changed.join(", ")}`;
    byId("badge").hidden = difference || ghostly || !changed.length;
    byId("display-white").hidden = difference || ghostly;
    byId("display-white").textContent = `display white = ${format(white / 2 ** state.exposure)} cd/m²`;

    byId("difference-of").textContent =
      state.eye === "difference" ? "left minus right" : `B against ${views[reference()].name}`;
    byId("scale").value = state.scaleStep;
    byId("scale-value").textContent = `${state.signed ? "±" : ""}${steps[state.scaleStep]} cd/m²`;
    byId("scale-auto").setAttribute("aria-pressed", state.scaleAuto);
    byId("legend").hidden = !difference && !maps;
    if (difference) drawLegend();
    if (maps) drawVisibleLegend();
    if (visible.maps) drawVisible();
    if (theatre) drawTheatre();
    if (stereo) drawEyes();
    const bright = white / state.displayWhite;
    byId("one-to-one").setAttribute("aria-pressed", Math.abs(state.exposure - oneToOne()) < 0.005);
    byId("one-to-one-note").textContent =
      `At 1:1 a display of ${state.displayWhite} cd/m² shows the theatre's own luminances: white of ${format(white)} cd/m² is `
      + `${Number((100 * bright).toPrecision(2))} % of its light. See it in a dark room.`;
    document.body.classList.toggle("presenting", state.presenting);
    byId("present").setAttribute("aria-pressed", state.presenting);
  }

  function drawVisible() {
    paintVisible(master < 0 ? 0 : master, "left"); // the shares need the maps' screen
    byId("line").value = visible.LINES.indexOf(state.line);
    byId("line-value").textContent = `${state.line} JND`;
    for (const row of all("#visible-share tbody tr")) {
      const above = visible.above(Number(row.dataset.view), row.dataset.eye, state.line, mapAlpha);
      row.querySelector("td").textContent = above === null ? "–" : `${Number((100 * above).toPrecision(3))} %`;
    }
  }

  function drawTheatre() {
    byId("picture").style.cursor = inDome() ? "grab" : "";
    byId("dome").hidden = !inDome();
    byId("seat").value = state.seat;
    for (const part of all("[data-dome-only]")) part.hidden = !inDome();
  }

  function drawEyes() {
    for (const part of all("[data-eye-only]")) part.hidden = part.dataset.eyeOnly !== state.eye;
    byId("wiggle-play").textContent = state.playing ? "Pause" : "Play";
    byId("wiggle-rate").value = state.rate;
    byId("wiggle-rate-value").textContent = `${state.rate} a second`;
    if (state.eye !== "ghost") return;
    const gain = 2 ** state.ghostGain;
    byId("ghost-gain").value = state.ghostGain;
    byId("ghost-gain-value").textContent = `× ${gain}`;
    byId("ghost-full").textContent = `full colour = ${format(white / gain / 2 ** state.exposure)} cd/m²`;
    for (const line of all("#ghost-left tbody tr")) {
      const parts = ["left", "right"].map((eye) =>
        meanResidual(pictureOf(Number(line.dataset.view), eye), pictureOf(reference(), eye)));
      const texts = [...parts.map(({ excess }) => excess), ...parts.map(({ lack }) => lack)];
      line.querySelectorAll("td").forEach((field, i) =>
        (field.textContent = texts[i] < 5e-4 ? "0" : String(Number(texts[i].toPrecision(2)))));
    }
  }

  function drawVisibleLegend() {
    const { LINES, MOST, share, jodOf } = visible;
    const stops = Array.from({ length: 33 }, (_, i) => {
      const below = i / 32 < share(state.line);
      return `${below ? "rgb(22 22 22)" : `rgb(${ramps.magnitude[Math.round((i * (RAMP - 1)) / 32)]})`} ${(100 * i) / 32}%`;
    });
    const edge = 100 * share(state.line);
    byId("darker").hidden = true;
    byId("brighter").textContent = "JND (JOD)";
    byId("ramp").style.background =
      `linear-gradient(white, white) ${edge}% 0 / 2px 100% no-repeat, linear-gradient(to right, ${stops.join(",")})`;
    const two = (value) => String(Number(value.toPrecision(value < 0.1 ? 1 : 2)));
    byId("ticks").replaceChildren(...[1, 10, 100].map((value) => {
      const tick = make("span", "", `${value} (${two(jodOf(value))})`);
      tick.style.left = `${100 * share(value)}%`;
      if (value > 1) tick.style.transform = "translateX(-50%)";
      return tick;
    }));
  }

  function drawLegend() {
    const ramp = state.signed ? ramps.signed : ramps.magnitude, top = steps[state.scaleStep];
    const colours = Array.from({ length: 33 }, (_, i) => `rgb(${ramp[Math.round((i * (RAMP - 1)) / 32)]})`);
    const eyes = state.eye === "difference";
    byId("darker").hidden = !state.signed;
    byId("darker").textContent = eyes ? "right brighter" : "darker";
    byId("brighter").textContent = state.signed ? `${eyes ? "left " : ""}brighter, cd/m²` : "cd/m²";
    byId("ramp").style.background = `linear-gradient(to right, ${colours.join(",")})`;
    const amount = (share) => String(Number((share * top).toPrecision(3)));
    const ticks = state.signed
      ? [`−${amount(1)}`, `−${amount(0.5)}`, "0", `+${amount(0.5)}`, `+${amount(1)}`]
      : ["0", amount(0.25), amount(0.5), amount(0.75), amount(1)];
    byId("ticks").replaceChildren(...ticks.map((text, i) => {
      const tick = Object.assign(document.createElement("span"), { textContent: text });
      tick.style.left = `${25 * i}%`;
      return tick;
    }));
  }

  // ---------------------------------------------------------------- readings

  function format(value) {
    const size = Math.abs(value), sign = value < 0 ? "−" : "";
    if (size === 0) return "0";
    if (size < 1e-5) return `${sign}<0.00001`;
    return sign + size.toFixed(size >= 100 ? 1 : size >= 10 ? 2 : size >= 1 ? 3 : size >= 0.1 ? 4 : 5);
  }

  // What every view holds at a pixel, in cd/m²: the mean over the on-screen part of a square.
  function probeAt(row, col, area = state.area) {
    const half = (area - 1) / 2, { alpha } = levels[0][0];
    const onScreen = row >= 0 && col >= 0 && row < rows && col < cols && alpha[row * cols + col] > 0;
    if (!onScreen) return { row, col, onScreen, direction: null, views: [] };
    const inside = [];
    for (let y = Math.max(0, row - half); y <= Math.min(rows - 1, row + half); y++)
      for (let x = Math.max(0, col - half); x <= Math.min(cols - 1, col + half); x++)
        if (alpha[y * cols + x]) inside.push(y * cols + x);
    const meanIn = (picture) => {
      const { codes } = levels[picture][0];
      const meanOf = (plane) => inside.reduce((sum, i) => sum + nits[codes[plane * rows * cols + i]], 0) / inside.length;
      const [r, g, b] = [0, 1, 2].map(meanOf);
      return { r, g, b, y: LUMA[0] * r + LUMA[1] * g + LUMA[2] * b };
    };
    const values = views.map(({ name }, view) =>
      ({ name, ...meanIn(pictureOf(view, "left")), ...(stereo && { right: meanIn(pictureOf(view, "right")) }) }));
    return { row, col, onScreen, direction: directionOf(row, col), views: values };
  }

  // Equidistant domemaster, front at the bottom: degrees from the zenith, and from the front
  // towards the right of the picture.
  function directionOf(row, col) {
    if (!theatre) return null;
    const radius = Math.min(rows, cols) / 2;
    const right = (col + 0.5 - cols / 2) / radius, front = (row + 0.5 - rows / 2) / radius;
    if (Math.hypot(right, front) > 1) return null;
    const azimuth = (Math.atan2(right, front) * 180) / Math.PI;
    return { zenith: Math.hypot(right, front) * theatre.dome.halfAngle, azimuth: (azimuth + 360) % 360 };
  }

  function drawReadings() {
    const reading = state.probe && probeAt(state.probe.row, state.probe.col);
    byId("probe-state").textContent = state.pinned ? "pinned, Esc or a click releases" : "click to pin";
    byId("where").textContent = !reading ? "Point at the picture."
      : `row ${reading.row}, col ${reading.col}` + (!reading.onScreen ? ": outside the screen"
        : reading.direction ? ` · zenith angle ${reading.direction.zenith.toFixed(1)}°, azimuth ${reading.direction.azimuth.toFixed(1)}°` : "");
    const seen = !visible.maps || !reading || !reading.onScreen ? [] : views.flatMap(({ kind }, view) => {
      const value = visible.at(view, plottedEye(), reading.row, reading.col);
      return value === null || kind !== "seen" ? [] : [`${view + 1}: ${Number(value.toPrecision(2))}`];
    });
    byId("probe-visible").textContent = seen.length ? `Visible difference, JND: ${seen.join(" · ")}` : "";
    const display = displayTable().codes;
    for (const line of all(".probe tbody tr")) {
      const view = Number(line.dataset.view), fields = line.querySelectorAll("td");
      const ofEye = (of) => reading.onScreen && (line.dataset.eye === "right" ? reading.views[of].right : reading.views[of]);
      const value = reading && ofEye(view);
      const texts = !value ? Array(5).fill("–")
        : [value.r, value.g, value.b, value.y].map(format).concat(
          master < 0 || view === master ? "–" : signedText(value.y - ofEye(master).y));
      fields.forEach((field, i) => (field.textContent = texts[i]));
      line.className = tagOf(view).toLowerCase();
      const colour = value && [value.r, value.g, value.b].map((v) => display[codeOf(v)]);
      line.querySelector(".swatch").style.background = colour ? `rgb(${colour})` : "";
    }
    const eye = plottedEye(), curves = [[state.a, "--a", []], [state.b, "--b", []]]
      .filter(([view]) => view !== master)
      .concat(master >= 0 ? [[master, "--strong", [4, 3]]] : [])
      .map(([view, ...look]) => [pictureOf(view, eye), ...look]);
    const inside = reading && reading.row >= 0 && reading.row < rows;
    byId("profile-row").textContent =
      [inside ? `row ${reading.row}` : "", stereo ? `${eye} eye` : ""].filter(Boolean).join(", ");
    if (stereo) byId("histogram-of").textContent = `${eye} eye, by cd/m²`;
    drawProfile(curves, inside ? reading : null, state.axis, steps);
    drawHistogram(curves, nits[display.findIndex((code) => code > 0)], white / 2 ** state.exposure);
  }
  const signedText = (value) => (value > 0 ? "+" : "") + format(value);

  // ---------------------------------------------------------------- what the reader does

  function setMode(mode, shown = state.shown) {
    Object.assign(state, { mode, shown });
    if (mode === "difference") state.layer = "light";
    if (mode === "difference" && !PLAIN.includes(state.eye)) state.eye = "left";
    draw();
  }

  // The difference from the master and what is made of both eyes exclude each other.
  const stillness = matchMedia("(prefers-reduced-motion: reduce)");
  function setEye(eye) {
    if (state.mode === "difference" && !PLAIN.includes(eye)) Object.assign(state, { mode: "flip", shown: state.b });
    if (!PLAIN.includes(eye)) state.layer = "light";
    Object.assign(state, { eye, phase: "left" });
    setPlaying(eye === "wiggle" && !stillness.matches);
  }

  // Light, or the map of visible differences, which is of one eye alone.
  function setLayer(layer) {
    if (!visible.maps) return;
    if (layer === "visible" && state.mode === "difference") state.mode = "split";
    if (layer === "visible" && !PLAIN.includes(state.eye)) state.eye = "left";
    state.layer = layer;
    draw();
  }

  function setPlace(place) {
    if (!domeView) return;
    state.place = place;
    draw();
  }

  function setSeat(seat) {
    Object.assign(state, { seat, look: theatre.facing(seat) });
    draw();
  }

  // The stage alone, in the whole window; in the whole screen where the browser lets it.
  function present(presenting) {
    state.presenting = presenting;
    if (presenting && document.fullscreenEnabled) document.documentElement.requestFullscreen().catch(() => {});
    else if (!presenting && document.fullscreenElement) document.exitFullscreen();
    draw();
  }

  const oneToOne = () => Math.round(100 * clamp(Math.log2(white / state.displayWhite), LEAST_STOPS, 10)) / 100;

  let headset = null;
  async function enterHeadset() {
    byId("headset-note").textContent = "";
    try {
      const shown = () => {
        const canvas = paintView(state.shown, "left", 0);
        return { source: canvas, key: canvas.painted };
      };
      setPlace("dome");
      if (state.mode !== "flip") setMode("flip", state.b);
      headset = await theatre.enter(domeView, () => state.seat, shown, flip, () => {
        headset = null;
        draw();
      });
    } catch (error) {
      byId("headset-note").textContent = `The headset could not be entered: ${error.message}`;
    }
  }

  let beat = 0;
  function setPlaying(playing, rate = state.rate) {
    Object.assign(state, { playing, rate });
    clearInterval(beat);
    if (playing) beat = setInterval(wiggle, 1000 / rate);
    draw();
  }

  function wiggle() {
    state.phase = state.phase === "left" ? "right" : "left";
    drawPicture();
  }

  function flip() {
    setMode("flip", state.mode === "flip" && state.shown === state.b ? state.a : state.b);
  }

  // Flip on press; if the press was long, it was a look: flip back on release.
  let pressed = null;
  function press() {
    if (pressed) return;
    pressed = { at: performance.now(), mode: state.mode, shown: state.shown };
    flip();
  }
  function release() {
    if (pressed && performance.now() - pressed.at > HOLD_MS) setMode(pressed.mode, pressed.shown);
    pressed = null;
  }

  function setExposure(value) {
    state.exposure = clamp(Math.round(value * 100) / 100, LEAST_STOPS, 10);
    draw();
  }

  // Put the 95th percentile of the darker half of the master's lit pixels at mid-grey (18 %), but
  // clip no more than a fiftieth of them: a planet stays a planet. Pixels of no light at all have
  // nothing to show and would send every star field to +10.
  function shadowExposure() {
    const level = levels[pictureOf(reference(), "left")][0], lit = [];
    for (let i = 0; i < level.alpha.length; i++) {
      const value = level.alpha[i] ? luminance(level, i) : 0;
      if (value > 0) lit.push(value);
    }
    if (!lit.length) return 10;
    const sorted = Float64Array.from(lit), shadow = quantile(sorted, 0.5 * 0.95), bright = quantile(sorted, 0.98);
    return Math.max(0, Math.min(Math.log2((0.18 * white) / shadow), Math.log2(white / bright)));
  }

  let beforeDark = 0;
  function toggleDarkRoom() {
    state.darkRoom = !state.darkRoom;
    if (state.darkRoom) beforeDark = state.exposure;
    setExposure(state.darkRoom ? Math.round(10 * shadowExposure()) / 10 : beforeDark);
  }

  function reset() {
    Object.assign(state, NEUTRAL, { darkRoom: false });
    draw();
  }

  function movePin(down, right) {
    const at = state.probe || { row: rows >> 1, col: cols >> 1 };
    state.probe = { row: clamp(at.row + down, 0, rows - 1), col: clamp(at.col + right, 0, cols - 1) };
    state.pinned = true;
    draw();
  }

  function pixelAt(point) {
    const { row, col } = toPicture(point);
    return { row: Math.floor(row), col: Math.floor(col) };
  }

  function listenToPicture() {
    const down = new Map(); // pointers on the picture
    let travelled = 0;
    picture.addEventListener("pointerdown", (event) => {
      picture.setPointerCapture(event.pointerId);
      if (!down.size) travelled = 0;
      down.set(event.pointerId, toDevice(event));
    });
    picture.addEventListener("pointermove", (event) => {
      const now = toDevice(event), before = down.get(event.pointerId);
      if (!before) {
        if (!state.pinned) {
          state.probe = pixelAt(now);
          draw();
        }
        return;
      }
      travelled += Math.hypot(now.x - before.x, now.y - before.y);
      const others = [...down].filter(([id]) => id !== event.pointerId).map(([, point]) => point);
      down.set(event.pointerId, now);
      if (travelled < 4 * ratio()) return;
      if (others.length) {
        const spread = (p) => Math.max(1, Math.hypot(p.x - others[0].x, p.y - others[0].y));
        const middle = { x: (now.x + others[0].x) / 2, y: (now.y + others[0].y) / 2 };
        if (inDome()) narrow(spread(before) / spread(now));
        else zoomTo((state.zoom * spread(now)) / spread(before), middle);
      }
      const share = 1 / down.size; // two fingers moving together pan once
      if (inDome()) { // what was grabbed stays below the pointer, in the middle of the view
        const degrees = (share * (2 * Math.tan((state.look.field * Math.PI) / 360) * 180)) / Math.PI / cellAt(now).w;
        const level = Math.max(0.2, Math.cos((state.look.rise * Math.PI) / 180));
        return lookAround((-(now.x - before.x) * degrees) / level, (now.y - before.y) * degrees);
      }
      state.centre.col -= (share * (now.x - before.x)) / state.zoom;
      state.centre.row -= (share * (now.y - before.y)) / state.zoom;
      state.fit = false;
      draw();
    });
    const lift = (event) => {
      const point = down.get(event.pointerId);
      down.delete(event.pointerId);
      if (!point || event.type === "pointercancel" || travelled >= 4 * ratio() || event.button > 0) return;
      const pixel = pixelAt(point);
      const apart = state.pinned ? Math.hypot(pixel.row - state.probe.row, pixel.col - state.probe.col) : Infinity;
      const again = apart * state.zoom < 6 * ratio();
      Object.assign(state, { probe: pixel, pinned: !again });
      draw();
    };
    picture.addEventListener("pointerup", lift);
    picture.addEventListener("pointercancel", lift);
    picture.addEventListener("pointerleave", () => {
      if (!state.pinned) state.probe = null;
      draw();
    });
    picture.addEventListener("dblclick", (event) => {
      if (state.fit && !inDome()) zoomTo(state.zoom < 1 ? 1 : 4, toDevice(event));
      else fit();
    });
    picture.addEventListener("wheel", (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 16 : 1;
      const factor = Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0015));
      if (inDome()) narrow(1 / factor);
      else zoomTo(state.zoom * factor, toDevice(event));
    }, { passive: false });
  }

  function setSplit(share) {
    state.split = clamp(share, 0, 1);
    draw();
  }

  function listenToSplit() {
    const split = byId("split");
    split.addEventListener("pointerdown", (event) => split.setPointerCapture(event.pointerId));
    split.addEventListener("pointermove", (event) => {
      const cell = cells()[0];
      if (split.hasPointerCapture(event.pointerId)) setSplit((toDevice(event).x - cell.x) / cell.w);
    });
    split.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 0.1 : 0.01;
      const moves = { ArrowLeft: -step, ArrowDown: -step, ArrowRight: step, ArrowUp: step, Home: -1, End: 1 };
      if (!(event.key in moves)) return;
      event.preventDefault();
      event.stopPropagation();
      setSplit(state.split + moves[event.key]);
    });
  }

  function listenToKeys() {
    const keys = {
      s: () => setMode("split"), f: () => setMode("flip"), g: () => setMode("grid"), d: () => setMode("difference"),
      x: swap, k: toggleDarkRoom, r: reset, 0: fit, z: () => zoomTo(1),
      "[": () => setExposure(state.exposure - 0.5), "]": () => setExposure(state.exposure + 0.5),
      "+": () => zoomTo(state.zoom * 1.25), "=": () => zoomTo(state.zoom * 1.25), "-": () => zoomTo(state.zoom / 1.25),
      "?": () => byId("help").showModal(),
      v: () => setLayer(state.layer === "visible" ? "light" : "visible"),
      n: () => present(!state.presenting),
      Escape: () => { Object.assign(state, { pinned: false, probe: null }); present(false); },
    };
    if (theatre) keys.t = () => setPlace(inDome() ? "flat" : "dome");
    if (stereo)
      Object.assign(keys, {
        e: () => setEye(state.eye === "left" ? "right" : "left"), p: () => setEye("both"), m: () => setEye("difference"),
        c: () => setEye("anaglyph"), o: () => setEye("ghost"),
        w: () => (state.eye === "wiggle" ? setPlaying(!state.playing) : setEye("wiggle")),
      });
    const arrows = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
    document.addEventListener("keydown", (event) => {
      if (byId("help").open || event.ctrlKey || event.metaKey || event.altKey) return;
      const ownKeys = event.target.closest("button, summary, input[type=radio]");
      const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
      if (key === " " && !ownKeys) press();
      else if (key in arrows && event.target === picture && inDome())
        lookAround(...[arrows[key][1], -arrows[key][0]].map((n) => n * (event.shiftKey ? 1 : 5)));
      else if (key in arrows && event.target === picture)
        movePin(...arrows[key].map((n) => n * (event.shiftKey ? 10 : 1)));
      else if (key >= "1" && key <= "9" && Number(key) <= views.length) setMode("flip", Number(key) - 1);
      else if (key in keys) keys[key]();
      else return;
      event.preventDefault();
    });
    document.addEventListener("keyup", (event) => event.key === " " && release());
    window.addEventListener("blur", release);
  }

  function swap() {
    [state.a, state.b] = [state.b, state.a];
    draw();
  }

  function listenToControls() {
    const onClick = (id, action) => byId(id).addEventListener("click", action);
    const onChange = (name, action) =>
      all(`input[name=${name}]`).forEach((input) =>
        input.addEventListener("change", () => { action(input.value); draw(); }));
    onClick("zoom-in", () => zoomTo(state.zoom * 1.25));
    onClick("zoom-out", () => zoomTo(state.zoom / 1.25));
    onClick("zoom-fit", fit);
    onClick("zoom-one", () => zoomTo(1));
    onClick("swap", swap);
    onClick("dark-room", toggleDarkRoom);
    onClick("reset", reset);
    onClick("help-open", () => byId("help").showModal());
    onClick("present", () => present(!state.presenting));
    onClick("present-end", () => present(false));
    document.addEventListener("fullscreenchange", () => {
      if (!document.fullscreenElement && state.presenting) present(false);
    });
    onClick("one-to-one", () => setExposure(oneToOne()));
    byId("display-nits").addEventListener("change", (event) => {
      state.displayWhite = clamp(Number(event.target.value) || 200, 1, 10000);
      event.target.value = state.displayWhite;
      draw();
    });
    matchMedia("(prefers-color-scheme: light)").addEventListener("change", draw);
    if (visible.maps) {
      onChange("layer", setLayer);
      byId("line").max = visible.LINES.length - 1;
      byId("line").addEventListener("input", (event) => {
        state.line = visible.LINES[event.target.value];
        draw();
      });
    }
    if (theatre) listenToTheatre(onClick, onChange);
    onClick("scale-auto", () => { state.scaleAuto = !state.scaleAuto; draw(); });
    for (const button of all("[data-show]"))
      button.addEventListener("click", () => setMode("flip", Number(button.dataset.show)));

    const flipButton = byId("flip");
    flipButton.addEventListener("pointerdown", press);
    for (const name of ["pointerup", "pointercancel", "pointerleave"]) flipButton.addEventListener(name, release);
    flipButton.addEventListener("click", (event) => event.detail === 0 && flip()); // by keyboard

    onChange("mode", (value) => setMode(value));
    onChange("a", (value) => (state.a = Number(value)));
    onChange("b", (value) => (state.b = Number(value)));
    onChange("gamma", (value) => (state.gamma = value));
    onChange("area", (value) => (state.area = Number(value)));
    onChange("sign", (value) => (state.signed = value === "signed"));
    onChange("axis", (value) => (state.axis = value));
    if (stereo) listenToEyes(onClick, onChange);
    byId("exposure").addEventListener("input", (event) => setExposure(Number(event.target.value)));
    byId("scale").max = steps.length - 1;
    byId("scale").addEventListener("input", (event) => {
      Object.assign(state, { scaleStep: Number(event.target.value), scaleAuto: false });
      draw();
    });

    // After a press with the mouse the keys belong to the picture again: Space flips.
    let byPointer = false;
    document.addEventListener("pointerdown", () => (byPointer = true), true);
    document.addEventListener("keydown", () => (byPointer = false), true);
    document.addEventListener("click", (event) => {
      if (byPointer && event.target.closest(".panel button, .bar button, input[type=radio]") && !byId("help").open)
        picture.focus({ preventScroll: true });
    });
  }

  function listenToTheatre(onClick, onChange) {
    for (const [number, { name }] of theatre.seats.entries())
      byId("seat").append(Object.assign(document.createElement("option"), { value: number, textContent: name }));
    byId("seat").addEventListener("change", (event) => setSeat(Number(event.target.value)));
    onChange("place", setPlace);
    const missing = () => {
      domeView = null;
      for (const input of all("input[name=place]")) input.disabled = true;
      byId("dome-missing").hidden = false;
      state.place = "flat";
      draw();
    };
    if (!domeView) return missing();
    byId("dome").addEventListener("webglcontextlost", missing);
    const offer = (there) => (byId("headset").hidden = !there);
    navigator.xr?.isSessionSupported("immersive-vr").then(offer, () => offer(false));
    onClick("headset", () => (headset ? headset.end() : enterHeadset()));
  }

  function listenToEyes(onClick, onChange) {
    onChange("eye", setEye);
    onChange("ghostOf", (value) => (state.ghostOf = value));
    onClick("wiggle-play", () => setPlaying(!state.playing));
    byId("wiggle-rate").addEventListener("input", (event) => setPlaying(state.playing, Number(event.target.value)));
    byId("ghost-gain").addEventListener("input", (event) => {
      state.ghostGain = Number(event.target.value);
      draw();
    });
  }

  function resize() {
    const box = frame.getBoundingClientRect();
    const width = Math.max(1, Math.round(box.width * ratio())), height = Math.max(1, Math.round(box.height * ratio()));
    if (picture.width === width && picture.height === height) return;
    for (const canvas of theatre ? [picture, byId("dome")] : [picture]) Object.assign(canvas, { width, height });
    if (levels.length === pictures) drawNow(); // at once: a resized canvas is empty
  }

  async function start() {
    if (typeof DecompressionStream === "undefined") {
      byId("message").textContent = "This browser cannot unpack the pictures (it has no DecompressionStream). "
        + "Please open the file in Chrome or Edge 80, Firefox 113, Safari 16.4 or newer.";
      return;
    }
    resize();
    await domesimLight.read((n) => (byId("message").textContent = `Unpacking ${n} of ${pictures}…`));
    byId("message").hidden = true;
    listenToPicture();
    listenToSplit();
    listenToKeys();
    listenToControls();
    new ResizeObserver(resize).observe(frame);
    drawNow();
  }

  // For tests: what is shown, and where a picture pixel lies in the window (CSS pixels).
  window.domesimViewer = {
    ready: start().catch((error) => {
      byId("message").textContent = `The pictures in this file could not be unpacked (${error.message}). `
        + "Please fetch the file again.";
      throw error;
    }),
    state: () => structuredClone(state),
    probeAt,
    toWindow(row, col, cell = 0) {
      const at = placeIn(cells()[cell], row, col), box = picture.getBoundingClientRect();
      return at && { x: box.left + at.x / ratio(), y: box.top + at.y / ratio() };
    },
    size: () => [picture.width / ratio(), picture.height / ratio()],
    light: () => levels.map(([{ codes }]) => Array.from(codes, (code) => nits[code])),
  };
})();
