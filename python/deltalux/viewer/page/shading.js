// How radiance becomes a colour on the display: one text for pictures and meshes, so that both show the same.

import { SIGNS, SIZES } from "./colours.js";

export const MODES = ["beauty", "error", "ghosts", "bound", "difference"];
const TONES = ["srgb", "agx", "raw"];
const OTHERS = ["none", "exact", "b", "kept"];
// Maps of error and bound show this many decades below full scale; ghosts are linear.
export const DECADES = 3;
// False colours of luminance: stops about middle grey.
export const STOPS = 6;

const ramp = (colours) => `vec3[8](${colours.map((c) => `vec3(${c.map((v) => v.toFixed(3))})`).join(", ")})`;

// Each way of showing is a program of its own: software that draws evaluates all sides of a branch.
const SHADING = `
uniform float gain, full, wipe;
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

// AgX as in rust/relight/display.rs: colours drawn together, a sigmoid of their logarithms, drawn apart again.
const mat3 INSET = mat3(
  0.842479062253094, 0.0423282422610123, 0.0423756549057051,
  0.0784335999999992, 0.878468636469772, 0.0784336,
  0.0792237451477643, 0.0791661274605434, 0.879142973793104);
const mat3 OUTSET = mat3(
  1.19687900512017, -0.0528968517574562, -0.0529716355144438,
  -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
  -0.0990297440797205, -0.0989611768448433, 1.15107367264116);

vec3 agx(vec3 colour) {
  vec3 t = INSET * clamp(colour, 0.0, 131072.0);
  t = clamp(log2(max(t, exp2(-12.47393))), -12.47393, 4.026069);
  t = (t + 12.47393) / (4.026069 + 12.47393);
  t = ((((((15.5 * t - 40.14) * t + 31.96) * t - 6.868) * t + 0.4298) * t + 0.1191) * t - 0.00232);
  return OUTSET * t;
}
vec3 srgb(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, 12.92 * c, lessThanEqual(c, vec3(0.0031308)));
}
vec3 along(vec3 colours[8], float t) {
  t = clamp(t, 0.0, 1.0) * 7.0;
  int first = min(6, int(t));
  return mix(colours[first], colours[first + 1], t - float(first));
}
float decades(float share) { return 1.0 + log2(max(share / full, 1e-9)) / (3.321928 * ${DECADES}.0); }

vec3 shade(vec3 shown, vec3 exact, vec3 bound, vec2 pixel) {
  if (any(isnan(shown))) shown = vec3(0.0);
  vec3 apart = (shown - exact) * gain;
#if MODE == 1
  return along(${ramp(SIZES)}, decades(max(abs(apart.r), max(abs(apart.g), abs(apart.b)))));
#elif MODE == 2
  return along(${ramp(SIGNS)}, 0.5 + 0.5 * dot(apart, LUMINANCE) / full);
#elif MODE == 3
  vec3 most = bound * gain;
  return along(${ramp(SIZES)}, decades(max(most.r, max(most.g, most.b))));
#else
#if MODE == 4
  vec3 light = 64.0 * abs(apart);
#else
  vec3 light = shown * gain;
#endif
#if FALSE_COLOUR
  return along(${ramp(SIZES)}, 0.5 + log2(max(dot(light, LUMINANCE), 1e-9) / 0.18) / ${2 * STOPS}.0);
#endif
#if TONE == 1
  vec3 colour = clamp(agx(light), 0.0, 1.0);
#elif TONE == 2
  vec3 colour = clamp(light, 0.0, 1.0);
#else
  vec3 colour = srgb(light);
#endif
#if ZEBRA
  bool clips = any(greaterThanEqual(colour, vec3(254.5 / 255.0)));
  if (clips && mod(pixel.x + pixel.y, 8.0) < 4.0) return 0.25 * colour;
#endif
  return colour;
#endif
}
`;

function shader(gl, kind, text) {
  const made = gl.createShader(kind);
  gl.shaderSource(made, `#version 300 es\nprecision highp float;\nprecision highp int;\n${text}`);
  gl.compileShader(made);
  const stands = gl.getShaderParameter(made, gl.COMPILE_STATUS) || gl.isContextLost();
  if (!stands) throw new Error(gl.getShaderInfoLog(made));
  return made;
}

/** The programs of one kind of drawing, each made when it is first asked for. */
export class Programs {
  constructor(gl, vertex, fragment, attributes = []) {
    Object.assign(this, { gl, vertex, fragment, attributes, made: new Map() });
  }

  /** Starts drawing as the view wants it; where uniforms are, by name. */
  use(view, displayed = false) {
    const { gl } = this;
    const numbers = {
      MODE: MODES.indexOf(view.mode), TONE: TONES.indexOf(view.tone), OTHER: view.wipe ? OTHERS.indexOf(view.with) : 0,
      FALSE_COLOUR: Number(view.luminance), ZEBRA: Number(view.zebra), DISPLAYED: Number(displayed),
    };
    const defines = Object.entries(numbers).map(([name, value]) => `#define ${name} ${value}\n`).join("");
    if (!this.made.has(defines)) this.made.set(defines, this.make(defines));
    const { program, places } = this.made.get(defines);
    gl.useProgram(program);
    const at = (name) => (places[name] ??= gl.getUniformLocation(program, name));
    gl.uniform1f(at("gain"), 2 ** view.exposure);
    gl.uniform1f(at("full"), view.full[view.mode] ?? 1);
    gl.uniform1f(at("wipe"), view.at);
    return at;
  }

  free() {
    for (const { program } of this.made.values()) this.gl.deleteProgram(program);
  }

  make(defines) {
    const { gl } = this;
    const program = gl.createProgram();
    gl.attachShader(program, shader(gl, gl.VERTEX_SHADER, this.vertex));
    gl.attachShader(program, shader(gl, gl.FRAGMENT_SHADER, defines + SHADING + this.fragment));
    this.attributes.forEach((name, place) => gl.bindAttribLocation(program, place, name));
    gl.linkProgram(program);
    for (const part of gl.getAttachedShaders(program)) gl.deleteShader(part);
    const stands = gl.getProgramParameter(program, gl.LINK_STATUS) || gl.isContextLost();
    if (!stands) throw new Error(gl.getProgramInfoLog(program));
    return { program, places: {} };
  }
}
