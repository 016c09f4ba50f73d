// Lamps of a studio: a list with their strengths, and handles in the picture where the camera sees them.

import { $, button, div, drags, element, slider } from "./dom.js";
import { add, dragged, frame, seen } from "./geometry.js";
import { coloured } from "./materials.js";

// Shares of the picture that a key moves a handle by.
const KEY_STEP = 0.02;
const ANGLES = { low: 1, high: 89, step: 1, unit: "°" };

export function mountLamps(app, stage) {
  const rows = new Map();
  const handles = new Map();
  const lamps = () => app.shared.values.lamps ?? [];
  const put = (list) => app.shared.set({ lamps: list });
  const change = (id, changes) => put(lamps().map((lamp) => (lamp.id === id ? { ...lamp, ...changes } : lamp)));
  const aims = ({ kind }) => kind !== "point";

  app.on("welcome", () => {
    $("studio-lamps").hidden = !app.shared.values.lamps;
    for (const held of [rows, handles]) {
      for (const one of held.values()) one.element.remove();
      held.clear();
    }
    const kinds = ["point", "spot", "area"].map((kind) => button(`add-${kind}`, `+ ${kind}`, () => addLamp(kind)));
    $("studio-lamps-body").replaceChildren(div("row", ...kinds));
    update();
  });
  app.shared.on((keys) => keys.includes("lamps") && update());
  app.on("placed", () => place());

  function addLamp(kind) {
    const { camera } = app.welcome;
    const { right, up } = frame(camera);
    const away = Math.hypot(...add(camera.position, camera.target, -1));
    const reach = away * Math.tan((camera.fov * Math.PI) / 360);
    // Where the picture shows it, each a little further to the side.
    const position = add(add(camera.target, up, 0.6 * reach), right, (0.1 + 0.15 * lamps().length) * reach);
    const taken = new Set(lamps().map((lamp) => lamp.id));
    let number = 1;
    while (taken.has(`l${number}`)) number += 1;
    // As bright at the target as a lamp of intensity 1 at distance 1.
    const intensity = Array(3).fill(away * away);
    const lamp = { id: `l${number}`, kind, position, target: camera.target, angle: 30, size: 0.1 * away, intensity };
    put([...lamps(), lamp]);
  }

  function update() {
    const ids = new Set(lamps().map((lamp) => lamp.id));
    for (const [id, row] of rows) {
      if (ids.has(id)) continue;
      row.element.remove();
      rows.delete(id);
    }
    for (const lamp of lamps()) {
      if (!rows.has(lamp.id)) {
        rows.set(lamp.id, lampRow(lamp));
        $("studio-lamps-body").prepend(rows.get(lamp.id).element);
      }
      rows.get(lamp.id).update(lamp);
    }
    place();
  }

  function lampRow({ id, kind, size, intensity }) {
    const about = (value) => ({ low: value / 1000, high: value * 1000, scale: "log" });
    const set = (value) => change(id, { intensity: value });
    const sliders = { intensity: coloured(`intensity-${id}`, "Strength", about(Math.max(1e-3, ...intensity)), set) };
    if (kind === "spot") sliders.angle = slider(`angle-${id}`, "Angle", ANGLES, (angle) => change(id, { angle }));
    if (kind === "area") sliders.size = slider(`size-${id}`, "Edge", about(size), (edge) => change(id, { size: edge }));
    const takeAway = () => put(lamps().filter((lamp) => lamp.id !== id));
    const remove = button(`remove-${id}`, "×", takeAway, { ariaLabel: `Remove ${id}` });
    const head = div("head", element("b", { className: "name", textContent: `${kind} · ${id}` }), remove);
    return {
      element: div("group", head, ...Object.values(sliders).map((one) => one.element)),
      update(lamp) {
        for (const [name, one] of Object.entries(sliders)) one.set(lamp[name]);
      },
    };
  }

  /** Puts a handle on each lamp and each target that the camera sees. */
  function place() {
    if (!stage.camera || !stage.scale) return;
    const points = lamps().flatMap((lamp) => [
      { key: lamp.id, lamp, name: "position" },
      ...(aims(lamp) ? [{ key: `${lamp.id}-target`, lamp, name: "target" }] : []),
    ]);
    for (const [key, handle] of handles) {
      if (points.some((point) => point.key === key)) continue;
      handle.element.remove();
      handles.delete(key);
    }
    for (const { key, lamp, name } of points) {
      if (!handles.has(key)) handles.set(key, makeHandle(key, lamp.id, name));
      const at = seen(stage.camera, stage.aspect, lamp[name]);
      const { element: handle } = handles.get(key);
      handle.hidden = !at;
      if (!at) continue;
      handle.style.left = `${stage.left + at.x * stage.size[0] * stage.scale}px`;
      handle.style.top = `${stage.top + at.y * stage.size[1] * stage.scale}px`;
    }
  }

  function makeHandle(key, id, name) {
    const handle = button(`lamp-${key}`, "", null, {
      className: name === "target" ? "handle target" : "handle",
      title: key,
      ariaLabel: `The ${name} of lamp ${id}: drag or arrow keys; with Alt nearer and further`,
    });
    const move = (dx, dy, alt) => {
      const point = lamps().find((lamp) => lamp.id === id)[name];
      const { depth } = seen(stage.camera, stage.aspect, point);
      const away = add(point, stage.camera.position, -1);
      // With Alt, along the line of sight, so that it stays where it is seen.
      const further = () => add(stage.camera.position, away, Math.max(0.05, 1 - 2 * dy));
      const across = () => add(point, dragged(stage.camera, stage.aspect, depth, dx, dy));
      change(id, { [name]: alt ? further() : across() });
    };
    drags(handle, { move: (dx, dy, event) => move(...stage.shares(dx, dy), event.altKey) });
    handle.onkeydown = (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!way) return;
      event.preventDefault();
      move(way[0] * KEY_STEP, way[1] * KEY_STEP, event.altKey);
    };
    $("handles").append(handle);
    return { element: handle };
  }
}
