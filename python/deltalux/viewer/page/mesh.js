// Vertices: an indexed mesh whose colours change, seen through a camera that flies round it.

import { add, clip, dot, frame, product } from "./geometry.js";
import { put } from "./layers.js";
import { Programs } from "./shading.js";

const LAYERS = ["a", "b", "exact", "bound"];

const VERTEX = `
in vec3 position, a, b, exact, bound;
uniform mat4 clip;
out vec3 va, vb, ve, vbound;
void main() { va = a; vb = b; ve = exact; vbound = bound; gl_Position = clip * vec4(position, 1.0); }`;

const FRAGMENT = `
in vec3 va, vb, ve, vbound;
uniform float width;
out vec4 colour;
void main() {
  vec3 shown = va;
#if OTHER == 1 && MODE == 0
  if (gl_FragCoord.x >= wipe * width) shown = ve;
#elif OTHER == 2
  if (gl_FragCoord.x >= wipe * width) shown = vb;
#endif
  colour = vec4(shade(shown, ve, vbound, gl_FragCoord.xy), 1.0);
}`;

export class Mesh {
  constructor(gl, width, height) {
    this.gl = gl;
    this.size = [width, height];
    this.layers = {};
    this.buffers = {};
    this.programs = new Programs(gl, VERTEX, FRAGMENT, ["position", ...LAYERS]);
  }

  /** The mesh itself: positions (v, 3) and triangles (t, 3). */
  take({ position, triangles }) {
    const { gl } = this;
    this.vertices = position.length / 3;
    this.corners = triangles.length;
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    this.buffer("position", position);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.enableVertexAttribArray(0);
    this.buffers.triangles = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.triangles);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.bounds(position);
  }

  bounds(position) {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    position.forEach((value, k) => {
      low[k % 3] = Math.min(low[k % 3], value);
      high[k % 3] = Math.max(high[k % 3], value);
    });
    this.middle = low.map((value, k) => (value + high[k]) / 2);
    this.radius = Math.hypot(...low.map((value, k) => high[k] - value)) / 2;
  }

  buffer(name, values) {
    const { gl } = this;
    this.buffers[name] ??= gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  }

  /** Radiance of vertices from `first` on. */
  put(name, values, first) {
    if (!this.array) return;
    const { gl } = this;
    const before = this.layers[name];
    this.layers[name] = put(before, this.vertices * 3, first * 3, values);
    const stands = before?.constructor === values.constructor && this.layers[name].constructor === values.constructor;
    if (stands) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
      gl.bufferSubData(gl.ARRAY_BUFFER, first * 3 * values.BYTES_PER_ELEMENT, values);
      return;
    }
    this.buffer(name, this.layers[name]);
    const place = 1 + LAYERS.indexOf(name);
    gl.bindVertexArray(this.array);
    gl.vertexAttribPointer(place, 3, this.layers[name] instanceof Uint16Array ? gl.HALF_FLOAT : gl.FLOAT, false, 0, 0);
    gl.enableVertexAttribArray(place);
    gl.bindVertexArray(null);
  }

  free() {
    for (const buffer of Object.values(this.buffers)) this.gl.deleteBuffer(buffer);
    this.gl.deleteVertexArray(this.array ?? null);
    this.programs.free();
  }

  draw(view, camera) {
    const { gl } = this;
    const [width, height] = this.size;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.16, 0.16, 0.16, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!this.array) return;
    gl.enable(gl.DEPTH_TEST);
    // Of a thin surface both sides are there, each wound as it is seen.
    gl.enable(gl.CULL_FACE);
    const at = this.programs.use(view);
    gl.uniform1f(at("width"), width);
    const far = Math.hypot(...add(this.middle, camera.position, -1)) + 1.01 * this.radius;
    gl.uniformMatrix4fv(at("clip"), false, clip(camera, width / height, far / 4000, far));
    gl.bindVertexArray(this.array);
    gl.drawElements(gl.TRIANGLES, this.corners, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }
}

const HIGHEST = 0.999;

/** The camera gone round its target, by shares of the picture. */
export function orbited(camera, dx, dy) {
  const { right, up, forward } = frame(camera);
  const axis = camera.up ?? [0, 1, 0];
  const away = add(camera.position, camera.target, -1);
  const level = turned(turned(away, axis, -dx * Math.PI), right, -dy * Math.PI);
  const over = Math.abs(dot(level, axis)) / (Math.hypot(...level) * Math.hypot(...axis)) > HIGHEST;
  const kept = over ? turned(away, axis, -dx * Math.PI) : level;
  return { ...camera, position: add(camera.target, kept) };
}

export function panned(camera, aspect, dx, dy) {
  const { right, up } = frame(camera);
  const reach = 2 * Math.hypot(...add(camera.target, camera.position, -1)) * Math.tan((camera.fov * Math.PI) / 360);
  const way = add(right.map((value) => -value * dx * reach * aspect), up, dy * reach);
  return { ...camera, position: add(camera.position, way), target: add(camera.target, way) };
}

export function nearer(camera, times) {
  const away = add(camera.position, camera.target, -1);
  return { ...camera, position: add(camera.target, away, times) };
}

/** A vector turned about a unit axis, by radians. */
function turned(vector, axis, angle) {
  const sine = Math.sin(angle / 2);
  const turn = [...axis.map((value) => value * sine), Math.cos(angle / 2)];
  const back = [-turn[0], -turn[1], -turn[2], turn[3]];
  const length = Math.hypot(...vector);
  if (length === 0) return vector;
  const unit = vector.map((value) => value / length);
  return rotate(turn, unit, back).map((value) => value * length);
}

function rotate(turn, unit, back) {
  return product(product(turn, [...unit, 0]), back).slice(0, 3);
}
