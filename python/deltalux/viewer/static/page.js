// Relighting by itself: B = M V, and B += M dV of what a method chooses. M stands in data.js, column by column.
"use strict";

const data = window.DELTALUX;
const TYPES = {
  uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, uint32: Uint32Array, float32: Float32Array,
};

function decoded([type, letters]) {
  const bytes = Uint8Array.from(atob(letters), (letter) => letter.charCodeAt(0));
  return new TYPES[type](bytes.buffer);
}

const M = Object.fromEntries(Object.entries(data.arrays).map(([name, coded]) => [name, decoded(coded)]));
const { width, height, size, channels } = data;
const columns = M.scales.length;
const rows = M.weight.length;

// --- The sphere of directions ---------------------------------------------------------------------------------------

// Right, down and out of the faces +X, -X, +Y, -Y, +Z, -Z, in OpenGL's orientation.
const FACES = [
  [[0, 0, -1], [0, -1, 0], [1, 0, 0]], [[0, 0, 1], [0, -1, 0], [-1, 0, 0]], [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
  [[1, 0, 0], [0, 0, -1], [0, -1, 0]], [[1, 0, 0], [0, -1, 0], [0, 0, 1]], [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
];

function direction(face, s, t) {
  const [right, down, out] = FACES[face];
  const d = [0, 1, 2].map((k) => s * right[k] + t * down[k] + out[k]);
  const length = Math.hypot(...d);
  return d.map((x) => x / length);
}

function place(x, y, z) {
  const ax = Math.abs(x), ay = Math.abs(y), az = Math.abs(z);
  if (ax >= ay && ax >= az) return [x < 0 ? 1 : 0, (x < 0 ? z : -z) / ax, -y / ax];
  if (ay >= az) return [y < 0 ? 3 : 2, x / ay, (y < 0 ? -z : z) / ay];
  return [z < 0 ? 5 : 4, (z < 0 ? -x : x) / az, -y / az];
}

function solidAngles(n) {
  const corner = (s, t) => Math.atan2(s * t, Math.sqrt(s * s + t * t + 1));
  const edge = (k) => (2 * k - n) / n;
  const areas = new Float64Array(n * n);
  for (let row = 0; row < n; row++) {
    for (let column = 0; column < n; column++) {
      const [s0, s1, t0, t1] = [edge(column), edge(column + 1), edge(row), edge(row + 1)];
      areas[row * n + column] = corner(s1, t1) - corner(s0, t1) - corner(s1, t0) + corner(s0, t0);
    }
  }
  return areas;
}

// --- Light: maps, turned about the vertical, in Haar wavelets -------------------------------------------------------

const SUB = 4;        // Samples along each edge of a texel.
const BRIGHT = 3;     // Times the mean: texels that are carried over one by one, so that no sun is missed or seen twice.

function light(coded) {
  const bytes = decoded(coded), n = data.map, count = 6 * n * n;
  const map = new Float32Array(3 * count), areas = solidAngles(n), bright = [];
  let mean = 0;
  for (let k = 0; k < count; k++) {
    const scale = bytes[4 * k + 3] ? 2 ** (bytes[4 * k + 3] - 136) : 0;
    for (let c = 0; c < 3; c++) map[3 * k + c] = (bytes[4 * k + c] + 0.5) * scale;
    mean += Math.max(map[3 * k], map[3 * k + 1], map[3 * k + 2]) / count;
  }
  const whole = map.slice();
  for (let k = 0; k < count; k++) {
    if (Math.max(map[3 * k], map[3 * k + 1], map[3 * k + 2]) > BRIGHT * mean) {
      const face = Math.floor(k / (n * n)), at = k % (n * n);
      const centre = (j) => (2 * j + 1 - n) / n;
      const colour = [0, 1, 2].map((c) => Math.max(map[3 * k + c] - mean, 0) * areas[at]);
      bright.push([direction(face, centre(at % n), centre(Math.floor(at / n))), colour]);
      for (let c = 0; c < 3; c++) map[3 * k + c] = Math.min(map[3 * k + c], mean);
    }
  }
  return { map, whole, bright };
}

function lookup(map, n, x, y, z, out) {
  const [face, s, t] = place(x, y, z);
  const u = Math.min(Math.max((s + 1) * 0.5 * n - 0.5, 0), n - 1), v = Math.min(Math.max((t + 1) * 0.5 * n - 0.5, 0), n - 1);
  const i = Math.min(Math.floor(u), n - 2), j = Math.min(Math.floor(v), n - 2), f = u - i, g = v - j;
  const first = 3 * ((face * n + j) * n + i), below = first + 3 * n;
  for (let c = 0; c < 3; c++) {
    out[c] = (1 - g) * ((1 - f) * map[first + c] + f * map[first + 3 + c])
      + g * ((1 - f) * map[below + c] + f * map[below + 3 + c]);
  }
}

const targetAreas = solidAngles(size);
const samples = [];
for (let texel = 0; texel < 6 * size * size; texel++) {
  const face = Math.floor(texel / (size * size)), at = texel % (size * size);
  for (let k = 0; k < SUB * SUB; k++) {
    const s = (2 * ((at % size) * SUB + (k % SUB)) + 1) / (size * SUB) - 1;
    const t = (2 * (Math.floor(at / size) * SUB + Math.floor(k / SUB)) + 1) / (size * SUB) - 1;
    samples.push(...direction(face, s, t));
  }
}
const SAMPLES = Float32Array.from(samples);

const inside = (u, half) => Math.min(Math.max(u, half), size - half);
const overlap = (u, half, k) => Math.max(0, Math.min(u + half, k + 1) - Math.max(u - half, k)) / (2 * half);

// The light that a turn about +Y by the right-hand rule makes: L'(d) = L(R^-1 d).
function cubemap(own, degrees) {
  const a = (degrees * Math.PI) / 180, cos = Math.cos(a), sin = Math.sin(a);
  const texels = new Float64Array(18 * size * size), out = [0, 0, 0];
  for (let texel = 0, at = 0; texel < 6 * size * size; texel++) {
    for (let k = 0; k < SUB * SUB; k++, at += 3) {
      const x = SAMPLES[at], y = SAMPLES[at + 1], z = SAMPLES[at + 2];
      lookup(own.map, data.map, cos * x - sin * z, y, sin * x + cos * z, out);
      for (let c = 0; c < 3; c++) texels[3 * texel + c] += out[c] / (SUB * SUB);
    }
  }
  for (const [[x, y, z], flux] of own.bright) {
    const [face, s, t] = place(cos * x + sin * z, y, cos * z - sin * x);
    // A square of the texel's own size, cut at the edges of the texels that it covers.
    const half = size / data.map / 2, u = inside((s + 1) * 0.5 * size, half), v = inside((t + 1) * 0.5 * size, half);
    for (let j = Math.floor(v - half); j < v + half; j++) {
      for (let i = Math.floor(u - half); i < u + half; i++) {
        const share = overlap(u, half, i) * overlap(v, half, j), at = j * size + i;
        for (let c = 0; c < 3; c++) texels[3 * (face * size * size + at) + c] += (share * flux[c]) / targetAreas[at];
      }
    }
  }
  return texels;
}

// The transform of `rust/basis/haar.rs`: orthonormal on the sphere.
const levels = (() => {
  const made = [];
  for (let side = size, areas = targetAreas; side > 1; side /= 2) {
    const half = side / 2, sums = new Float64Array(half * half), weights = [];
    for (let block = 0; block < half * half; block++) {
      const first = 4 * half * Math.floor(block / half) + 2 * (block % half);
      const own = [first, first + 1, first + side, first + side + 1];
      sums[block] = own.reduce((sum, k) => sum + areas[k], 0);
      weights.push([own, own.map((k) => Math.sqrt(areas[k] / sums[block]))]);
    }
    made.push(weights);
    areas = sums;
  }
  return made;
})();

function forward(texels) {
  const V = new Float64Array(3 * columns);
  for (let face = 0; face < 6; face++) {
    let fine = new Float64Array(3 * size * size);
    for (let k = 0; k < size * size; k++) {
      for (let c = 0; c < 3; c++) fine[3 * k + c] = texels[3 * (face * size * size + k) + c] * Math.sqrt(targetAreas[k]);
    }
    for (const weights of levels) {
      const blocks = weights.length, start = 6 * blocks + 3 * blocks * face, coarse = new Float64Array(3 * blocks);
      weights.forEach(([own, [w0, w1, w2, w3]], block) => {
        for (let c = 0; c < 3; c++) {
          const [a, b, d, e] = own.map((k) => fine[3 * k + c]);
          coarse[3 * block + c] = w0 * a + w1 * b + w2 * d + w3 * e;
          V[3 * (start + 3 * block) + c] = w1 * a - w0 * b + w3 * d - w2 * e;
          V[3 * (start + 3 * block + 1) + c] = w2 * a - w3 * b - w0 * d + w1 * e;
          V[3 * (start + 3 * block + 2) + c] = w3 * a + w2 * b - w1 * d - w0 * e;
        }
      });
      fine = coarse;
    }
    for (let c = 0; c < 3; c++) V[3 * face + c] = fine[c];
  }
  return V;
}

// --- The product, and what of it a frame sends ----------------------------------------------------------------------

function send(B, column, r, g, b) {
  const scale = M.scales[column], last = M.starts[column + 1];
  r *= scale; g *= scale; b *= scale;
  if (channels === 1) {
    for (let k = M.starts[column]; k < last; k++) {
      const at = 3 * M.rows[k], value = M.values[k];
      B[at] += value * r; B[at + 1] += value * g; B[at + 2] += value * b;
    }
  } else {
    for (let k = M.starts[column]; k < last; k++) {
      const at = 3 * M.rows[k];
      B[at] += M.values[3 * k] * r; B[at + 1] += M.values[3 * k + 1] * g; B[at + 2] += M.values[3 * k + 2] * b;
    }
  }
}

function product(V) {
  const B = new Float32Array(3 * rows);
  for (let j = 0; j < columns; j++) {
    if (V[3 * j] || V[3 * j + 1] || V[3 * j + 2]) send(B, j, V[3 * j], V[3 * j + 1], V[3 * j + 2]);
  }
  return B;
}

const bands = Math.max(...M.bands) + 1;
const areas = Float64Array.from(M.bands, (band) => (size / 2 ** band) ** 2);
let applied = new Float64Array(3 * columns), B = new Float32Array(3 * rows);

// One frame towards V: NWA starts from black, BI sends the largest changes, PBI lets each band do what is nearer.
function step(V, method, terms) {
  const change = new Float64Array(columns), anew = new Float64Array(columns);
  for (let j = 0; j < columns; j++) {
    for (let c = 0; c < 3; c++) {
      change[j] += areas[j] * Math.abs(V[3 * j + c] - applied[3 * j + c]);
      anew[j] += areas[j] * Math.abs(V[3 * j + c]);
    }
  }
  const reset = new Array(bands).fill(method === "nwa");
  if (method === "pbi") {
    const [nearer, zero] = [new Float64Array(bands), new Float64Array(bands)];
    for (let j = 0; j < columns; j++) { nearer[M.bands[j]] += change[j]; zero[M.bands[j]] += anew[j]; }
    for (let band = 0; band < bands; band++) reset[band] = nearer[band] > zero[band];
  }
  if (method === "nwa") { B.fill(0); applied.fill(0); }
  for (let j = 0; j < columns && method === "pbi"; j++) {
    if (reset[M.bands[j]] && (applied[3 * j] || applied[3 * j + 1] || applied[3 * j + 2])) {
      send(B, j, -applied[3 * j], -applied[3 * j + 1], -applied[3 * j + 2]);
      applied.fill(0, 3 * j, 3 * j + 3);
    }
  }
  const worth = (j) => (reset[M.bands[j]] ? anew[j] : change[j]);
  const order = Array.from({ length: columns }, (_, j) => j).filter((j) => worth(j) > 0).sort((a, b) => worth(b) - worth(a));
  const sent = method === "full" ? order : order.slice(0, terms);
  for (const j of sent) {
    send(B, j, V[3 * j] - applied[3 * j], V[3 * j + 1] - applied[3 * j + 1], V[3 * j + 2] - applied[3 * j + 2]);
    for (let c = 0; c < 3; c++) applied[3 * j + c] = V[3 * j + c];
  }
  return { sent: sent.length, resets: method === "pbi" ? reset.filter(Boolean).length : 0, left: order.length - sent.length };
}

// --- Pictures -------------------------------------------------------------------------------------------------------

function resolved(B, behind) {
  const picture = new Float32Array(3 * width * height);
  if (M.base) picture.set(M.base);
  for (let k = 0; k < rows; k++) {
    const at = 3 * M.pixel[k], w = M.weight[k];
    for (let c = 0; c < 3; c++) picture[at + c] += w * M.albedo[3 * k + c] * B[3 * k + c];
  }
  for (let k = 0; k < M.open.length; k++) {
    for (let c = 0; c < 3; c++) picture[3 * M.open[k] + c] += M.share[k] * behind[3 * k + c];
  }
  return picture;
}

function background(own, degrees) {
  const a = (degrees * Math.PI) / 180, cos = Math.cos(a), sin = Math.sin(a), out = [0, 0, 0];
  const seen = new Float32Array(3 * M.open.length);
  for (let k = 0; k < M.open.length; k++) {
    const x = M.towards[3 * k], y = M.towards[3 * k + 1], z = M.towards[3 * k + 2];
    lookup(own.whole, data.map, cos * x - sin * z, y, sin * x + cos * z, out);
    seen.set(out, 3 * k);
  }
  return seen;
}

function shown(value) {
  const x = Math.min(Math.max(value, 0), 1);
  return 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
}

function paint(canvas, w, h, colour) {
  const context = canvas.getContext("2d"), image = context.createImageData(w, h);
  for (let k = 0; k < w * h; k++) {
    const [r, g, b] = colour(k);
    image.data.set([shown(r), shown(g), shown(b), 255], 4 * k);
  }
  context.putImageData(image, 0, 0);
}

function automatic(picture) {
  const lit = [];
  for (let k = 0; k < picture.length; k += 3) {
    const most = Math.max(picture[k], picture[k + 1], picture[k + 2]);
    if (most > 0) lit.push(most);
  }
  lit.sort((a, b) => a - b);
  return lit.length ? Math.log2(0.9 / lit[Math.floor(0.97 * (lit.length - 1))]) : 0;
}

// --- The page -------------------------------------------------------------------------------------------------------

const $ = (id) => document.getElementById(id);
const lights = Object.fromEntries(Object.entries(data.lights).map(([name, coded]) => [name, light(coded)]));
const state = { light: Object.keys(lights)[0], turn: 0, V: null, moved: true, behind: null, exact: null, error: 0, frames: 0 };
const picture = $("picture"), strip = $("strip");
picture.width = width;
picture.height = height;
$("name").textContent = data.name;
$("about").textContent = `${rows.toLocaleString("en")} receivers x ${columns.toLocaleString("en")} wavelets, `
  + `relit in your browser without a server; deltalux ${data.version}`;

for (const name of Object.keys(lights)) {
  const button = document.createElement("button");
  button.textContent = name;
  button.id = `light-${name.replace(/[^\w-]/g, "-")}`;
  button.setAttribute("aria-pressed", String(name === state.light));
  button.addEventListener("click", () => {
    state.light = name;
    document.querySelectorAll("#lights button").forEach((own) => own.setAttribute("aria-pressed", String(own === button)));
    change(true);
  });
  $("lights").append(button);
}

function change(fresh) {
  state.moved = true;
  if (fresh) expose();
}

function turn(degrees) {
  state.turn = ((degrees % 360) + 360) % 360;
  $("turn").value = state.turn;
  change(false);
}

function expose() {
  const own = lights[state.light];
  const whole = resolved(product(forward(cubemap(own, state.turn))), background(own, state.turn));
  $("exposure").value = automatic(whole).toFixed(2);
}

for (const canvas of [picture, strip]) {
  let last = null;
  canvas.addEventListener("pointerdown", (event) => { last = event.clientX; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    if (last === null) return;
    // The strip moves with the hand: over its width lies the whole circle. Azimuth grows to the right, turns to the left.
    turn(state.turn - ((event.clientX - last) / canvas.clientWidth) * 360);
    last = event.clientX;
  });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, () => { last = null; });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); turn(state.turn + 5 * Math.sign(event.deltaY)); }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: 5, ArrowRight: -5 }[event.key];
    if (by) { event.preventDefault(); turn(state.turn + by); }
  });
}
$("turn").addEventListener("input", () => turn(Number($("turn").value)));
for (const id of ["method", "terms"]) $(id).addEventListener("input", () => change(false));
for (const id of ["exposure", "wipe"]) $(id).addEventListener("input", () => { state.redraw = true; });

