"use strict";
// One viewer's session: the operator's desk, the trials, and the answers, which are kept after each.

const at = (id) => document.getElementById(id);
const served = location.protocol.startsWith("http");
const KEYS = {
  ArrowLeft: "first", 1: "first", ArrowRight: "second", 2: "second",
  ArrowUp: "again", r: "again", " ": "go", Enter: "go",
};
// Of the standard gamepad: shoulders and the cross; its up and the upper button; the lower one
const BUTTONS = { 4: "first", 14: "first", 5: "second", 15: "second", 12: "again", 3: "again", 0: "go" };
const GAP = 500; // ms without a picture, so that one is not compared with the other by its flicker
const REST = 24; // trials from one rest to the next

let session = null; // the viewer's answers, as they are kept
let listener = null; // who waits for a key: the actions and what to call

const wait = (ms) => new Promise((done) => setTimeout(done, ms));
const store = () => `domesim study ${STUDY.digest} viewer ${session.viewer}`;

function choose(...actions) {
  return new Promise((done) => { listener = { actions, done }; });
}

function act(action) {
  if (!listener || !listener.actions.includes(action)) return;
  const { done } = listener;
  listener = null;
  done(action);
}

document.addEventListener("keydown", (event) => {
  if (at("stage").hidden || event.repeat) return;
  const action = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (action) { event.preventDefault(); act(action); }
});

let held = new Set();
function poll() {
  const now = new Set();
  for (const pad of navigator.getGamepads ? navigator.getGamepads() : []) {
    if (pad) pad.buttons.forEach((button, k) => { if (button.pressed && BUTTONS[k]) now.add(BUTTONS[k]); });
  }
  if (!at("stage").hidden) for (const action of now) if (!held.has(action)) act(action);
  held = now;
  requestAnimationFrame(poll);
}

// What both eyes see

const eyes = () => [...document.querySelectorAll(".eye")];

function say(html, low = false) {
  for (const eye of eyes()) {
    const words = eye.querySelector(".words");
    words.innerHTML = html;
    words.classList.toggle("low", low);
  }
}

function file(picture, eye) {
  if (!STUDY.stereo) return `pictures/${picture}.png`;
  const left = eye.classList.contains("left") !== at("swap").checked;
  return `pictures/${picture}_${left ? "L" : "R"}.png`;
}

async function prepared(trial) {
  const names = [trial.first, trial.second];
  return Promise.all(names.flatMap((name) => eyes().map(async (eye) => {
    const image = new Image();
    image.src = file(name, eye);
    await image.decode();
    return image;
  })));
}

function show(images) {
  eyes().forEach((eye, k) => {
    const mine = images.filter((_, i) => i % eyes().length === k);
    eye.querySelector(".pictures").replaceChildren(...mine);
  });
}

const SIDES = '<div class="sides"><span>&larr; 1</span><span>2 &rarr;</span></div>';

async function look(trial, images) {
  say("");
  show([]);
  await wait(GAP);
  if (STUDY.together) {
    show(images);
    say(`<p>${STUDY.question}</p>${SIDES}`, true);
    return;
  }
  for (const part of [images.slice(0, eyes().length), images.slice(eyes().length)]) {
    show(part);
    await wait(1000 * STUDY.seconds);
    show([]);
    await wait(GAP);
  }
  say(`<p>${STUDY.question}</p>${SIDES}<small>&uarr; see both once more</small>`);
}

async function ask(trial, number) {
  const images = await prepared(trial);
  let again = 0;
  for (;;) {
    await look(trial, images);
    const began = performance.now();
    const action = await choose("first", "second", "again");
    if (action === "again") { again += 1; continue; }
    const seconds = Math.round(performance.now() - began) / 1000;
    return { trial: number, choice: action === "first" ? 1 : 2, seconds, again };
  }
}

async function pause(html) {
  show([]);
  say(html);
  at("stage").classList.add("rest");
  await choose("go");
  at("stage").classList.remove("rest");
}

// Answers

function warn(text) {
  at("warning").textContent = text;
  at("warning").hidden = !text;
}

async function keep() {
  const text = JSON.stringify(session);
  let safe = false;
  try { localStorage.setItem(store(), text); safe = true; } catch { /* private windows have none */ }
  if (!served) {
    if (!safe) warn("This browser keeps nothing: do not close the window before the file is saved.");
    return safe;
  }
  try {
    const reply = await fetch(`answers/${session.viewer}`, { method: "POST", body: text });
    if (!reply.ok) throw new Error(reply.status);
    warn("");
    return true;
  } catch {
    warn("Operator: answers are not kept on the disk. Is 'domesim study play' still running?");
    return false;
  }
}

async function kept(viewer) {
  const found = [];
  try { found.push(JSON.parse(localStorage.getItem(`domesim study ${STUDY.digest} viewer ${viewer}`))); } catch { /* none */ }
  if (served) {
    try {
      const reply = await fetch(`answers/${viewer}`);
      if (reply.status === 200) found.push(await reply.json());
    } catch { /* the first keep() will say so */ }
  }
  return found.filter((one) => one && one.study === STUDY.digest)
    .sort((a, b) => b.answers.length - a.answers.length)[0] || null;
}

function save() {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([JSON.stringify(session, null, 1)], { type: "application/json" }));
  link.download = `viewer-${String(session.viewer).padStart(3, "0")}.json`;
  link.click();
}

// The session

