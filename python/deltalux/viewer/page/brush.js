// The brush: it paints radiance on the strip, by pointer or by keys, into a group of its own.

import { fromHex } from "./colours.js";
import { $, clamp, pressed, slider } from "./dom.js";
import { wrapped } from "./geometry.js";
import { freeId } from "./light.js";

const STEP = 5;
const SIZES = { low: 1, high: 45, scale: "log", unit: "°" };
const GAINS = { low: -6, high: 12, step: 0.5, unit: "stops" };

export function mountBrush(app, strip) {
  const brush = { on: false, radius: 6, stops: 2, cursor: [180, 0], last: null, group: null, points: [] };
  const cursor = $("brush-cursor");

  const size = slider("brush-size", "Size", SIZES, (value) => ((brush.radius = value), show()));
  const strength = slider("brush-gain", "Gain", GAINS, (value) => (brush.stops = value));
  $("brush-slot").append(size.element, strength.element);
  size.set(brush.radius);
  strength.set(brush.stops);
  $("brush").onclick = () => {
    brush.on = !brush.on;
    pressed($("brush"), brush.on);
    strip.classList.toggle("painting", brush.on);
    show();
  };

  function show() {
    cursor.hidden = !brush.on;
    const [azimuth, elevation] = brush.cursor;
    Object.assign(cursor.style, {
      left: `${wrapped(azimuth) / 3.6}%`,
      top: `${(90 - elevation) / 1.8}%`,
      width: `${(2 * brush.radius) / 3.6}%`,
      height: `${(2 * brush.radius) / 1.8}%`,
    });
  }

  function dab([azimuth, elevation]) {
    brush.cursor = [azimuth, elevation];
    show();
    brush.group = paintGroup();
    if (!brush.group) return;
    if (!brush.points.length) app.before(send);
    // Dabs no further apart than half the brush, whatever the pointer skipped.
    const [x, y] = brush.last ?? brush.cursor;
    const count = Math.max(1, Math.ceil(Math.hypot(azimuth - x, elevation - y) / (0.5 * brush.radius)));
    for (let k = 1; k <= count; k++) {
      brush.points.push([wrapped(x + ((azimuth - x) * k) / count), y + ((elevation - y) * k) / count]);
    }
    brush.last = brush.cursor;
  }

  function send() {
    const colour = fromHex($("brush-colour").value).map((value) => value * 2 ** brush.stops);
    app.send({ paint: { id: brush.group, points: brush.points.splice(0), radius: brush.radius, colour } });
  }

  function paintGroup() {
    const found = app.shared.values.light.groups.find((group) => group.kind === "paint");
    if (found) return found.id;
    const id = freeId(app, "p");
    return app.addGroup({ id, kind: "paint" }) ? id : null;
  }

  return {
    get on() {
      return brush.on;
    },
    dab,
    lift: () => (brush.last = null),
    hover: (at) => {
      if (!brush.on) return;
      brush.cursor = at;
      show();
    },
    key: (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!way && event.key !== " " && event.key !== "Enter") return;
      event.preventDefault();
      event.stopPropagation();
      const [azimuth, elevation] = brush.cursor;
      if (way) brush.cursor = [wrapped(azimuth + STEP * way[0]), clamp(elevation + STEP * way[1], -90, 90)];
      else dab(brush.cursor);
      brush.last = null;
      show();
    },
  };
}
