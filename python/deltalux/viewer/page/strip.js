// The sphere of light as a lat-long strip: it turns the environment, holds the lamps' handles, and takes the brush.

import { mountBrush } from "./brush.js";
import { encoded } from "./colours.js";
import { $, clamp, drags, element, slider } from "./dom.js";
import { about, azimuthOf, between, direction, product, wrapped } from "./geometry.js";
import { floats } from "./layers.js";
import { activeEnvironment, changeGroup } from "./light.js";

const STEP = 5;
// Degrees of turn for a pixel of a drag on the picture.
const DEGREES = 0.4;
// What the mean of the strip's logarithms is shown as.
const MIDDLE = 0.18;

/** A turn that lifts what lies ahead, in the middle of the strip. */
const tilt = (degrees) => between(direction(180, 0), direction(180, clamp(degrees, -90, 90)));

export function mountStrip(app) {
  const strip = $("strip");
  const brush = mountBrush(app, strip);

  const turnBy = (turn) => {
    const group = activeEnvironment(app);
    if (group) changeGroup(app, group.id, { turn: product(turn, group.turn) });
  };
  const rotate = slider("rotate", "Turn", { low: 0, high: 360, step: 1, unit: "°" }, (value) => {
    turnBy(about(value - azimuthOf(activeEnvironment(app).turn)));
  });
  $("rotate-slot").append(rotate.element);

  /** Azimuth and elevation under a pointer. */
  const at = (event) => {
    const box = strip.getBoundingClientRect();
    const down = clamp((event.clientY - box.top) / box.height, 0, 1);
    return [(360 * (event.clientX - box.left)) / box.width, 90 - 180 * down];
  };

  let before = null;
  drags(strip, {
    down: (event) => {
      before = at(event);
      if (brush.on) brush.dab(before);
    },
    move: (dx, dy, event) => {
      const now = at(event);
      if (brush.on) brush.dab(now);
      else if (event.altKey) turnBy(between(direction(...before), direction(...now)));
      else turnBy(about(now[0] - before[0]));
      before = now;
    },
    up: () => brush.lift(),
  });
  strip.addEventListener("pointermove", (event) => event.buttons || brush.hover(at(event)));
  strip.addEventListener("wheel", (event) => {
    event.preventDefault();
    turnBy(about(STEP * Math.sign(event.deltaY || event.deltaX)));
  }, { passive: false });
  strip.addEventListener("keydown", (event) => {
    if (brush.on) return brush.key(event);
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -6, PageUp: 6 }[event.key];
    if (!way) return;
    event.preventDefault();
    turnBy(event.altKey ? tilt(way * STEP) : about(way * STEP));
  });
  app.on("turn", (dx, dy, free) => {
    const level = about(dx * DEGREES);
    turnBy(free ? product(level, tilt(dy * DEGREES)) : level);
  });

  app.on("strip", (values) => paintStrip(strip, floats(values)));
  const placeHandles = mountHandles(app, at);
  const update = () => {
    const { light } = app.shared.values;
    if (!light) return;
    placeHandles(light.groups.filter(({ kind }) => kind === "lamp"));
    const group = activeEnvironment(app);
    $("rotate-slot").hidden = !group;
    if (!group) return;
    rotate.set(azimuthOf(group.turn));
    strip.setAttribute("aria-valuenow", Math.round(azimuthOf(group.turn)));
  };
  app.shared.on((keys) => keys.includes("light") && update());
  app.on("welcome", update);
}

/** A handle on the strip for each lamp. */
function mountHandles(app, at) {
  const handles = new Map();

  function make(id) {
    const handle = element("button", { type: "button", id: `handle-${id}`, className: "handle" });
    const lamp = () => app.shared.values.light.groups.find((group) => group.id === id);
    const move = (azimuth, elevation) =>
      changeGroup(app, id, { azimuth: wrapped(azimuth), elevation: clamp(elevation, -90, 90) });
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

  return (lamps) => {
    for (const [id, handle] of handles) {
      if (lamps.some((lamp) => lamp.id === id)) continue;
      handle.remove();
      handles.delete(id);
    }
    for (const { id, azimuth, elevation, mute } of lamps) {
      const handle = handles.get(id) ?? make(id);
      handle.style.left = `${(100 * azimuth) / 360}%`;
      handle.style.top = `${(100 * (90 - elevation)) / 180}%`;
      handle.classList.toggle("muted", mute);
      handle.title = `${id}: azimuth ${Math.round(azimuth)}°, elevation ${Math.round(elevation)}°`;
      handle.setAttribute("aria-label", `Lamp ${handle.title}`);
    }
  };
}

function paintStrip(canvas, values) {
  const image = new ImageData(canvas.width, canvas.height);
  const gain = MIDDLE / middle(values);
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
    sum += Math.log(Math.min(most, 65504));
    count += 1;
  }
  return count ? Math.exp(sum / count) : 1;
}
