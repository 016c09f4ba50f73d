// Elements and the few controls that every panel is made of.

export const $ = (id) => document.getElementById(id);

/** A name as a part of an id. */
export const plain = (name) => name.replace(/[^\w.-]+/g, "-");

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

export const div = (className, ...children) => element("div", { className }, ...children);

export const button = (id, text, act, properties = {}) =>
  element("button", { id, type: "button", textContent: text, onclick: act, ...properties });

export function pressed(target, on) {
  target.setAttribute("aria-pressed", String(on));
}

/** What a select offers, in pairs of value and text; left alone where it offers that already. */
export function choices(select, pairs) {
  const text = JSON.stringify(pairs);
  if (select.offered === text) return;
  select.offered = text;
  select.replaceChildren(...pairs.map(([value, text]) => element("option", { value, textContent: text })));
}

/** A labelled slider with a field for the number. `scale` "log" moves by equal ratios. `set` does not call `act`. */
export function slider(id, label, { low, high, step = 0, scale = "linear", unit = "" }, act) {
  const log = scale === "log";
  const toRange = (value) => (log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
  const fromRange = (share) => rounded(log ? low * (high / low) ** share : low + (high - low) * share, step);
  const range = element("input", { id, type: "range", min: 0, max: 1, step: "any", "aria-label": label });
  const number = element("input", { id: `${id}-number`, type: "text", inputMode: "decimal" });
  number.ariaLabel = `${label}, as a number`;
  const text = element("label", { htmlFor: id, textContent: label });
  const show = (value) => {
    range.setAttribute("aria-valuetext", `${number.value} ${unit}`);
    return value;
  };
  const set = (value) => {
    range.value = toRange(value);
    if (document.activeElement !== number) number.value = readable(value);
    show(value);
  };
  range.oninput = () => {
    const value = fromRange(Number(range.value));
    number.value = readable(value);
    act(show(value));
  };
  // A range with step "any" takes too small steps by key: one step of ours, or a hundredth of the way.
  range.onkeydown = (event) => {
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
    if (!way) return;
    event.preventDefault();
    const now = Number(range.value);
    const least = step && !log ? step / (high - low) : 0.01;
    let next = clamp(now + way * least, 0, 1);
    if (step && fromRange(next) === fromRange(now)) next = clamp(toRange(fromRange(now) + Math.sign(way) * step), 0, 1);
    range.value = next;
    range.oninput();
  };
  number.onchange = () => {
    const value = Number(number.value.replace(",", "."));
    const given = Number.isFinite(value) && number.value.trim() !== "";
    const held = given ? clamp(value, low, high) : fromRange(Number(range.value));
    range.value = toRange(held);
    number.value = readable(held);
    act(show(held));
  };
  const whole = div("slider", text, range, number);
  if (unit) whole.append(element("span", { className: "unit", textContent: unit }));
  return { element: whole, set };
}

export const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

const rounded = (value, step) => (step ? Math.round(value / step) * step : value);

/** A number in three digits, or whole, without zeros at its end. */
export function readable(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e-3 || size >= 1e6) return value.toExponential(1);
  return String(size >= 1000 ? Math.round(value) : Number(value.toPrecision(3)));
}

export const percent = (share) => (share === null || share === undefined ? "–" : `${readable(100 * share)} %`);

/** Calls `act(dx, dy, event)` with the way since the last call while a pointer is down on `target`. */
export function drags(target, { down = () => true, move, up = () => {} }) {
  let last = null;
  target.addEventListener("pointerdown", (event) => {
    if (event.button > 0 && event.pointerType === "mouse") return;
    if (down(event) === false) return;
    target.setPointerCapture(event.pointerId);
    last = [event.clientX, event.clientY];
  });
  target.addEventListener("pointermove", (event) => {
    if (!last) return;
    const [x, y] = last;
    last = [event.clientX, event.clientY];
    move(event.clientX - x, event.clientY - y, event);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    target.addEventListener(end, (event) => {
      if (last) up(event);
      last = null;
    });
  }
}

export function download(bytes, name, media) {
  const address = URL.createObjectURL(new Blob([bytes], { type: media }));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}