function drawStrip() {
  const own = lights[state.light], a = (state.turn * Math.PI) / 180, cos = Math.cos(a), sin = Math.sin(a);
  const scale = 2 ** Number($("exposure").value) , out = [0, 0, 0];
  paint(strip, strip.width, strip.height, (k) => {
    const phi = (2 * Math.PI * ((k % strip.width) + 0.5)) / strip.width;
    const theta = (Math.PI * (Math.floor(k / strip.width) + 0.5)) / strip.height;
    const x = Math.sin(theta) * Math.sin(phi), y = Math.cos(theta), z = -Math.sin(theta) * Math.cos(phi);
    lookup(own.whole, data.map, cos * x - sin * z, y, sin * x + cos * z, out);
    return out.map((value) => value * scale);
  });
}

function frame(now) {
  const began = performance.now(), own = lights[state.light];
  if ($("spin").checked) turn(state.turn + 0.5);
  const terms = Math.round(2 ** Number($("terms").value)), method = $("method").value;
  if (state.moved) {
    state.V = forward(cubemap(own, state.turn));
    state.behind = background(own, state.turn);
    state.exact = null;
  }
  if (state.moved || state.left > 0) {
    const stepped = performance.now(), found = step(state.V, method, terms);
    state.milliseconds = performance.now() - stepped;
    state.left = method === "nwa" ? 0 : found.left;
    Object.assign(state, { sent: found.sent, resets: found.resets, redraw: true, frames: state.frames + 1 });
    // At rest no rounding of earlier frames is left.
    if (state.left === 0 && method !== "nwa") B = product(applied);
    if (state.exact === null || state.left === 0) {
      state.exact = product(state.V);
      let off = 0, size = 0;
      for (let k = 0; k < B.length; k++) { off += (B[k] - state.exact[k]) ** 2; size += state.exact[k] ** 2; }
      state.error = size > 0 ? Math.sqrt(off / size) : 0;
    }
  }
  if (state.redraw) {
    const scale = 2 ** Number($("exposure").value), edge = Number($("wipe").value) * width;
    const a = resolved(B, state.behind), b = edge < width ? resolved(state.exact, state.behind) : a;
    paint(picture, width, height, (k) => {
      const from = k % width < edge ? a : b;
      return [scale * from[3 * k], scale * from[3 * k + 1], scale * from[3 * k + 2]];
    });
    drawStrip();
    $("turned").textContent = `${state.turn.toFixed(1)}°`;
    $("termed").textContent = method === "full" ? "all" : String(terms);
    $("exposed").textContent = `${Number($("exposure").value).toFixed(2)} stops`;
    const resets = state.resets ? `, ${state.resets} bands anew` : "";
    $("readout").textContent = `${state.sent.toLocaleString("en")} columns sent in ${state.milliseconds.toFixed(1)} ms${resets}; `
      + `${(100 * state.error).toPrecision(2)} % off the exact product${state.left > 0 ? "" : ", at rest"}`;
  }
  state.moved = state.redraw = false;
  state.took = performance.now() - began;
  requestAnimationFrame(frame);
}

expose();
state.left = 0;
requestAnimationFrame(frame);
// For tests: what is shown, and what of the light.
window.deltalux = { state, forward, cubemap, lights, product, response: () => B, resolved, background };
