// What a pointer and the keys do on the picture: zoom, pan, fly round a mesh, turn the light, read values, and ask
// what lights a place; and the bar of the wipe.

import { $, clamp, drags, readable } from "./dom.js";
import { nearer, orbited, panned } from "./mesh.js";

// A pointer that moved less than this, in CSS pixels, has clicked.
const CLICK = 4;
const KEY_STEP = 40;
const HOVER = 200;
const HINTS = {
  mesh: "Drag flies round, ctrl-drag moves, the wheel nears",
  picture: "Point at the picture to read its values",
  look: "; click asks which light reaches a place",
};
const READ = [["", "a"], ["B ", "b"], ["exact ", "exact"], ["bound ", "bound"]];

export function mountPointing(app, stage) {
  const { canvas } = stage;
  const pointers = new Map();
  let way = 0;
  let timer = null;

  const near = (times) => (stage.mesh ? stage.look(nearer(stage.camera, 1 / times)) : stage.magnify(times));
  const orbit = (dx, dy, pans) => {
    const [x, y] = stage.shares(dx, dy);
    stage.look(pans ? panned(stage.camera, stage.aspect, x, y) : orbited(stage.camera, x, y));
  };

  drags(canvas, {
    down: (event) => {
      way = 0;
      study(app.view.values.probed);
      pointers.set(event.pointerId, event);
    },
    move: (dx, dy, event) => {
      way += Math.abs(dx) + Math.abs(dy);
      if (pointers.size > 1) return;
      if (event.shiftKey) app.tell("turn", dx, dy, event.altKey);
      else if (stage.mesh) orbit(dx, dy, event.ctrlKey || event.metaKey);
      else stage.pan(dx, dy);
    },
    up: (event) => {
      pointers.delete(event.pointerId);
      const at = stage.pixel(event).map(Math.floor);
      const clicks = way < CLICK && event.type === "pointerup";
      if (clicks && !stage.mesh && stage.holds(at)) app.tell("click", ...at);
      probe(event);
    },
  });
  canvas.addEventListener("pointermove", (event) => {
    pinch(event);
    probe(event);
  });
  canvas.addEventListener("pointerleave", () => study(null));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const times = Math.exp(-0.0015 * event.deltaY);
    // With Shift some browsers turn the wheel sideways.
    if (event.shiftKey) app.tell("turn", 10 * Math.sign(event.deltaY || event.deltaX), 0, false);
    else if (stage.mesh) near(times);
    else stage.magnify(times, event);
  }, { passive: false });
  canvas.addEventListener("dblclick", () => stage.fit());
  canvas.addEventListener("keydown", (event) => {
    if (!key(event)) return;
    event.preventDefault();
    event.stopPropagation();
  });

  /** Two fingers: their distance is the zoom. */
  function pinch(event) {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    if (pointers.size === 2) {
      const still = [...pointers.values()].find((one) => one.pointerId !== event.pointerId);
      const apart = (one) => Math.hypot(one.clientX - still.clientX, one.clientY - still.clientY) || 1;
      const times = apart(event) / apart(before);
      if (stage.mesh) near(times);
      else stage.magnify(times, still);
    }
    pointers.set(event.pointerId, event);
  }

  function key(event) {
    const step = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (event.key === "+" || event.key === "=") near(1.25);
    else if (event.key === "-") near(0.8);
    else if (event.key === "0") stage.fit();
    else if (event.key === "Enter" && !stage.mesh) ask();
    else if (!step) return false;
    else if (event.shiftKey) app.tell("turn", -0.25 * KEY_STEP * step[0], -0.25 * KEY_STEP * step[1], event.altKey);
    else if (stage.mesh) orbit(KEY_STEP * step[0], KEY_STEP * step[1], event.ctrlKey);
    else stage.pan(KEY_STEP * step[0], KEY_STEP * step[1]);
    return true;
  }

  /** By key, the pixel in the middle of what is shown is the one that is asked about. */
  function ask() {
    const pixel = (share, k) => clamp(Math.floor(share * stage.size[k]), 0, stage.size[k] - 1);
    app.tell("click", ...stage.middle.map(pixel));
  }

  // The values under the pointer

  function probe(event) {
    if (stage.mesh || event.buttons) return;
    const at = stage.pixel(event).map(Math.floor);
    if (!stage.holds(at)) return study(null);
    app.view.set({ probed: at });
    if (!app.view.values.studied) timer ??= setTimeout(() => app.view.set({ studied: true }), HOVER);
  }

  /** A pixel's values of now; exact one and bound are asked for once the pointer stays and nothing is dragged. */
  function study(at) {
    clearTimeout(timer);
    timer = null;
    app.view.set({ probed: at, studied: false });
  }

  app.showProbe = () => {
    const at = app.view.values.probed;
    const there = ([, name]) => stage.picture.layers[name] && (name === "a" || app.wanted.includes(name));
    const three = ([title, name]) => title + stage.picture.at(name, ...at).map(readable).join(" ");
    const read = at && READ.filter(there).map(three);
    const picture = HINTS.picture + (app.welcome.columns?.size ? HINTS.look : "");
    const hint = stage.mesh ? HINTS.mesh : picture;
    $("probe").textContent = read ? `(${at.join(", ")})  ${read.join("  |  ")}` : hint;
  };
  app.on("welcome", app.showProbe);
  app.view.on((keys) => keys.includes("probed") && app.showProbe());
  mountWipe(app, stage);
}

function mountWipe(app, stage) {
  const bar = $("wipe-bar");
  const by = (share) => app.view.set({ at: clamp(app.view.values.at + share, 0, 1) });
  drags(bar, { move: (dx) => by(stage.shares(dx, 0)[0]) });
  bar.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
    if (!way) return;
    event.preventDefault();
    by(way);
  });

  const place = () => {
    if (!stage.size) return;
    const { at, wipe, with: other } = app.view.values;
    bar.hidden = !wipe;
    bar.style.left = `${stage.left + at * stage.size[0] * stage.scale}px`;
    bar.setAttribute("aria-valuenow", Math.round(100 * at));
    $("wipe-left").textContent = app.nameOf("a");
    $("wipe-right").textContent = app.nameOf(other);
  };
  app.on("placed", place);
  app.view.on((keys) => keys.some((key) => ["wipe", "at", "with"].includes(key)) && place());
  app.shared.on((keys) => keys.includes("method") && place());
}
