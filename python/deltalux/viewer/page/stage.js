// The stage: the canvas at the picture's own size, moved and magnified by CSS (so that zoom costs no drawing and a
// pixel can be seen as one), and which of picture and mesh is drawn on it.

import { $, clamp } from "./dom.js";
import { Mesh } from "./mesh.js";
import { Picture } from "./picture.js";

// From this many pixels of the display for one of the picture on, that one is a square.
const PIXELATED = 2.5;
const LARGEST = 64;
// Pixels along the longer edge of a mesh.
const LEAST = 512;

export class Stage {
  constructor(app) {
    this.app = app;
    this.canvas = $("picture");
    this.zoom = 1;
    this.middle = [0.5, 0.5];
    const options = { alpha: false, antialias: false, powerPreference: "high-performance" };
    this.gl = this.canvas.getContext("webgl2", options);
    if (!this.gl) return app.fail("This browser has no WebGL 2, with which the picture is drawn.");
    this.canvas.addEventListener("webglcontextlost", () => location.reload());
    new ResizeObserver(() => this.place()).observe($("stage"));
    app.view.on(() => app.redraw());
    app.shared.on((keys) => keys.includes("camera") && this.moved());
  }

  begin(welcome) {
    const { kind, camera } = welcome;
    // A mesh can be drawn finer than the scene's own camera has pixels.
    const times = kind === "vertices" ? Math.max(1, Math.ceil(LEAST / Math.max(welcome.width, welcome.height))) : 1;
    const [width, height] = [welcome.width * times, welcome.height * times];
    Object.assign(this.canvas, { width, height });
    this.size = [width, height];
    this.camera = camera && { ...camera, ...this.app.shared.values.camera };
    this.picture?.free();
    this.mesh?.free();
    this.picture = new Picture(this.gl, width, height);
    this.mesh = kind === "vertices" ? new Mesh(this.gl, width, height) : null;
    this.still = false;
    this.place();
  }

  get shown() {
    return this.mesh ?? this.picture;
  }

  get aspect() {
    return this.size[0] / this.size[1];
  }

  // What arrives

  frame(parts) {
    for (const { name, values, y, first } of parts) {
      if (this.mesh) this.mesh.put(name, values, first);
      else this.picture.put(name, values, y);
    }
    if (parts.length) this.still = false;
    this.app.redraw();
  }

  /** The exact picture of a mesh that rests; of a camera that has moved on since, it is nothing. */
  rest(values, camera) {
    if (values.length !== 3 * this.size[0] * this.size[1]) return;
    const near = (a, b) => a.every((value, k) => Math.abs(value - b[k]) < 1e-6 * (1 + Math.abs(value)));
    if (!["position", "target"].every((name) => near(camera[name], this.camera[name]))) return;
    this.picture.put("a", values, 0);
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
    for (let y = 0, row = 4 * width; y < height; y++) {
      rows.set(read.subarray(row * (height - 1 - y), row * (height - y)), row * y);
    }
    return rows;
  }

  // Where it is

  place() {
    if (!this.size) return;
    const box = $("stage").getBoundingClientRect();
    const [width, height] = this.size;
    this.scale = Math.min(box.width / width, box.height / height) * this.zoom;
    this.left = box.width / 2 - this.middle[0] * width * this.scale;
    this.top = box.height / 2 - this.middle[1] * height * this.scale;
    Object.assign(this.canvas.style, {
      width: `${width * this.scale}px`,
      height: `${height * this.scale}px`,
      left: `${this.left}px`,
      top: `${this.top}px`,
      imageRendering: this.scale * devicePixelRatio >= PIXELATED ? "pixelated" : "auto",
    });
    this.app.tell("placed");
  }

  /** A way on the page as shares of the picture. */
  shares(dx, dy) {
    return [dx / (this.size[0] * this.scale), dy / (this.size[1] * this.scale)];
  }

  /** A place of the page in pixels of the picture, with fractions. */
  pixel(event) {
    const box = this.canvas.getBoundingClientRect();
    const across = (event.clientX - box.left) / box.width;
    const down = (event.clientY - box.top) / box.height;
    return [across * this.size[0], down * this.size[1]];
  }

  holds([x, y]) {
    return x >= 0 && y >= 0 && x < this.size[0] && y < this.size[1];
  }

  /** Magnifies about a place of the page, or about the middle. */
  magnify(times, event) {
    const at = event ? this.pixel(event).map((value, k) => value / this.size[k]) : this.middle;
    const zoom = clamp(this.zoom * times, 1, LARGEST);
    this.middle = this.middle.map((value, k) => at[k] + ((value - at[k]) * this.zoom) / zoom);
    this.zoom = zoom;
    this.hold();
  }

  pan(dx, dy) {
    const [x, y] = this.shares(dx, dy);
    this.middle = [this.middle[0] - x, this.middle[1] - y];
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

  look({ position, target, fov }) {
    this.app.shared.set({ camera: { position, target, fov } });
  }

  moved() {
    this.camera = { ...this.camera, ...this.app.shared.values.camera };
    this.still = false;
    this.app.redraw();
    this.app.tell("placed");
  }
}
