// Colours that the colour-blind tell apart: Okabe and Ito's eight for kinds, one ramp for sizes, one for signs.

export const KINDS = ["#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7", "#bbbbbb"];
export const LIGHT = KINDS[1];
export const CHOOSE = KINDS[3];
export const MULTIPLY = KINDS[2];
export const LATE = "#ff4030";

// Viridis at eighths (Smith and van der Walt 2015), sRGB.
export const SIZES = [
  [0.267, 0.005, 0.329], [0.275, 0.194, 0.496], [0.212, 0.359, 0.552], [0.153, 0.497, 0.558],
  [0.122, 0.633, 0.531], [0.288, 0.758, 0.428], [0.627, 0.855, 0.223], [0.993, 0.906, 0.144],
];

// From too dark (blue) through nothing to too bright (orange).
export const SIGNS = [
  [0.6, 0.87, 1.0], [0.25, 0.62, 0.95], [0.1, 0.33, 0.6], [0.11, 0.11, 0.11],
  [0.11, 0.11, 0.11], [0.6, 0.3, 0.05], [0.93, 0.55, 0.1], [1.0, 0.85, 0.5],
];

/** The colour at share `t` of a ramp, as CSS. */
export function along(ramp, t) {
  const place = Math.min(1, Math.max(0, t)) * (ramp.length - 1);
  const first = Math.min(ramp.length - 2, Math.floor(place));
  const rest = place - first;
  const mixed = ramp[first].map((value, k) => Math.round(255 * (value + rest * (ramp[first + 1][k] - value))));
  return `rgb(${mixed})`;
}

export const encoded = (linear) => (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
const decoded = (shown) => (shown <= 0.04045 ? shown / 12.92 : ((shown + 0.055) / 1.055) ** 2.4);

/** "#rrggbb" as linear RGB, and back. */
export const fromHex = (hex) => [1, 3, 5].map((at) => decoded(parseInt(hex.slice(at, at + 2), 16) / 255));
export function toHex(linear) {
  const bytes = linear.map((value) => Math.round(255 * Math.min(1, Math.max(0, encoded(value)))));
  return `#${bytes.map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}

/** A colour of the page's own theme. */
export const themed = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