async function play() {
  const trials = STUDY.viewers[session.viewer - 1];
  const begin = session.answers.length;
  const counted = trials.findIndex((trial) => trial.kind !== "training");
  at("stage").hidden = false;
  at("desk").hidden = true;
  if (begin === 0) {
    const how = STUDY.together ? "You will see two pictures side by side." :
      "You will see two pictures, one after the other. Then you choose.";
    await pause(`<p>${how}</p><p>${STUDY.question}</p>${SIDES}
      <p>There are ${trials.length} pairs. A few to try come first.</p><small>Space: begin</small>`);
  } else {
    await pause("<p>We go on where we stopped.</p><small>Space: go on</small>");
  }
  let safe = true;
  for (let k = begin; k < trials.length; k += 1) {
    if (k === counted && k > 0) {
      await pause("<p>That was to try. Now it counts.</p><small>Space: begin</small>");
    } else if (k > begin && k > counted && (k - counted) % REST === 0) {
      await pause(`<p>Rest your eyes.</p><p>${k - counted} of ${trials.length - counted} are done.</p>
        <small>Space: go on when you like</small>`);
    }
    const answer = await ask(trials[k], k);
    session.answers.push(answer);
    safe = await keep();
    if (trials[k].kind === "training") {
      show([]);
      say(answer.choice === trials[k].right ? "<p>Yes: the other one was spoilt.</p>" :
        "<p>That one was spoilt. Look closely at the next pair.</p>");
      await wait(1500);
    }
  }
  show([]);
  say("<p>That was all. Thank you!</p>");
  at("stage").classList.add("rest");
  if (!served || !safe) save();
}

async function readiness() {
  const viewer = Number(at("viewer").value);
  const there = Number.isInteger(viewer) && viewer >= 1 && viewer <= STUDY.viewers.length;
  const found = there ? await kept(viewer) : null;
  const all = there ? STUDY.viewers[viewer - 1].length : 0;
  const done = found ? found.answers.length : 0;
  at("state").textContent = !there ? `Viewers have the numbers 1 to ${STUDY.viewers.length}.` :
    done === 0 ? `Viewer ${viewer} has not begun.` :
    done < all ? `Viewer ${viewer} has answered ${done} of ${all} and goes on there.` :
    `Viewer ${viewer} is done. Take the next number.`;
  at("begin").disabled = !there || done === all || !at("agreed").checked;
  return found;
}

function luminance(id) {
  const value = parseFloat(at(id).value);
  if (!Number.isFinite(value)) return null;
  return at("meter").value === "light meter" ? value / Math.PI : value;
}

function compare() {
  const white = luminance("white");
  const black = luminance("black");
  const off = white === null ? null : white / STUDY.white - 1;
  at("reading").textContent = off === null ? "" :
    Math.abs(off) <= 0.1 ? `White has ${white.toPrecision(3)} cd/m²: as it should be.` :
    `White has ${white.toPrecision(3)} cd/m², ${Math.abs(100 * off).toFixed(0)} % too ${off > 0 ? "bright" : "dark"}. ` +
    "Set the display's brightness, and read it once more.";
  if (black !== null && white !== null && black > white / 500) {
    at("reading").textContent += ` Black has 1/${(white / black).toFixed(0)} of it: much light is left in black. Darken the room.`;
  }
}

function patch(colour) {
  at("patch").style.background = colour;
  at("patch").hidden = false;
}

function restyle() {
  document.body.className = STUDY.stereo ? at("layout").value : "mono";
}

async function begin() {
  const viewer = Number(at("viewer").value);
  const found = await readiness();
  session = found || {
    study: STUDY.digest, viewer, name: "", began: new Date().toISOString(), layout: "", white: null,
    black: null, meter: "", resumed: 0, answers: [],
  };
  if (found && found.answers.length) session.resumed = (session.resumed || 0) + 1;
  session.layout = STUDY.stereo ? at("layout").value + (at("swap").checked ? ", swapped" : "") : "one";
  session.white = luminance("white") ?? session.white;
  session.black = luminance("black") ?? session.black;
  session.meter = at("white").value ? at("meter").value : session.meter;
  if (document.documentElement.requestFullscreen) {
    await document.documentElement.requestFullscreen().catch(() => {});
  }
  restyle();
  await play();
}

at("patch").addEventListener("click", () => { at("patch").hidden = true; });
document.addEventListener("keydown", () => { at("patch").hidden = true; });
for (const id of ["viewer", "agreed"]) at(id).addEventListener("input", readiness);
for (const id of ["white", "black", "meter"]) at(id).addEventListener("input", compare);
at("show-white").addEventListener("click", () => patch("#fff"));
at("show-black").addEventListener("click", () => patch("#000"));
if (STUDY.stereo) {
  for (const id of ["layout", "swap"]) at(id).addEventListener("input", restyle);
  at("show-eyes").addEventListener("click", async () => {
    restyle();
    at("desk").hidden = true;
    at("stage").hidden = false;
    eyes().forEach((eye) => {
      const left = eye.classList.contains("left") !== at("swap").checked;
      eye.querySelector(".words").innerHTML =
        `<p style="font-size:3em">${left ? "L" : "R"}</p><small>The ${left ? "left" : "right"} eye alone sees this. Space: back</small>`;
    });
    await choose("go");
    say("");
    at("stage").hidden = true;
    at("desk").hidden = false;
  });
}
at("begin").addEventListener("click", begin);
restyle();
readiness();
poll();
