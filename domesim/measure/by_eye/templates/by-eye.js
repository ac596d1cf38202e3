"use strict";
// One viewer's session: the operator's desk, the settings, and what is drawn for them.
// Levels are code values 0..1. What they mean in light is found from the settings afterwards.

const at = (id) => document.getElementById(id);
const stereo = PLAN.kind === "stereo";
const PHASE = 500; // ms of each of the two pictures that take turns
const USUAL = 2.2; // a display's gamma, to begin somewhere
const FINEST = 255 * 64; // levels that dithering shows of 8-bit codes
const LARGE = 8; // small steps of a large one
const LINE = 2; // pixels of a line of the match's pattern, of which one of four is lit
const WEDGES = 12; // of the rear half of a dome, a quarter of each lit
const BARS = 12; // periods of the bars in the middle of the picture
const STEEP = 6; // how soft the bars' edges are: two projectors are never aligned to a pixel
const SLICES = 48; // of a period, even
// Light that ghosts are nulled on, of them; hardly less than the lowest that is matched
const GREY = { first: 0.1, of: 2.5, least: 0.015, most: 0.4 };
const KEYS = {
  ArrowLeft: -1, ArrowRight: 1, ArrowDown: -LARGE, ArrowUp: LARGE, " ": "go", Enter: "go",
};
const BUTTONS = { 14: -1, 15: 1, 13: -LARGE, 12: LARGE, 0: "go" }; // of the standard gamepad
const HELD = 120; // ms after which a button that is held turns on
const BAYER = [
  [0, 32, 8, 40, 2, 34, 10, 42], [48, 16, 56, 24, 50, 18, 58, 26], [12, 44, 4, 36, 14, 46, 6, 38],
  [60, 28, 52, 20, 62, 30, 54, 22], [3, 35, 11, 43, 1, 33, 9, 41], [51, 19, 59, 27, 49, 17, 57, 25],
  [15, 47, 7, 39, 13, 45, 5, 37], [63, 31, 55, 23, 61, 29, 53, 21],
];

let session = null; // the viewer's settings, as they are kept
let listener = null; // what a key does
let shown = null; // what is drawn: { block, base, code, phase }

