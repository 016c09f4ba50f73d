// Puts the page together: what arrives goes to the rooms that show it, what they change goes out once per frame.
//
// For tests and the curious: `window.deltalux` has `frame` (header of the last frame), `layers` (name -> the full
// picture or mesh as shown, Float32Array or half floats as Uint16Array), `readPixels()` (the canvas, RGBA, rows from
// the top), `stats` (the last that came), `state` (as shared), `view` (this page's own) and `fps` (frames shown in the
// last second).

import { mountCubemap } from "./cubemap.js";
import { Connection } from "./connection.js";
import { $, element, pressed } from "./dom.js";
import { mountKeys } from "./keys.js";
import { mountLamps } from "./lamps.js";
import { numbers } from "./layers.js";
import { mountLight } from "./light.js";
import { mountMaterials } from "./materials.js";
import { mountMethod } from "./method.js";
import { mountOut } from "./out.js";
import { mountPlots } from "./plots.js";
import { mountPointing } from "./pointing.js";
import { mountShowing } from "./showing.js";
import { Stage } from "./stage.js";
import { History, pick, Store } from "./state.js";
import { mountStrip } from "./strip.js";
import { mountTimeline } from "./timeline.js";

const PROBLEMS = 5;
const PROBLEM_SECONDS = 8;
// The exposure comes this near to what the picture asks for in a second: 1 - 1/e, four times over.
const FOLLOWING = 4;
const NAMES = { a: "A", exact: "exact", b: "B", kept: "kept" };

const app = {
  shared: new Store(),
  view: new Store({
    mode: "beauty", tone: "agx", exposure: 0, locked: false, wipe: false, with: "exact", at: 0.5,
    luminance: false, zebra: false, probed: null, studied: false,
    // Full scale of the maps, shares of white.
    full: { error: 1, ghosts: 0.1, bound: 10 },
  }),
  welcome: null,
  stats: null,
  // Layers besides "a" that are kept up to date; others may still lie here from before.
  wanted: [],
  // What is read rather than seen is drawn again after this many milliseconds: each takes its part of a frame.
  often: 100,
  listeners: {},
  on: (kind, act) => (app.listeners[kind] ??= []).push(act),
  tell: (kind, ...told) => app.listeners[kind]?.forEach((act) => act(...told)),
  send: (message) => (connection.later(message), wake()),
  redraw: () => ((dirty = true), wake()),
  /** Runs once before what is queued goes out with the next frame. */
  before: (act) => (firsts.push(act), wake()),
  /** Runs once with the next frame, however often it was asked for; and no sooner than `every` milliseconds after. */
  soon: (name, act, every = 0) => (pending.set(name, { act, every }), wake()),
  /** Keeps the picture as it was before the first edit, to compare with. */
  keepFirst: () => stage.picture.layers.kept || (stage.picture.keep(), app.view.set({ with: "kept" })),
  say,
  fail: (sentence) => Object.assign($("lost"), { textContent: sentence, hidden: false }),
  nameOf: (side) => {
    const method = app.shared.values.method?.[side];
    return method ? (app.welcome.methods.find(({ name }) => name === method.name)?.title ?? method.name) : NAMES[side];
  },
};

// As in style.css: below this width all but the picture and the strip is a drawer.
const narrow = matchMedia("(max-width: 860px)");
narrow.onchange = () => wake();
let dirty = false;
let awake = false;
let sent = false;
let alarm = null;
let before = 0;
const changed = new Set();
const firsts = [];
const pending = new Map();
const ran = new Map();
const acks = [];
const shownAt = [];
let wanted = "";

