// The sphere unfolded into a cross: the light as asked, as applied, the wavelets that were just sent; and, for one
// pixel, which directions light it ("why is it dark here?").

import { encoded, KINDS } from "./colours.js";
import { $, button, element } from "./dom.js";
import { floats } from "./layers.js";
import { middle } from "./strip.js";

// Where faces +X -X +Y -Y +Z -Z lie in the cross, in faces from the left and the top.
const PLACES = [[2, 1], [0, 1], [1, 0], [1, 2], [1, 1], [3, 1]];
const MIDDLE = 0.18;
const MOST = 300;

export function mountCubemap(app) {
  let row = null;
  let applied = null;
  let asked = null;
  let sent = [];
  let drawn = true;

  app.on("welcome", () => {
    const { columns } = app.welcome;
    $("maps").hidden = !columns?.size;
    row = asked = applied = null;
    for (const id of ["map-asked", "map-applied"]) {
      const most = 4 * (columns?.size ?? 64);
      const times = Math.max(1, Math.ceil(512 / most));
      Object.assign($(id), { width: most * times, height: (most * times * 3) / 4 });
    }
    const chips = (columns?.bands ?? []).map((band, number) => {
      const chip = element("span", { className: "key", textContent: band });
      chip.style.setProperty("--mark", KINDS[number % KINDS.length]);
      return chip;
    });
    $("bands").replaceChildren(element("span", { textContent: columns?.label ?? "" }), ...chips);
    title();
  });

  app.on("maps", (parts) => {
    asked = floats(parts.asked);
    applied = floats(parts.applied);
    drawLeft();
    drawRight();
  });
  app.on("stats", (stats) => {
    if (!stats.a?.sent || $("maps").hidden) return;
    // All that was sent since the squares were drawn: frames are more than drawings.
    sent = drawn ? stats.a.sent : [...sent, ...stats.a.sent].slice(-MOST);
    drawn = false;
    app.soon("maps", drawRight, app.often);
  });

  app.on("click", (x, y) => {
    if (!$("maps").hidden) app.send({ look: [x, y] });
  });
  app.on("row", (header, values) => {
    row = { x: header.x, y: header.y, values: floats(values) };
    title();
    drawLeft();
  });
  app.forget = () => {
    row = null;
    title();
    drawLeft();
  };

  function title() {
    const close = button("forget", "×", () => app.forget(), { title: "Escape", ariaLabel: "Back to the light" });
    $("asked-title").replaceChildren(...(row ? [close, ` Lights (${row.x}, ${row.y})`] : ["Asked"]));
  }

  function drawLeft() {
    const canvas = $("map-asked");
    if (row) drawCross(canvas, row.values, 1 / Math.max(1e-12, largest(row.values)), Math.sqrt);
    else if (asked) drawCross(canvas, asked, MIDDLE / middle(asked), encoded);
  }

  function drawRight() {
    if (!applied) return;
    const canvas = $("map-applied");
    const size = app.welcome.columns.size;
    drawn = true;
    drawCross(canvas, applied, MIDDLE / middle(asked ?? applied), encoded);
    const pen = canvas.getContext("2d");
    const scale = canvas.width / (4 * size);
    pen.lineWidth = 2;
    for (const [face, x, y, texels, band] of sent) {
      const [column, line] = PLACES[face];
      pen.strokeStyle = KINDS[band % KINDS.length];
      const side = texels * scale - 2;
      pen.strokeRect((column * size + x) * scale + 1, (line * size + y) * scale + 1, side, side);
    }
  }
}

function drawCross(canvas, values, gain, curve) {
  const size = Math.round(Math.sqrt(values.length / 18));
  const pen = canvas.getContext("2d");
  const scale = canvas.width / (4 * size);
  const own = new OffscreenCanvas(4 * size, 3 * size);
  const face = new ImageData(size, size);
  PLACES.forEach(([column, line], number) => {
    const start = number * size * size * 3;
    for (let i = 0, o = 0; o < face.data.length; i += 3, o += 4) {
      for (let k = 0; k < 3; k++) face.data[o + k] = 255 * curve(Math.max(0, values[start + i + k] * gain));
      face.data[o + 3] = 255;
    }
    own.getContext("2d").putImageData(face, column * size, line * size);
  });
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(own, 0, 0, own.width * scale, own.height * scale);
}

const largest = (values) => values.reduce((most, value) => Math.max(most, value), 0);
