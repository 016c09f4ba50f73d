// The last 300 frames, drawn: where their time went, and how far off they were.

import { CHOOSE, KINDS, LATE, LIGHT, MULTIPLY, themed } from "./colours.js";
import { $, element, percent, readable } from "./dom.js";

const FRAMES = 300;
const TIMES = [["light", LIGHT], ["choose", CHOOSE], ["multiply", MULTIPLY]];
const LINES = [
  ["error", KINDS[0], (stats) => stats.error],
  ["error B", KINDS[6], (stats) => stats.error_b],
  ["not sent", KINDS[1], ({ a }) => a.relative_pending ?? a.pending],
  ["truncated", KINDS[2], ({ a }) => a.relative_truncation ?? a.truncation],
];
const LEAST = 1e-5;
const LEFT = 46;
const BOTTOM = 4;

export function mountPlots(app) {
  const past = [];
  key($("plot-time-key"), [...TIMES, ["late", LATE]]);
  const keyErrors = () => {
    const there = { error: app.compares, "error B": app.compares && Boolean(app.shared.values.method?.b) };
    const lines = LINES.filter(([name]) => there[name] ?? true);
    key($("plot-error-key"), [...lines, ["reset", themed("--faint")]]);
  };
  app.on("welcome", () => {
    past.splice(0);
    $("plot-error-title").textContent = app.compares ? "Error, bound" : "Bound";
    keyErrors();
  });
  app.shared.on((keys) => keys.includes("method") && keyErrors());
  app.on("stats", (stats) => {
    if (!stats.a) return;
    // The squares that were sent are most of it, and of no use here.
    const { sent, ...a } = stats.a;
    past.push({ ...stats, a });
    if (past.length > FRAMES) past.shift();
    app.soon("plots", draw, app.often);
  });
  app.on("theme", () => {
    keyErrors();
    draw();
  });
  new ResizeObserver(() => draw()).observe($("plot-time"));

  function draw() {
    drawTimes(begin($("plot-time")), past, app.shared.values.method?.a);
    drawErrors(begin($("plot-error")), past);
  }
}

function key(target, entries) {
  target.replaceChildren(...entries.map(([name, colour]) => {
    const made = element("span", { className: "key", textContent: name });
    made.style.setProperty("--mark", colour);
    return made;
  }));
}

/** A canvas cleared at the display's own resolution, and its place in CSS pixels. */
function begin(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const density = devicePixelRatio;
  if (canvas.width !== Math.round(width * density) || canvas.height !== Math.round(height * density)) {
    canvas.width = Math.round(width * density);
    canvas.height = Math.round(height * density);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(density, 0, 0, density, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "10px system-ui, sans-serif";
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  return { pen, width, height, across: (k) => LEFT + (k * (width - LEFT)) / FRAMES };
}

function grid({ pen, width }, y, text) {
  pen.strokeStyle = themed("--line");
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(LEFT, Math.round(y) + 0.5);
  pen.lineTo(width, Math.round(y) + 0.5);
  pen.stroke();
  pen.fillStyle = themed("--faint");
  pen.fillText(text, LEFT - 4, y);
}

function drawTimes(plot, past, method) {
  const { pen, height, across } = plot;
  const times = past.map(({ a }) => a.seconds * 1000);
  const sorted = [...times].sort((p, q) => p - q);
  // One slow frame must not flatten all others: it is cut off at the top.
  const usual = sorted[Math.floor(0.97 * (sorted.length - 1))] ?? 1;
  const allowed = method?.budget === "milliseconds" ? method.amount : 0;
  const top = 1.4 * Math.max(0.05, usual, allowed);
  const up = (ms) => height - BOTTOM - (Math.min(ms, top) * (height - BOTTOM - 8)) / top;
  for (const ms of [0, 0.45 * top, 0.9 * top]) grid(plot, up(ms), ms ? `${Number(ms.toPrecision(2))} ms` : "0");
  const wide = Math.max(1, across(1) - across(0));
  past.forEach(({ a }, k) => {
    const choosing = 1000 * (a.choosing ?? 0);
    const multiplying = 1000 * (a.multiplying ?? a.seconds);
    const parts = [Math.max(0, times[k] - choosing - multiplying), choosing, multiplying];
    let from = 0;
    parts.forEach((ms, part) => {
      pen.fillStyle = a.late ? LATE : TIMES[part][1];
      pen.fillRect(across(k), up(from + ms), wide, up(from) - up(from + ms));
      from += ms;
    });
  });
  if (allowed) {
    pen.fillStyle = themed("--ink");
    pen.fillRect(LEFT, up(allowed), plot.width - LEFT, 1);
  }
}

function drawErrors(plot, past) {
  const { pen, height, across } = plot;
  const all = past.flatMap((stats) => LINES.map(([, , of]) => of(stats)).filter((value) => value > LEAST));
  const high = Math.ceil(Math.log10(Math.max(1e-2, ...all)));
  const low = Math.min(high - 2, Math.floor(Math.log10(Math.min(1e-3, ...all)) + 1e-9));
  const up = (value) => 6 + ((high - Math.log10(Math.max(value, 10 ** low))) * (height - BOTTOM - 8)) / (high - low);
  const written = past.at(-1)?.a.relative_pending === undefined ? readable : percent;
  for (let decade = low; decade <= high; decade += Math.ceil((high - low) / 5)) {
    grid(plot, up(10 ** decade), written(10 ** decade));
  }
  past.forEach(({ a }, k) => {
    if (!a.resets?.length) return;
    pen.fillStyle = themed("--faint");
    pen.fillRect(across(k), 0, 1, 7);
  });
  for (const [, colour, of] of LINES) {
    pen.strokeStyle = colour;
    pen.lineWidth = 1.5;
    pen.beginPath();
    let drawn = false;
    past.forEach((stats, k) => {
      const value = of(stats);
      if (value === null || value === undefined) return (drawn = false);
      pen[drawn ? "lineTo" : "moveTo"](across(k), up(value));
      drawn = true;
    });
    pen.stroke();
  }
}
