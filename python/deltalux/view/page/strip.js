// The sphere of light as a lat-long strip: it turns the environment, holds the lamps' handles, and takes the brush.

import { encoded, fromHex } from "./colours.js";
import { $, clamp, drags, element, pressed, slider } from "./dom.js";
import { about, azimuthOf, between, direction, product } from "./geometry.js";
import { floats } from "./layers.js";
import { activeEnvironment, changeGroup, freeId } from "./light.js";

const STEP = 5;
// Degrees of turn for a pixel of a drag on the picture.
const DEGREES = 0.4;
// What the mean of the strip's logarithms is shown as.
const MIDDLE = 0.18;

export function mountStrip(app) {
  const strip = $("strip");
  const brush = { on: false, radius: 6, stops: 2, points: [], group: null, last: null };

  const rotate = slider("rotate", "Turn", { low: 0, high: 360, step: 1, unit: "°" }, (value) => {
    const group = activeEnvironment(app);
    if (group) turnBy(about(value - azimuthOf(group.turn)));
  });
  $("rotate-slot").append(rotate.element);

  const turnBy = (turn) => {
    const group = activeEnvironment(app);
    if (group) changeGroup(app, group.id, { turn: product(turn, group.turn) });
  };

  /** Azimuth and elevation under a pointer. */
  const at = (event) => {
    const box = strip.getBoundingClientRect();
    const across = (event.clientX - box.left) / box.width;
    const down = clamp((event.clientY - box.top) / box.height, 0, 1);
    return [360 * across, 90 - 180 * down];
  };

  let before = null;
  drags(strip, {
    down: (event) => {
      before = at(event);
      if (brush.on) dab(event);
    },
    move: (dx, dy, event) => {
      const now = at(event);
      if (brush.on) dab(event);
      else if (event.altKey) turnBy(between(direction(...before), direction(...now)));
      else turnBy(about(now[0] - before[0]));
      before = now;
    },
    up: () => (brush.group = brush.last = null),
  });
  strip.addEventListener("wheel", (event) => {
    event.preventDefault();
    turnBy(about(STEP * Math.sign(event.deltaY || event.deltaX)));
  }, { passive: false });
  strip.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -6, PageUp: 6 }[event.key];
    if (!way) return;
    event.preventDefault();
    turnBy(event.altKey ? tilt(way * STEP) : about(way * STEP));
  });
  app.on("turn", (dx, dy, free) => turnBy(free ? product(about(dx * DEGREES), tilt(dy * DEGREES)) : about(dx * DEGREES)));

  /** A turn that lifts what lies ahead, in the middle of the strip. */
  const tilt = (degrees) => between(direction(180, 0), direction(180, clamp(degrees, -90, 90)));

  // The brush

  const size = slider("brush-size", "Size", { low: 1, high: 45, scale: "log", unit: "°" }, (value) => (brush.radius = value));
  const strength = slider("brush-gain", "Gain", { low: -6, high: 12, step: 0.5, unit: "stops" }, (value) => (brush.stops = value));
  $("brush-slot").append(size.element, strength.element);
  size.set(brush.radius);
  strength.set(brush.stops);
  $("brush").onclick = () => {
    brush.on = !brush.on;
    pressed($("brush"), brush.on);
    strip.classList.toggle("painting", brush.on);
  };

  function dab(event) {
    brush.group ??= paintGroup();
    if (!brush.group) return;
    const [azimuth, elevation] = at(event);
    if (!brush.points.length) app.before(() => sendDabs());
    // Dabs no further apart than half the brush, whatever the pointer skipped.
    const [x, y] = brush.last ?? [azimuth, elevation];
    const count = Math.max(1, Math.ceil(Math.hypot(azimuth - x, elevation - y) / (0.5 * brush.radius)));
    for (let k = 1; k <= count; k++) {
      const along = k / count;
      brush.points.push([(x + (azimuth - x) * along + 360) % 360, y + (elevation - y) * along]);
    }
    brush.last = [azimuth, elevation];
  }

  function sendDabs() {
    const colour = fromHex($("brush-colour").value).map((value) => value * 2 ** brush.stops);
    app.send({ paint: { id: brush.group ?? brush.latest, points: brush.points.splice(0), radius: brush.radius, colour } });
  }

  function paintGroup() {
    const groups = app.shared.values.light.groups;
    const found = groups.find((group) => group.kind === "paint");
    const id = found?.id ?? freeId(app, "p");
    if (!found && !app.addGroup({ id, kind: "paint" })) return null;
    return (brush.latest = id);
  }

  // What is drawn

  app.on("strip", (values) => paintStrip(strip, floats(values)));
  const handles = new Map();
  app.shared.on((keys) => keys.includes("light") && update());
  app.on("welcome", update);

  function update() {
    const { light } = app.shared.values;
    if (!light) return;
    const group = activeEnvironment(app);
    $("rotate-slot").hidden = !group;
    if (group) {
      rotate.set(azimuthOf(group.turn));
      strip.setAttribute("aria-valuenow", Math.round(azimuthOf(group.turn)));
    }
    const lamps = light.groups.filter((one) => one.kind === "lamp");
    for (const [id, handle] of handles) {
      if (lamps.some((lamp) => lamp.id === id)) continue;
      handle.remove();
      handles.delete(id);
    }
    for (const lamp of lamps) placeHandle(handles.get(lamp.id) ?? makeHandle(lamp.id), lamp);
  }

  function makeHandle(id) {
    const handle = element("button", { type: "button", id: `handle-${id}`, className: "handle" });
    const lamp = () => app.shared.values.light.groups.find((group) => group.id === id);
    const move = (azimuth, elevation) => changeGroup(app, id, {
      azimuth: ((azimuth % 360) + 360) % 360, elevation: clamp(elevation, -90, 90),
    });
    drags(handle, { move: (dx, dy, event) => move(...at(event)) });
    handle.onkeydown = (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!way) return;
      event.preventDefault();
      move(lamp().azimuth + way[0] * STEP, lamp().elevation + way[1] * STEP);
    };
    handles.set(id, handle);
    $("lamp-handles").append(handle);
    return handle;
  }

  function placeHandle(handle, { id, azimuth, elevation, mute }) {
    handle.style.left = `${(100 * azimuth) / 360}%`;
    handle.style.top = `${(100 * (90 - elevation)) / 180}%`;
    handle.classList.toggle("muted", mute);
    handle.setAttribute("aria-label", `Lamp ${id}: azimuth ${Math.round(azimuth)}°, elevation ${Math.round(elevation)}°`);
  }
}

function paintStrip(canvas, values) {
  const image = new ImageData(canvas.width, canvas.height);
  const gain = MIDDLE / Math.max(1e-9, middle(values));
  for (let i = 0, o = 0; i < values.length; i += 3, o += 4) {
    for (let k = 0; k < 3; k++) image.data[o + k] = 255 * encoded(Math.max(0, values[i + k] * gain));
    image.data[o + 3] = 255;
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
}

/** The mean of the logarithms of what shines: a sun in it counts as one of many. */
export function middle(values) {
  let sum = 0;
  let count = 0;
  for (let i = 0; i < values.length; i += 3) {
    const most = Math.max(values[i], values[i + 1], values[i + 2]);
    if (!(most > 1e-6)) continue;
    sum += Math.log(most);
    count += 1;
  }
  return count ? Math.exp(sum / count) : 1;
}