app.history = new History(app.shared);
app.shared.on((keys, from) => {
  if (from === "here") keys.forEach((key) => changed.add(key));
  // The first change since the last frame goes out at once, those that follow with the next frame, the newest of each.
  if (changed.size && !sent) queueMicrotask(sendState);
  wake();
});
app.view.on(() => wake());
const stage = new Stage(app);
const rooms = [
  mountShowing, mountPointing, mountMethod, mountLight, mountStrip, mountMaterials, mountLamps, mountCubemap,
  mountPlots, mountTimeline, mountOut, mountKeys,
];
for (const mount of rooms) mount(app, stage);
$("drawer").onclick = () => {
  const open = document.body.classList.toggle("open");
  $("drawer").setAttribute("aria-expanded", String(open));
  wake();
};
$("wide").onclick = () => {
  pressed($("wide"), document.body.classList.toggle("wide"));
  wake();
};
const connection = new Connection({ text, binary, lost: app.fail, refused });

// What goes on in a frame of the display

function wake() {
  if (awake) return;
  awake = true;
  requestAnimationFrame(tick);
}

function tick(now) {
  awake = false;
  const seconds = Math.min(0.1, (now - before) / 1000);
  before = now;
  for (const act of firsts.splice(0)) act();
  want();
  sendState();
  connection.flush();
  sent = false;
  if (!app.welcome) return;
  follow(seconds);
  if (dirty) stage.draw();
  dirty = false;
  for (const [name, { act, every }] of [...pending]) {
    const wait = (ran.get(name) ?? -Infinity) + every - now;
    if (wait > 0) {
      alarm ??= setTimeout(() => ((alarm = null), wake()), wait);
      continue;
    }
    pending.delete(name);
    ran.set(name, now);
    act();
  }
  // A frame is acknowledged once it is drawn: a slow card slows the server, and a hidden page stops it.
  for (const n of acks.splice(0)) connection.now({ ack: n });
}

function sendState() {
  if (changed.size) connection.now({ state: pick(app.shared.values, [...changed]) });
  changed.clear();
  sent = true;
}

/** The exposure goes to what the picture asks for, smoothly, until it is locked. */
function follow(seconds) {
  const { exposure, locked } = app.view.values;
  const asked = app.stats?.auto;
  if (locked || !Number.isFinite(asked) || asked === exposure) return;
  const rest = asked - exposure;
  const first = shownAt.length < 2;
  const there = first || Math.abs(rest) < 0.01;
  app.view.set({ exposure: there ? asked : exposure + rest * (1 - Math.exp(-FOLLOWING * seconds)) });
}

/** Asks for the layers that are looked at, when that changes. */
function want() {
  if (!app.welcome) return;
  const { mode, wipe, with: other, studied, exposure, tone, luminance, zebra } = app.view.values;
  const layers = [];
  if (app.shared.values.method?.b) layers.push("b");
  // A JPEG does for looking at; what is measured or compared is sent as it is.
  const looks = mode === "beauty" && !wipe && !studied && !luminance && !zebra;
  const shown = { quality: looks ? "auto" : "lossless", exposure: Number(exposure.toFixed(2)), tone };
  if (!app.compares) return ask({ layers, maps: false, ...shown });
  if (["error", "ghosts", "difference"].includes(mode) || (wipe && other === "exact") || studied) layers.push("exact");
  if (mode === "bound" || studied) layers.push("bound");
  const seen = document.body.classList;
  const maps = Boolean(app.welcome.columns?.size) && (narrow.matches ? seen.contains("open") : !seen.contains("wide"));
  ask({ layers, maps, ...shown });
}

function ask(message) {
  app.wanted = message.layers;
  const text = JSON.stringify(message);
  if (text === wanted) return;
  wanted = text;
  connection.later({ want: message });
}

// What arrives

function text(message) {
  if (message.welcome) return greet(message.welcome);
  if (message.replaced) return begin(message.replaced);
  // What this page has asked for without knowing what it makes is a step of its own, to be undone.
  if (message.state) app.shared.set(message.state, message.by === app.client ? "asked" : "there");
  if (message.view) app.tell("opened", message.view);
  if (message.problem) say(message.problem);
  if (message.text) app.tell("text", message.text);
  if (message.curve) app.tell("curve", message.curve);
  if (message.sources) {
    app.welcome = { ...app.welcome, sources: message.sources };
    app.tell("sources");
  }
  if ("progress" in message) progress(message.progress);
}

