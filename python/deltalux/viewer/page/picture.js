// Pictures: each layer is a texture of half floats, of which only the rows that changed are sent to the card.

import { floats, put, valueAt } from "./layers.js";
import { Programs } from "./shading.js";

const NAMES = ["a", "b", "exact", "bound", "kept"];

const VERTEX = `
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

const FRAGMENT = `
uniform sampler2D a, b, exact, bound, kept;
uniform ivec2 size;
out vec4 colour;
void main() {
  ivec2 p = ivec2(int(gl_FragCoord.x), size.y - 1 - int(gl_FragCoord.y));
  vec3 shown = texelFetch(a, p, 0).rgb;
#if OTHER
  if (gl_FragCoord.x >= wipe * float(size.x)) {
#if OTHER == 1 && MODE == 0
    shown = texelFetch(exact, p, 0).rgb;
#elif OTHER == 2
    shown = texelFetch(b, p, 0).rgb;
#elif OTHER == 3
    shown = texelFetch(kept, p, 0).rgb;
#endif
  }
#endif
  vec3 truth = vec3(0.0), most = vec3(0.0);
#if MODE == 1 || MODE == 2 || MODE == 4
  truth = texelFetch(exact, p, 0).rgb;
#elif MODE == 3
  most = texelFetch(bound, p, 0).rgb;
#endif
#if DISPLAYED && MODE == 0
  colour = vec4(shown, 1.0);
#else
  colour = vec4(shade(shown, truth, most, gl_FragCoord.xy), 1.0);
#endif
}`;

export class Picture {
  constructor(gl, width, height) {
    this.gl = gl;
    this.size = [width, height];
    this.layers = {};
    this.displayed = false;
    this.programs = new Programs(gl, VERTEX, FRAGMENT);
    this.textures = {};
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  }

  texture(name, format) {
    const { gl } = this;
    const held = this.textures[name];
    if (held?.format === format) return held.texture;
    if (held) gl.deleteTexture(held.texture);
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, ...this.size);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    this.textures[name] = { texture, format };
    return texture;
  }

  /** Whole rows of a layer from `y` on, as halves or floats. */
  put(name, values, y) {
    const { gl } = this;
    const [width, height] = this.size;
    this.layers[name] = put(this.layers[name], width * height * 3, y * width * 3, values);
    if (name === "a") this.displayed = false;
    gl.bindTexture(gl.TEXTURE_2D, this.texture(name, gl.RGB16F));
    const type = values instanceof Uint16Array ? gl.HALF_FLOAT : gl.FLOAT;
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, y, width, values.length / (3 * width), gl.RGB, type, values);
  }

  /** A whole layer as the display shows it. */
  putShown(name, bitmap) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.texture(name, gl.RGBA8));
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    bitmap.close();
    delete this.layers[name];
    this.displayed = true;
  }

  /** Keeps the picture as it is now, to compare with. */
  keep() {
    if (this.layers.a) this.put("kept", floats(this.layers.a).slice(), 0);
  }

  free() {
    for (const { texture } of Object.values(this.textures)) this.gl.deleteTexture(texture);
    this.programs.free();
  }

  draw(view) {
    const { gl } = this;
    gl.viewport(0, 0, ...this.size);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    const at = this.programs.use(view, this.displayed);
    gl.uniform2i(at("size"), ...this.size);
    NAMES.forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[name]?.texture ?? null);
      gl.uniform1i(at(name), unit);
    });
    gl.activeTexture(gl.TEXTURE0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Radiance of a layer at a pixel, or null where the layer is not there. */
  at(name, x, y) {
    const layer = this.layers[name];
    const first = 3 * (y * this.size[0] + x);
    return layer ? [0, 1, 2].map((k) => valueAt(layer, first + k)) : null;
  }
}
