// The curve of a lobe over the half angle, to be pulled, and the lobe itself beside it in polar form; as it was at
// first (dashed) and as it is.

import { themed } from "./colours.js";
import { button, clamp, div, drags, element } from "./dom.js";

// Decades shown below the largest value, and how far a pull reaches, in radians.
const DECADES = 4;
const REACH = 0.09;
const RIGHT = Math.PI / 2;

const HINT = "Curve over the half angle: drag to pull it; left and right choose the angle, up and down pull";

const COLOURS = ["all colours", "red", "green", "blue"];
const LINES = ["#e05545", "#3fa45a", "#4f7fe0"];

const mean = ([r, g, b]) => (r + g + b) / 3;

export function mountCurve(app) {
  const plot = element("canvas", { id: "curve", width: 190, height: 130, tabIndex: 0, ariaLabel: HINT });
  const lobe = element("canvas", { id: "lobe", width: 96, height: 130, ariaLabel: "The lobe, in polar form" });
  const title = element("b");
  const put = (curve) => app.shared.set({ curves: { ...app.shared.values.curves, [name]: curve } });
  const back = button("curve-back", "By parameters", () => put(null), { title: "Back to the curve of the parameters" });
  const colour = element("select", { id: "curve-colour", ariaLabel: "Which colour of the curve is pulled" });
  colour.append(...COLOURS.map((text, k) => new Option(text, String(k - 1))));
  const whole = div("curve", div("head", title, colour, back), div("pair", plot, lobe));
  const first = {};
  const now = {};
  let name = null;
  let pulling = false;
  let angle = 0.2;
  // What of a value is pulled: one colour, or the mean of all.
  const level = (three) => (Number(colour.value) < 0 ? mean(three) : three[Number(colour.value)]);
  colour.onchange = () => draw();

  app.on("curve", (curve) => {
    first[curve.name] ??= curve;
    if (pulling && curve.name === name) return;
    now[curve.name] = curve;
    if (curve.name !== name) return;
    scale();
    draw();
  });
  app.on("theme", () => draw());

  // The scale stays while a pull lasts, else the curve would flee from the pointer.
  let top = 1;
  const scale = () => (top = 3 * Math.max(1e-6, ...now[name].values.flat()));
  const least = () => top * 10 ** -DECADES;
  const down = (value) => (Math.log10(top / Math.max(value, 1e-12)) / DECADES) * plot.height;

  drags(plot, {
    down: (event) => {
      if (!now[name]) return false;
      pulling = true;
      app.keepFirst();
      pull(event);
    },
    move: (dx, dy, event) => pull(event),
    up: () => {
      pulling = false;
      scale();
      draw();
    },
  });
  plot.onkeydown = (event) => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!way || !now[name]) return;
    event.preventDefault();
    angle = clamp(angle + way[0] * 0.05, 0, RIGHT);
    // What lies below the plot is pulled from its lower edge.
    if (way[1]) to(angle, Math.max(valueAt(angle), least()) * 1.2 ** way[1]);
    draw();
  };

  function pull(event) {
    const box = plot.getBoundingClientRect();
    const theta = clamp((event.clientX - box.left) / box.width, 0, 1) * RIGHT;
    const share = clamp((event.clientY - box.top) / box.height, 0, 1);
    to((angle = theta), share === 1 ? 0 : top * 10 ** (-share * DECADES));
  }

  function valueAt(theta) {
    const { theta: angles, values } = now[name];
    const next = Math.max(1, angles.findIndex((one) => one >= theta));
    const t = clamp((theta - angles[next - 1]) / (angles[next] - angles[next - 1]), 0, 1);
    return level(values[next - 1]) * (1 - t) + level(values[next]) * t;
  }

  /** Pulls the curve to a value at an angle; its neighbours follow by the same ratio, less the further off. */
  function to(theta, value) {
    const edge = least();
    const ratio = Math.max(value, 1e-3 * edge) / Math.max(valueAt(theta), edge);
    const { theta: angles, values } = now[name];
    const pulled = values.map((three, k) => {
      const share = Math.exp(-0.5 * ((angles[k] - theta) / REACH) ** 2);
      if (share < 1e-3) return three;
      const only = Number(colour.value);
      if (only >= 0) return three.with(only, Math.max(three[only], edge) * ratio ** share);
      const held = mean(three) < edge ? [edge, edge, edge] : three;
      return held.map((one) => one * ratio ** share);
    });
    now[name] = { ...now[name], values: pulled };
    put({ theta: angles, values: pulled });
    draw();
  }

  function draw() {
    if (!now[name]) return;
    const pen = plot.getContext("2d");
    const { width, height } = plot;
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = themed("--faint");
    pen.font = "10px system-ui, sans-serif";
    for (const degrees of [0, 30, 60]) {
      pen.fillRect((degrees / 90) * width, 0, 0.5, height);
      pen.fillText(`${degrees}°`, (degrees / 90) * width + 2, height - 3);
    }
    const across = ({ theta, values }, height) =>
      theta.map((one, k) => [(one / RIGHT) * width, down(height(values[k]))]);
    line(pen, [4, 3], themed("--faint"), across(first[name], level));
    const coloured = now[name].values.some(([r, g, b]) => Math.max(r, g, b) > 1.01 * Math.min(r, g, b));
    if (coloured) LINES.forEach((ink, c) => line(pen, [], ink, across(now[name], (three) => three[c])));
    line(pen, [], themed("--accent"), across(now[name], level));
    pen.fillStyle = themed("--ink");
    pen.fillRect((angle / RIGHT) * width - 2, clamp(down(valueAt(angle)), 0, height) - 2, 4, 4);
    drawLobe();
  }

  function drawLobe() {
    const pen = lobe.getContext("2d");
    const { width, height } = lobe;
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = themed("--line");
    pen.fillRect(0, height - 6, width, 1);
    // The largest that both lobes fit into the canvas with.
    const fits = ({ theta, values }) => theta.map((angle, k) =>
      mean(values[k]) * Math.max(Math.cos(angle) / (height - 12), Math.sin(angle) / (width / 2 - 3)));
    const largest = Math.max(1e-12, ...[first[name], now[name]].flatMap(fits));
    for (const [curve, dash, colour] of [[first[name], [4, 3], "--faint"], [now[name], [], "--accent"]]) {
      const side = (sign) => curve.theta.map((theta, k) => {
        const reach = mean(curve.values[k]) / largest;
        return [width / 2 + sign * reach * Math.sin(theta), height - 6 - reach * Math.cos(theta)];
      });
      line(pen, dash, themed(colour), [...side(-1).reverse(), ...side(1)]);
    }
  }

  return {
    element: whole,
    choose(chosen) {
      name = chosen;
      title.textContent = name;
      if (now[name]) scale();
      draw();
      app.send({ curve: name });
    },
  };
}

function line(pen, dash, ink, points) {
  pen.setLineDash(dash);
  pen.strokeStyle = ink;
  pen.lineWidth = 1.5;
  pen.beginPath();
  points.forEach(([x, y], k) => pen[k ? "lineTo" : "moveTo"](x, y));
  pen.stroke();
  pen.setLineDash([]);
}