/** Of a new connection, nothing is owed to the one before. */
function greet(welcome) {
  acks.length = 0;
  changed.clear();
  app.client = welcome.client;
  begin(welcome);
}

function begin(welcome) {
  app.welcome = welcome;
  wanted = "";
  shownAt.length = 0;
  $("lost").hidden = true;
  $("progress").hidden = true;
  $("title").textContent = document.title = welcome.title;
  $("facts").replaceChildren(...[...welcome.facts, ["deltalux", welcome.version]].flatMap(([name, value]) => [
    element("dt", { textContent: name }), element("dd", { textContent: value }),
  ]));
  app.shared.begin(welcome.state);
  app.compares = ["pixels", "vertices"].includes(welcome.kind);
  $("sky").hidden = !welcome.state.light;
  for (const id of ["strip-box", "strip-hint", "brush-part"]) $(id).hidden = !welcome.columns?.size;
  stage.begin(welcome);
  app.tell("welcome");
  app.redraw();
}

async function binary(header, buffer, start) {
  const parts = header.parts.map((part) => ({ ...part, values: numbers(part, buffer, start) }));
  const named = (name) => parts.find((part) => part.name === name)?.values;
  const bytes = (part) => new Uint8Array(buffer, start + part.offset, part.bytes);
  if (header.kind === "frame") await frame(header, parts, bytes);
  else if (header.kind === "still") stage.rest(named("still"), header.camera);
  else if (header.kind === "mesh") stage.mesh?.take({ position: named("position"), triangles: named("triangles") });
  else if (header.kind === "maps") app.tell("maps", { asked: named("asked"), applied: named("applied") });
  else if (header.kind === "strip") app.tell("strip", named("strip"));
  else if (header.kind === "row") app.tell("row", header, named("row"));
  else if (header.kind === "file") app.tell("file", header, bytes(header.parts[0]));
  acks.push(header.n);
  wake();
}

async function frame(header, parts, bytes) {
  for (const part of parts.filter(({ type }) => type === "jpeg")) {
    stage.picture.putShown(part.name, await createImageBitmap(new Blob([bytes(part)], { type: "image/jpeg" })));
  }
  stage.frame(parts.filter(({ values }) => values));
  api.frame = header;
  if (header.stats) {
    app.stats = header.stats;
    app.tell("stats", header.stats);
    if (header.stats.rate) $("rate").title = `Frames a second, here; the server's ${header.stats.rate.toFixed(1)}`;
  }
  const now = performance.now();
  shownAt.push(now);
  while (shownAt[0] < now - 1000) shownAt.shift();
  app.soon("told", showNumbers, app.often);
}

function showNumbers() {
  $("rate").textContent = `${shownAt.length} /s`;
  if (app.view.values.probed) app.showProbe();
  app.showHistogram();
}

/** How far a finer picture is; null: there is none in the making. */
function progress(made) {
  $("progress").hidden = !made;
  if (!made) return;
  $("progress-text").textContent = made.what;
  $("progress-bar").value = made.share;
}

function refused() {
  for (const part of document.querySelectorAll("body > header, body > main")) part.hidden = true;
  $("refused").hidden = false;
}

function say(sentence) {
  const told = element("p", { textContent: sentence });
  $("problems").append(told);
  while ($("problems").children.length > PROBLEMS) $("problems").firstChild.remove();
  setTimeout(() => told.remove(), 1000 * PROBLEM_SECONDS);
}

const api = {
  frame: null,
  get layers() {
    return stage.shown.layers;
  },
  readPixels: () => stage.pixels(),
  get stats() {
    return app.stats;
  },
  get state() {
    return app.shared.values;
  },
  get view() {
    return app.view.values;
  },
  get fps() {
    return shownAt.filter((time) => time > performance.now() - 1000).length;
  },
};
window.deltalux = api;
