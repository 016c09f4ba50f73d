// The layers of the picture as they stand: one array each, in the type in which most of it came last.

const HALVES = halves();

/** Every half float as a float, by its bits. */
function halves() {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31;
    const fraction = bits & 1023;
    const size = exponent === 0 ? fraction * 2 ** -24
      : exponent === 31 ? (fraction ? NaN : Infinity)
      : (1 + fraction / 1024) * 2 ** (exponent - 15);
    table[bits] = bits & 0x8000 ? -size : size;
  }
  return table;
}

/** Half floats (as Uint16Array) or floats as floats. */
export function floats(values) {
  if (values instanceof Float32Array) return values;
  const found = new Float32Array(values.length);
  for (let k = 0; k < found.length; k++) found[k] = HALVES[values[k]];
  return found;
}

/** One value of a layer. */
export const valueAt = (values, index) => (values instanceof Uint16Array ? HALVES[values[index]] : values[index]);

/** The numbers of a part of a message, without a copy where they lie well; null where it is made of others. */
export function numbers(part, buffer, start) {
  const type = { f16: Uint16Array, f32: Float32Array, u32: Uint32Array }[part.type];
  if (!type) return null;
  const offset = start + part.offset;
  if (offset % type.BYTES_PER_ELEMENT) return new type(buffer.slice(offset, offset + part.bytes));
  return new type(buffer, offset, part.bytes / type.BYTES_PER_ELEMENT);
}

/** Puts `values` at `first` of a layer of `count` numbers; the layer, a new array where its type had to change. */
export function put(layer, count, first, values) {
  if (values.length === count) return values;
  if (!layer || layer.length !== count) layer = new values.constructor(count);
  if (layer.constructor !== values.constructor) {
    layer = floats(layer);
    values = floats(values);
  }
  layer.set(values, first);
  return layer;
}
