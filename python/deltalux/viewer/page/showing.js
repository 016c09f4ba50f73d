// How the picture is shown: what of it, exposure and tone curve, its legend and histogram; and the page's own colours.

import { along, SIGNS, SIZES, themed } from "./colours.js";
import { $, choices, clamp, element, percent, pressed, slider } from "./dom.js";
import { floats } from "./layers.js";
import { DECADES, MODES, STOPS } from "./shading.js";

const EXPOSURE = { low: -12, high: 12, step: 0.05, unit: "stops" };
const SAMPLES = 4000;
// The histogram shows this many stops to each side of middle grey.
const REACH = 8;

export function mountShowing(app, stage) {
  const { view } = app;
  for (const mode of MODES) $(`mode-${mode}`).onclick = () => view.set({ mode });
  for (const name of ["luminance", "zebra"]) $(name).onclick = () => view.set({ [name]: !view.values[name] });
  $("wipe").onclick = () => view.set({ wipe: !view.values.wipe });
  $("wipe-with").onchange = ({ target }) => view.set({ with: target.value, wipe: true });
  $("keep").onclick = () => {
    stage.picture.keep();
    view.set({ with: "kept", wipe: true });
  };
  $("auto").onclick = () => view.set({ locked: !view.values.locked });
  $("tone").onchange = ({ target }) => view.set({ tone: target.value });
  $("background").onchange = ({ target }) => app.shared.set({ background: target.value });
  const exposure = slider("exposure", "Exposure", EXPOSURE, (value) => view.set({ exposure: value, locked: true }));
  $("exposure-slot").append(exposure.element);

  const update = () => {
    const { mode, wipe, locked, tone, luminance, zebra } = view.values;
    const { background } = app.shared.values;
    for (const name of MODES) pressed($(`mode-${name}`), name === mode);
    for (const name of MODES.slice(1)) $(`mode-${name}`).hidden = !app.compares;
    offerOthers();
    pressed($("wipe"), wipe);
    pressed($("auto"), !locked);
    pressed($("luminance"), luminance);
    pressed($("zebra"), zebra);
    $("tone").value = tone;
    exposure.set(view.values.exposure);
    $("background-label").hidden = background === undefined;
    $("background").value = background ?? "env";
    $("keep").hidden = Boolean(stage.mesh);
  };
  view.on((keys) => {
    app.soon("view", update);
    if (keys.some((key) => ["mode", "full", "luminance"].includes(key))) showLegend(view.values);
  });
  app.shared.on(() => app.soon("view", update));
  app.on("welcome", update);
  app.rescale = (times) => {
    const { mode, full } = view.values;
    if (full[mode]) view.set({ full: { ...full, [mode]: clamp(full[mode] * times, 1e-6, 1e4) } });
  };
  $("finer").onclick = () => app.rescale(0.1);
  $("coarser").onclick = () => app.rescale(10);
  app.showHistogram = () => drawHistogram($("histogram"), sampled(stage.shown.layers.a), view.values.exposure);
  mountTheme(app);

  /** What the wipe can compare with; where what it compared with is gone, the first of the others. */
  function offerOthers() {
    const others = [];
    if (app.compares) others.push(["exact", "exact"]);
    if (app.shared.values.method?.b) others.push(["b", "B"]);
    if (stage.picture?.layers.kept) others.push(["kept", "kept"]);
    choices($("wipe-with"), others);
    const known = others.some(([name]) => name === view.values.with);
    if (!known && others.length) view.set({ with: others[0][0] });
    if (!others.length && view.values.wipe) view.set({ wipe: false });
    $("wipe").disabled = !others.length;
    $("wipe-with").value = view.values.with;
  }
}

function showLegend({ mode, full: scales, luminance }) {
  const full = scales[mode];
  $("legend-scale").hidden = !full;
  const decades = Array.from({ length: DECADES + 1 }, (_, k) => percent(full * 10 ** (k - DECADES)));
  const signs = [`−${percent(full)} dark`, "0", `+${percent(full)} bright`];
  const stops = [`−${STOPS}`, `−${STOPS / 2}`, "0", `+${STOPS / 2}`, `+${STOPS}`];
  const [title, ramp, ticks] = {
    error: ["Error |a − exact|, of white", SIZES, decades],
    bound: ["Bound of the error, of white", SIZES, decades],
    ghosts: ["a − exact, of white", SIGNS, signs],
    difference: ["64 |a − exact|, as a picture", null, []],
    beauty: luminance ? ["Luminance, stops about middle grey", SIZES, stops] : ["", null, []],
  }[mode];
  $("legend").hidden = !title;
  $("legend-title").textContent = title;
  $("legend-ramp").hidden = !ramp;
  $("legend-ticks").replaceChildren(...ticks.map((tick) => element("span", { textContent: tick })));
  if (!ramp) return;
  const pen = $("legend-ramp").getContext("2d");
  const { width, height } = $("legend-ramp");
  for (let x = 0; x < width; x++) {
    pen.fillStyle = along(ramp, x / (width - 1));
    pen.fillRect(x, 0, 1, height);
  }
}

/** Luminances of every few pixels of a layer. */
function sampled(layer) {
  if (!layer) return [];
  const step = 3 * Math.max(1, Math.floor(layer.length / (3 * SAMPLES)));
  const some = new layer.constructor(3 * Math.floor(layer.length / step));
  for (let i = 0, k = 0; k < some.length; i += step, k += 3) some.set(layer.subarray(i, i + 3), k);
  const values = floats(some);
  return Array.from({ length: values.length / 3 }, (_, i) =>
    0.2126 * values[3 * i] + 0.7152 * values[3 * i + 1] + 0.0722 * values[3 * i + 2]);
}

/** Luminances as a histogram in stops about middle grey, after exposure. */
function drawHistogram(canvas, luminances, exposure) {
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  const bins = new Float32Array(width / 2);
  for (const value of luminances) {
    if (!(value > 0)) continue;
    const at = Math.floor(((Math.log2(value / 0.18) + exposure + REACH) / (2 * REACH)) * bins.length);
    bins[Math.min(bins.length - 1, Math.max(0, at))] += 1;
  }
  const most = Math.max(1, ...bins.subarray(1, bins.length - 1));
  pen.clearRect(0, 0, width, height);
  pen.fillStyle = themed("--line");
  // Middle grey, and white on the display, 2.47 stops above it.
  for (const stops of [0, 2.47]) pen.fillRect((width / 2) * (1 + stops / REACH), 0, 1, height);
  pen.fillStyle = themed("--faint");
  bins.forEach((count, k) => {
    const tall = Math.min(1, count / most) ** 0.7 * height;
    pen.fillRect(2 * k, height - tall, 2, tall);
  });
}

function mountTheme(app) {
  const names = { "": "Theme", dark: "Dark", light: "Light" };
  const order = Object.keys(names);
  const set = (theme) => {
    document.documentElement.dataset.theme = theme;
    $("theme").textContent = names[theme];
    localStorage.setItem("deltalux-theme", theme);
    app.tell("theme");
  };
  $("theme").onclick = () => set(order[(order.indexOf(document.documentElement.dataset.theme) + 1) % order.length]);
  const kept = localStorage.getItem("deltalux-theme") ?? "";
  set(kept in names ? kept : "");
  matchMedia("(prefers-color-scheme: dark)").onchange = () => app.tell("theme");
}
