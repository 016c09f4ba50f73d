// Every control by keyboard: one table, which is also what "?" shows.

import { $, element } from "./dom.js";

export function mountKeys(app) {
  const view = app.view;
  const mode = (name) => () => view.set({ mode: name });
  const flip = (name) => () => view.set({ [name]: !view.values[name] });
  const press = (id) => () => !$(id).disabled && $(id).offsetParent !== null && $(id).click();
  const expose = (stops) => () => view.set({ exposure: view.values.exposure + stops, locked: true });
  const table = [
    ["a", "Beauty", mode("beauty")],
    ["e", "Error against the exact picture", mode("error")],
    ["g", "Ghosts: the error with its sign", mode("ghosts")],
    ["b", "Bound of the error", mode("bound")],
    ["d", "Difference, 64 times", mode("difference")],
    ["x", "Wipe", press("wipe")],
    ["[", "Wipe to the left", () => view.set({ at: Math.max(0, view.values.at - 0.05) })],
    ["]", "Wipe to the right", () => view.set({ at: Math.min(1, view.values.at + 0.05) })],
    ["h", "Keep this picture to compare with", press("keep")],
    [",", "Darker by a quarter stop", expose(-0.25)],
    [".", "Brighter by a quarter stop", expose(0.25)],
    ["l", "Exposure automatic or locked", flip("locked")],
    ["t", "Next tone curve", () => view.set({ tone: { srgb: "agx", agx: "raw", raw: "srgb" }[view.values.tone] })],
    ["c", "Luminance in false colours", flip("luminance")],
    ["v", "Zebra where the display clips", flip("zebra")],
    ["(", "Maps ten times finer", () => app.rescale(0.1)],
    [")", "Maps ten times coarser", () => app.rescale(10)],
    ["f", "Freeze, or go on", press("freeze")],
    ["n", "Next frame, while frozen", press("step")],
    ["m", "A second method beside the first", press("compare")],
    ["p", "Brush", press("brush")],
    ["s", "To the strip, which arrow keys turn", () => $("strip").focus()],
    ["i", "To the picture, which arrow keys move", () => $("picture").focus()],
    ["w", "The picture alone, or all", press("wide")],
    ["r", "Record the light", press("record")],
    [" ", "Play, or stop", press("play")],
    ["k", "Save as PNG", press("save-png")],
    ["Escape", "Back from what lights a pixel", () => app.forget()],
    ["?", "These keys", () => $("keys").showModal()],
  ];
  const told = [
    ...table.map(([key, what]) => [key === " " ? "Space" : key.length === 1 ? key.toUpperCase() : key, what]),
    ["Ctrl Z, Ctrl Shift Z", "Undo, redo"],
    ["+ − 0 arrows", "On the picture: nearer, further, whole, move; with Shift the arrows turn the light"],
    ["arrows, Alt arrows", "On the strip: turn, tilt; on a lamp's handle: move it"],
    ["Shift drag", "On the picture: turn the light; with Alt freely"],
  ];
  $("keys-body").replaceChildren(element("dl", {}, ...told.flatMap(([key, what]) => [
    element("dt", {}, element("kbd", { textContent: key })), element("dd", { textContent: what }),
  ])));
  $("help").onclick = () => $("keys").showModal();

  addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !writes(event.target)) {
      event.preventDefault();
      return event.shiftKey ? app.history.redo() : app.history.undo();
    }
    if (event.ctrlKey || event.metaKey || event.altKey || writes(event.target)) return;
    if (document.querySelector("dialog[open]")) return;
    // Space and Enter press the button that has the focus.
    if (event.key === " " && event.target.closest("button, select")) return;
    const found = table.find(([key]) => key === (event.key.length === 1 ? event.key.toLowerCase() : event.key));
    if (!found) return;
    event.preventDefault();
    found[2]();
  });
}

const writes = (target) => target.matches("textarea, select, input:not([type=range], [type=color])");