const wait = (ms) => new Promise((done) => setTimeout(done, ms));
const clip = (value, low, high) => Math.min(Math.max(value, low), high);
const median = (values) => {
  const sorted = [...values].sort((a, b) => a - b);
  return (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2;
};
const fine = (code) => Math.round(clip(code, 0, 1) * FINEST) / FINEST;
const light = (code) => code ** USUAL;
const codeOf = (amount) => clip(amount, 0, 1) ** (1 / USUAL);

// Keys and gamepads

function act(action) {
  if (listener) listener(action);
}

function pressed(event) {
  const action = KEYS[event.key];
  if (at("stage").hidden || action === undefined || (event.repeat && action === "go")) return;
  event.preventDefault();
  act(action);
}
document.addEventListener("keydown", pressed);

let held = new Map();
function poll(now) {
  const before = held;
  held = new Map();
  for (const pad of navigator.getGamepads ? navigator.getGamepads() : []) {
    if (pad) pad.buttons.forEach((button, k) => {
      const action = BUTTONS[k];
      if (!button.pressed || action === undefined) return;
      const next = before.get(k);
      const due = next === undefined || (action !== "go" && now >= next);
      held.set(k, due ? now + HELD : next);
      if (due && !at("stage").hidden) act(action);
    });
  }
  requestAnimationFrame(poll);
}

// Drawing

const eyes = [...document.querySelectorAll(".eye")];
const shows = (eye) => !stereo || eye.classList.contains("left") !== at("swap").checked ? "left" : "right";
const patterns = new Map();

function ink(context, primary, code) {
  const level = Math.round(clip(code, 0, 1) * FINEST);
  const key = `${primary} ${level}`;
  if (!patterns.has(key)) {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 8;
    const pixels = new ImageData(8, 8);
    const whole = Math.floor(level / 64);
    for (let k = 0; k < 64; k += 1) {
      const value = Math.min(255, whole + (level % 64 > BAYER[k >> 3][k & 7] ? 1 : 0));
      for (let c = 0; c < 3; c += 1) pixels.data[4 * k + c] = "W" === primary || "RGB"[c] === primary ? value : 0;
      pixels.data[4 * k + 3] = 255;
    }
    tile.getContext("2d").putImageData(pixels, 0, 0);
    if (patterns.size > 4000) patterns.clear();
    patterns.set(key, tile);
  }
  context.fillStyle = context.createPattern(patterns.get(key), "repeat");
}

function fill(context, primary, code, left, top, width, height) {
  ink(context, primary, code);
  context.fillRect(left, top, width, height);
}

// Bars of the other eye, or their answer on this eye's grey; around them it stays as it is
function bars(context, width, height, primary, around, code) {
  const middle = Math.round(width * 0.6);
  const high = Math.round(height * 0.6);
  const left = (width - middle) >> 1;
  const top = (height - high) >> 1;
  fill(context, primary, around, 0, 0, width, height);
  const slices = BARS * SLICES;
  for (let k = 0; k < slices; k += 1) {
    const wave = Math.sin((2 * Math.PI * (k + 0.5)) / SLICES);
    const lit = clip(0.5 + (STEEP * wave) / 4, 0, 1);
    const from = Math.round((k * middle) / slices);
    fill(context, primary, code(lit), left + from, top, Math.round(((k + 1) * middle) / slices) - from, high);
  }
}

function lines(context, width, height, { base, code }, upright) {
  fill(context, "W", 0, 0, 0, width, height);
  for (let from = 0; from < (upright ? width : height); from += 4 * LINE) {
    fill(context, "W", base, ...(upright ? [from, 0, LINE, height] : [0, from, width, LINE]));
  }
  fill(context, "W", code, Math.round(width * 0.35), Math.round(height * 0.35), Math.round(width * 0.3), Math.round(height * 0.3));
}

// Half of the disc, or a quarter of that in wedges. Each pixel is lit or not: a path's soft edges
// would have half the code, and a quarter of the light.
const masks = new Map();
function mask(size, part) {
  const key = `${part} ${size}`;
  if (!masks.has(key)) {
    const pixels = new ImageData(size, size);
    for (let row = 0; row < size; row += 1) {
      for (let col = 0; col < size; col += 1) {
        const [x, y] = [col + 0.5 - size / 2, size / 2 - row - 0.5];
        const turn = (Math.atan2(y, x) / Math.PI) * WEDGES; // the rear, above, has 0 to WEDGES
        const half = part === "front" ? turn < 0 : turn > 0;
        const lit = part !== "wedges" || Math.abs((turn % 1) - 0.5) < 0.125;
        if (half && lit && Math.hypot(x, y) <= size / 2) pixels.data[4 * (row * size + col) + 3] = 255;
      }
    }
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = size;
    canvas.getContext("2d").putImageData(pixels, 0, 0);
    if (masks.size > 5) masks.clear();
    masks.set(key, canvas);
  }
  return masks.get(key);
}

function dome(context, size, { block, base, code, phase }) {
  const match = block.task === "match";
  const part = phase === 0 ? "rear" : match ? "wedges" : "front";
  context.globalCompositeOperation = "copy";
  fill(context, block.primary, match === (phase === 0) ? code : base, 0, 0, size, size);
  context.globalCompositeOperation = "destination-in";
  context.drawImage(mask(size, part), 0, 0);
  context.globalCompositeOperation = "destination-over";
  fill(context, "W", 0, 0, 0, size, size);
  context.globalCompositeOperation = "source-over";
}

function draw() {
  if (!shown) return;
  for (const eye of eyes) {
    const canvas = eye.querySelector("canvas");
    const ratio = canvas.ownerDocument.defaultView.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(8, Math.round(size * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    const { block, base, code, phase } = shown;
    if (!stereo) {
      dome(context, width, shown);
    } else if (block.task === "match") {
      if (shows(eye) === block.eye) lines(context, width, height, shown, at("layout").value === "tb-half");
      else fill(context, "W", 0, 0, 0, width, height);
    } else {
      const bar = (lit) => (phase === 0 ? lit : 1 - lit);
      if (shows(eye) === block.eye) {
        bars(context, width, height, block.primary, base, (lit) => base + (code - base) * bar(lit));
      } else {
        bars(context, width, height, block.primary, 0, (lit) => codeOf(bar(lit)));
      }
    }
  }
}

function black() {
  shown = null;
  for (const eye of eyes) {
    const canvas = eye.querySelector("canvas");
    canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
  }
}

setInterval(() => {
  if (!shown || (stereo && shown.block.task === "match")) return;
  shown.phase = 1 - shown.phase;
  draw();
}, PHASE);
window.addEventListener("resize", draw);

function say(html) {
  for (const eye of eyes) eye.querySelector(".words").innerHTML = html;
}

// What a setting is set against, and where it begins: both follow from the settings before

const place = () => session.settings.filter((one) => !one.limit).length;
const ofBlock = (number) => session.settings.filter((one) => PLAN.trials[one.trial].block === number);

function baseOf(trial) {
  const block = PLAN.blocks[trial.block];
  if (block.task === "match") {
    return block.level === 1 ? 1 : median(ofBlock(trial.block - 1).map((one) => one.code));
  }
  if (!stereo) return 1;
  const ghosts = ofBlock(trial.block).map((one) => light(one.base) - light(one.code));
  const grey = ghosts.length ? clip(GREY.of * median(ghosts), GREY.least, GREY.most) : GREY.first;
  return fine(codeOf(grey));
}

function startOf(trial, base) {
  const block = PLAN.blocks[trial.block];
  const before = ofBlock(trial.block);
  const far = trial.side === "below" ? 0.5 * trial.start : 1.5 + 0.8 * trial.start; // of the null's light
  if (block.task === "match") {
    return fine(codeOf((light(base) / 4) * (trial.side === "below" ? 0.4 + far : far)));
  }
  if (!stereo) {
    const guess = before.length ? median(before.map((one) => light(one.code))) : 0.12;
    return fine(codeOf(guess * (0.2 + far)));
  }
  const guess = light(base) / GREY.of;
  return fine(codeOf(light(base) - guess * far));
}

// Settings

function warn(text) {
  at("warning").textContent = text;
  at("warning").hidden = !text;
}

async function keep() {
  for (;;) {
    try {
      const reply = await fetch("settings", { method: "POST", body: JSON.stringify(session) });
      if (!reply.ok) throw new Error(reply.status);
      warn("");
      return;
    } catch {
      warn("Operator: settings are not kept on the disk. Is 'domesim measure by-eye' still running?");
      await wait(2000);
    }
  }
}

function choose() {
  return new Promise((done) => {
    listener = (action) => {
      if (action !== "go") return;
      listener = null;
      done();
    };
  });
}

async function rest(html) {
  black();
  say(html);
  await choose();
  say("");
}

function told(block) {
  const cover = { left: "right", right: "left" }[block.eye];
  const who = stereo ? `<p><b>The ${block.eye} eye looks.</b> Cover the glass of your ${cover} eye with a hand.</p>` : "";
  const colour = { R: "red", G: "green", B: "blue", W: "grey" }[block.primary];
  if (block.task === "match" && stereo) {
    return `${who}<p>Blur your sight until the lines are an even grey. Turn until the field in the middle is gone.</p>`;
  }
  if (block.task === "match") return "<p>Look to the front. The light there comes and goes. Turn until it is steady.</p>";
  if (stereo) return `${who}<p>Bars in ${colour} jump to and fro. Turn until nothing moves.</p>`;
  return `<p>Look to the front. It changes in ${colour}. Turn until it is steady.</p>`;
}

async function ask(trial, number) {
  const block = PLAN.blocks[trial.block];
  const base = baseOf(trial);
  const ghost = stereo && block.task === "null";
  const began = performance.now();
  shown = { block, base, code: startOf(trial, base), phase: 0 };
  draw();
  let turned = false; // who has not turned pressed the space bar twice
  await new Promise((done) => {
    listener = (action) => {
      if (action === "go") {
        if (!turned) return;
        listener = null;
        done();
        return;
      }
      turned = true;
      // To the right is always more light that answers; of a ghost's that is a darker bar
      const step = PLAN.step * (ghost ? -base : Math.max(shown.code, 0.02));
      shown.code = fine(clip(shown.code + action * Math.sign(step) * Math.max(Math.abs(step), 1 / FINEST), 0, ghost ? base : 1));
      draw();
    };
  });
  const limit = ghost && shown.code === 0 && light(base) < 0.99 * GREY.most;
  const seconds = Math.round(performance.now() - began) / 1000;
  return { trial: number, base, code: shown.code, limit, seconds };
}

async function play() {
  at("stage").hidden = false;
  at("desk").hidden = true;
  let block = null;
  for (let number = place(); number < PLAN.trials.length; number = place()) {
    const trial = PLAN.trials[number];
    if (trial.block !== block) {
      await rest(`${told(PLAN.blocks[trial.block])}<p>&larr; &rarr; a little, &darr; &uarr; much, space: it is gone.</p>
        <small>${trial.block + 1} of ${PLAN.blocks.length}. Space: begin. Rest as long as you like.</small>`);
      block = trial.block;
    }
    session.settings.push(await ask(trial, number));
    black();
    await keep();
    await wait(PHASE);
  }
  say("<p>That was all. Thank you!</p><small>The operator's terminal tells what was found.</small>");
}

async function readiness() {
  let found = null;
  try {
    const reply = await fetch("settings");
    if (reply.status === 200) found = await reply.json();
    warn("");
  } catch {
    warn("Is 'domesim measure by-eye' still running?");
    return null;
  }
  session = found;
  const done = found ? place() : 0;
  at("state").textContent = done === 0 ? "Nothing is set yet." :
    done < PLAN.trials.length ? `${done} of ${PLAN.trials.length} settings are kept. We go on there.` :
    "All is set.";
  at("begin").disabled = done === PLAN.trials.length;
  return found;
}

// The other eye's window of its own

function layout() {
  const chosen = stereo ? at("layout").value : "dome";
  document.body.className = chosen;
  const right = eyes[1];
  if (chosen === "windows" && right.ownerDocument === document) {
    const second = window.open("", "right", "popup,width=960,height=540");
    if (!second) {
      warn("The browser must allow this page to open a window.");
      return;
    }
    second.document.title = "The right eye's picture: move it to the other projector, F11";
    second.document.head.append(...[...document.querySelectorAll("style")].map((one) => second.document.importNode(one, true)));
    second.document.body.append(right);
    second.document.addEventListener("keydown", pressed);
    second.addEventListener("resize", draw);
  } else if (chosen !== "windows" && right && right.ownerDocument !== document) {
    const second = right.ownerDocument.defaultView;
    at("stage").append(right);
    second.close();
  }
}

async function begin() {
  await readiness();
  session ||= {
    kind: PLAN.kind, scene: PLAN.scene, digest: PLAN.digest, began: new Date().toISOString(), layout: "", resumed: 0,
    settings: [],
  };
  if (session.settings.length) session.resumed += 1;
  session.layout = stereo ? at("layout").value + (at("swap").checked ? ", swapped" : "") : "dome";
  if (document.documentElement.requestFullscreen) {
    await document.documentElement.requestFullscreen().catch(() => {});
  }
  await play();
}

if (stereo) {
  at("layout").addEventListener("input", layout);
  at("show-eyes").addEventListener("click", async () => {
    at("desk").hidden = true;
    at("stage").hidden = false;
    for (const eye of eyes) {
      eye.querySelector(".words").innerHTML = `<p style="font-size:3em">${shows(eye) === "left" ? "L" : "R"}</p>
        <small>The ${shows(eye)} eye alone sees this. Space: back</small>`;
    }
    await choose();
    say("");
    at("stage").hidden = true;
    at("desk").hidden = false;
  });
}
at("begin").addEventListener("click", begin);
layout();
readiness();
requestAnimationFrame(poll);
