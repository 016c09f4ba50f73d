// The stage: the canvas at the picture's own size, moved and magnified by CSS (so that zoom costs no drawing and a
// pixel can be seen as one), what a pointer does on it, the wipe's bar, the probe, and the legend of a map.

import { $, clamp, drags, percent, readable } from "./dom.js";
import { along, SIGNS, SIZES } from "./colours.js";
import { floats } from "./layers.js";
import { Mesh, nearer, orbited, panned } from "./mesh.js";
import { Picture } from "./picture.js";
import { DECADES, GHOSTS, STOPS } from "./shading.js";

const CLICK = 4;
const PIXELATED = 2.5;
const LARGEST = 64;

export class Stage {
  constructor(app) {
    this.app = app;
    this.canvas = $("picture");
    this.zoom = 1;
    this.middle = [0.5, 0.5];
    this.gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false, powerPreference: "high-performance" });
    if (!this.gl) return app.fail("This browser has no WebGL 2, with which the picture is drawn.");
    this.canvas.addEventListener("webglcontextlost", () => location.reload());
    new ResizeObserver(() => this.place()).observe($("stage"));
    this.listen();
    app.view.on((keys) => this.viewed(keys));
    app.shared.on((keys) => keys.includes("camera") && this.moved());
  }

  begin({ kind, width, height, camera }) {
    Object.assign(this.canvas, { width, height });
    this.size = [width, height];
    this.camera = camera;
    const made = this.app.shared.values.camera;
    if (made && camera) this.camera = { ...camera, ...made };
    this.picture = new Picture(this.gl, width, height);
    this.mesh = kind === "vertices" ? new Mesh(this.gl, width, height) : null;
    this.still = false;
    this.place();
    this.viewed(["mode"]);
  }

  get shown() {
    return this.mesh ?? this.picture;
  }

  // What arrives

  frame(parts) {
    for (const { name, values, y, height, first } of parts) {
      if (this.mesh) this.mesh.put(name, values, first ?? 0);
      else this.picture.put(name, values, y ?? 0, height ?? this.size[1]);
    }
    if (parts.length) this.still = false;
    this.app.redraw();
  }

  /** The exact picture of a mesh that rests; of a camera that has moved on since, it is nothing. */
  rest(values, camera) {
    const near = ["position", "target"].every((name) => camera[name].every((v, k) => Math.abs(v - this.camera[name][k]) < 1e-6 * (1 + Math.abs(v))));
    if (!near) return;
    this.picture.put("a", values, 0, this.size[1]);
    this.still = true;
    this.app.redraw();
  }

  draw() {
    const view = this.app.view.values;
    const rests = this.still && view.mode === "beauty" && !view.wipe;
    if (this.mesh && !rests) this.mesh.draw(view, this.camera);
    else this.picture.draw(view);
  }

  /** The canvas as it is, rows from the top, RGBA. */
  pixels() {
    const [width, height] = this.size;
    this.draw();
    const read = new Uint8Array(width * height * 4);
    this.gl.readPixels(0, 0, width, height, this.gl.RGBA, this.gl.UNSIGNED_BYTE, read);
    const rows = new Uint8Array(read.length);
    for (let y = 0; y < height; y++) rows.set(read.subarray(4 * width * (height - 1 - y), 4 * width * (height - y)), 4 * width * y);
    return rows;
  }

  // Where it is

  place() {
    if (!this.size) return;
    const box = $("stage").getBoundingClientRect();
    const [width, height] = this.size;
    const scale = Math.min(box.width / width, box.height / height) * this.zoom;
    this.scale = scale;
    this.left = box.width / 2 - this.middle[0] * width * scale;
    this.top = box.height / 2 - this.middle[1] * height * scale;
    Object.assign(this.canvas.style, {
      width: `${width * scale}px`, height: `${height * scale}px`, left: `${this.left}px`, top: `${this.top}px`,
      imageRendering: scale * devicePixelRatio >= PIXELATED ? "pixelated" : "auto",
    });
    this.placeWipe();
    this.app.tell("placed");
  }

  /** A place of the page in pixels of the picture, with fractions. */
  pixel(event) {
    const box = this.canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * this.size[0], ((event.clientY - box.top) / box.height) * this.size[1]];
  }

  magnify(times, event) {
    const before = event ? this.pixel(event) : [this.middle[0] * this.size[0], this.middle[1] * this.size[1]];
    const zoom = clamp(this.zoom * times, 1, LARGEST);
    const at = before.map((value, k) => value / this.size[k]);
    this.middle = this.middle.map((value, k) => at[k] + ((value - at[k]) * this.zoom) / zoom);
    this.zoom = zoom;
    this.hold();
  }

  pan(dx, dy) {
    this.middle = [this.middle[0] - dx / (this.size[0] * this.scale), this.middle[1] - dy / (this.size[1] * this.scale)];
    this.hold();
  }

  fit() {
    this.zoom = 1;
    this.hold();
  }

  hold() {
    const reach = 0.5 * (1 - 1 / this.zoom);
    this.middle = this.middle.map((value) => clamp(value, 0.5 - reach, 0.5 + reach));
    this.place();
  }

  // The camera of a mesh

  look(camera) {
    this.camera = camera;
    this.still = false;
    const { position, target, fov } = camera;
    this.app.shared.set({ camera: { position, target, fov } });
  }

  moved() {
    this.camera = { ...this.camera, ...this.app.shared.values.camera };
    this.still = false;
    this.app.redraw();
    this.app.tell("placed");
  }

  // What a pointer does

  listen() {
    const pointers = new Map();
    let way = 0;
    drags(this.canvas, {
      down: (event) => {
        way = 0;
        pointers.set(event.pointerId, event);
        this.canvas.focus({ preventScroll: true });
      },
      move: (dx, dy, event) => {
        way += Math.abs(dx) + Math.abs(dy);
        if (pointers.size > 1) return;
        if (event.shiftKey) this.app.tell("turn", dx, dy, event.altKey);
        else if (this.mesh) this.orbit(dx, dy, event);
        else this.pan(dx, dy);
      },
      up: (event) => {
        pointers.delete(event.pointerId);
        if (way < CLICK && event.type === "pointerup") this.click(event);
      },
    });
    this.canvas.addEventListener("pointermove", (event) => {
      this.pinch(pointers, event);
      this.probe(event);
    });
    this.canvas.addEventListener("pointerleave", () => this.app.view.set({ probed: null }));
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const times = Math.exp(-0.0015 * event.deltaY);
      if (event.shiftKey) this.app.tell("turn", Math.sign(event.deltaY || event.deltaX) * 10, 0, false);
      else if (this.mesh) this.look(nearer(this.camera, 1 / times));
      else this.magnify(times, event);
    }, { passive: false });
    this.canvas.addEventListener("dblclick", () => this.fit());
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.listenWipe();
  }

  pinch(pointers, event) {
    const before = pointers.get(event.pointerId);
    if (pointers.size === 2 && before) {
      const still = [...pointers.values()].find((one) => one.pointerId !== event.pointerId);
      const apart = (one) => Math.hypot(one.clientX - still.clientX, one.clientY - still.clientY) || 1;
      const times = apart(event) / apart(before);
      if (this.mesh) this.look(nearer(this.camera, 1 / times));
      else this.magnify(times, still);
    }
    if (before) pointers.set(event.pointerId, event);
  }

  orbit(dx, dy, event) {
    const [x, y] = [dx / (this.size[0] * this.scale), dy / (this.size[1] * this.scale)];
    const pans = event.ctrlKey || event.metaKey;
    this.look(pans ? panned(this.camera, this.size[0] / this.size[1], x, y) : orbited(this.camera, x, y));
  }

  click(event) {
    const [x, y] = this.pixel(event).map(Math.floor);
    if (x >= 0 && y >= 0 && x < this.size[0] && y < this.size[1]) this.app.tell("click", x, y);
  }

  key(event) {
    const step = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[event.key];
    if (event.key === "+" || event.key === "=") this.mesh ? this.look(nearer(this.camera, 0.8)) : this.magnify(1.25);
    else if (event.key === "-") this.mesh ? this.look(nearer(this.camera, 1.25)) : this.magnify(0.8);
    else if (event.key === "0") this.fit();
    else if (step && event.shiftKey) this.app.tell("turn", -step[0] / 4, -step[1] / 4, event.altKey);
    else if (step) this.mesh ? this.orbit(...step, event) : this.pan(...step);
    else if (event.key === "Enter") this.app.tell("click", ...this.middle.map((v, k) => Math.min(this.size[k] - 1, Math.floor(v * this.size[k]))));
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  probe(event) {
    if (this.mesh || event.buttons) return;
    const [x, y] = this.pixel(event).map(Math.floor);
    this.app.view.set({ probed: x >= 0 && y >= 0 && x < this.size[0] && y < this.size[1] ? [x, y] : null });
  }

  /** The values under the pointer, as a line of text. */
  probeText() {
    const at = this.app.view.values.probed;
    if (!at) return this.mesh ? "Drag flies round, ctrl-drag moves, the wheel nears; click asks which light reaches a place." : "Point at the picture to read its values; click asks which light reaches a place.";
    const three = (values) => values.map((value) => readable(value)).join(" ");
    const told = [["", "a"], ["B ", "b"], ["exact ", "exact"], ["bound ", "bound"]];
    const parts = told.map(([title, name]) => [title, this.picture.at(name, ...at)]).filter(([, values]) => values);
    return `(${at.join(", ")})  ${parts.map(([title, values]) => title + three(values)).join("  |  ")}`;
  }

  // The wipe's bar

  listenWipe() {
    const bar = $("wipe-bar");
    const to = (at) => this.app.view.set({ at: clamp(at, 0, 1) });
    drags(bar, { move: (dx) => to(this.app.view.values.at + dx / (this.size[0] * this.scale)) });
    bar.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
      if (!way) return;
      event.preventDefault();
      to(this.app.view.values.at + way);
    });
  }

  placeWipe() {
    const { at, wipe, with: other } = this.app.view.values;
    const bar = $("wipe-bar");
    bar.hidden = !wipe;
    bar.style.left = `${this.left + at * this.size[0] * this.scale}px`;
    bar.setAttribute("aria-valuenow", Math.round(100 * at));
    $("wipe-left").textContent = this.app.nameOf("a");
    $("wipe-right").textContent = this.app.nameOf(other);
  }

  // The legend

  viewed(keys) {
    if (!this.size) return;
    this.app.redraw();
    if (keys.some((key) => ["wipe", "at", "with", "mode"].includes(key))) this.placeWipe();
    if (keys.some((key) => ["mode", "full", "luminance"].includes(key))) this.legend();
    if (keys.includes("probed")) $("probe").textContent = this.probeText();
  }

  legend() {
    const { mode, full, luminance } = this.app.view.values;
    const logarithmic = Array.from({ length: DECADES + 1 }, (_, k) => percent(full * 10 ** (k - DECADES)));
    const [title, ramp, ticks] = {
      error: ["Error |a − exact|, of white", SIZES, logarithmic],
      bound: ["Bound of the error, of white", SIZES, logarithmic],
      ghosts: ["a − exact, of white", SIGNS, [`${percent(-GHOSTS * full)} too dark`, `+${percent(GHOSTS * full)} too bright`]],
      difference: ["64 |a − exact|, as a picture", null, []],
      beauty: luminance ? ["Luminance, stops about middle grey", SIZES, [-STOPS, -STOPS / 2, 0, `+${STOPS / 2}`, `+${STOPS}`]] : ["", null, []],
    }[mode];
    $("legend").hidden = !title;
    $("legend-title").textContent = title;
    $("legend-ramp").hidden = !ramp;
    $("legend-ticks").replaceChildren(...ticks.map((tick) => Object.assign(document.createElement("span"), { textContent: tick })));
    if (!ramp) return;
    const pen = $("legend-ramp").getContext("2d");
    for (let x = 0; x < 180; x++) {
      pen.fillStyle = along(ramp, x / 179);
      pen.fillRect(x, 0, 1, 8);
    }
  }

  /** Luminances of every few pixels, for the histogram. */
  luminances(most) {
    const layer = this.shown.layers.a;
    if (!layer) return [];
    const count = layer.length / 3;
    const step = Math.max(1, Math.floor(count / most)) * 3;
    const sampled = new layer.constructor(3 * Math.floor(layer.length / step));
    for (let i = 0, k = 0; k < sampled.length; i += step, k += 3) sampled.set(layer.subarray(i, i + 3), k);
    const values = floats(sampled);
    return Array.from({ length: values.length / 3 }, (_, i) => 0.2126 * values[3 * i] + 0.7152 * values[3 * i + 1] + 0.0722 * values[3 * i + 2]);
  }
}
