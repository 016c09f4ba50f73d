// Materials: of curves, parameters and a curve to draw with its lobe beside it; of studios, gamma, what is reflected
// and how much, and what is being edited.

import { fromHex, toHex } from "./colours.js";
import { $, button, choices, div, element, plain, slider } from "./dom.js";
import { mountCurve } from "./curve.js";

const SHARES = [["k_s", "Specular"], ["k_d", "Diffuse"]];
const SHARE = { low: 0, high: 1 };
const TINT = { low: 0, high: 2 };

export function mountMaterials(app) {
  let rows = [];
  const curve = mountCurve(app);

  app.on("welcome", () => {
    const materials = app.welcome.materials ?? [];
    $("materials").hidden = materials.length === 0;
    const body = $("materials-body");
    body.replaceChildren();
    rows = [];
    if (!materials.length) return;
    if (materials.some(({ kind }) => kind === "family")) body.append(editing(app, materials));
    for (const material of materials) {
      const row = material.kind === "curve" ? curveRow(app, material, curve) : familyRow(app, material);
      rows.push(row);
      body.append(row.element);
    }
    const first = materials.find(({ kind }) => kind === "curve");
    if (first) {
      body.append(curve.element);
      curve.choose(first.name);
    }
    update();
  });
  app.shared.on((keys) => keys.some((key) => ["materials", "editing", "curves"].includes(key)) && update());

  function update() {
    const { materials, editing: name } = app.shared.values;
    if (!materials) return;
    for (const row of rows) row.update(materials[row.name] ?? {});
    if ($("editing")) $("editing").value = name ?? "";
  }
}

/** Changes a material, and keeps the picture from before the first change to compare with. */
function change(app, name, changes, others = {}) {
  const { materials } = app.shared.values;
  app.keepFirst();
  app.shared.set({ materials: { ...materials, [name]: { ...materials[name], ...changes } }, ...others });
}

function editing(app, materials) {
  const select = element("select", { id: "editing" });
  select.onchange = () => app.shared.set({ editing: select.value || null });
  choices(select, [["", "lamps"], ...materials.map(({ name }) => [name, `gamma of ${name}`])]);
  return element("label", { className: "plain" }, "What moves ", select);
}

function parameters(name, list, act) {
  return list.map(({ name: key, low, high, log }) => {
    const range = { low, high, scale: log ? "log" : "linear" };
    return [key, slider(`${key}-${plain(name)}`, key, range, (value) => act({ [key]: value }))];
  });
}

function curveRow(app, { name, parameters: list, colour }, curve) {
  // A parameter that moves takes the place of what was drawn.
  const act = (changes) => change(app, name, changes, { curves: { ...app.shared.values.curves, [name]: null } });
  const tint = coloured(`colour-${plain(name)}`, "colour", TINT, (value) => change(app, name, { colour: value }));
  const sliders = [...parameters(name, list, act), ["colour", tint]];
  const title = button(`material-${plain(name)}`, name, () => curve.choose(name), { className: "name" });
  const patch = element("span", { className: "patch" });
  patch.style.background = toHex(colour);
  const whole = div("group", div("head", patch, title), ...sliders.map(([, one]) => one.element));
  return {
    name,
    element: whole,
    update(values) {
      for (const [key, one] of sliders) {
        one.element.hidden = !(key in values);
        if (key in values) one.set(values[key]);
      }
    },
  };
}

function familyRow(app, { name, parameters: list }) {
  const act = (changes) => change(app, name, changes);
  // Whose gamma moves is the one that is edited.
  const sliders = parameters(name, list, (changes) => change(app, name, changes, { editing: name }));
  const share = ([key, label]) => {
    return [key, coloured(`${key}-${plain(name)}`, label, SHARE, (value) => act({ [key]: value }))];
  };
  const all = [...sliders, ...SHARES.map(share)];
  const tint = element("input", { id: `colour-${plain(name)}`, type: "color", ariaLabel: `Colour of ${name}` });
  tint.oninput = () => act({ colour: fromHex(tint.value) });
  const head = div("head", element("b", { className: "name", textContent: name }), tint);
  const whole = div("group", head, ...all.map(([, one]) => one.element));
  return {
    name,
    element: whole,
    update(values) {
      for (const [key, one] of all) if (values[key] !== undefined) one.set(values[key]);
      tint.value = toHex(values.colour ?? [1, 1, 1]);
    },
  };
}

/** Three values as one slider for the largest and a colour for their ratios. */
export function coloured(id, label, range, act) {
  let colour = [1, 1, 1];
  let amount = range.low;
  const give = () => act(colour.map((value) => value * amount));
  const one = slider(id, label, range, (value) => ((amount = value), give()));
  const input = element("input", { id: `${id}-colour`, type: "color", ariaLabel: `Colour of ${label}` });
  input.oninput = () => ((colour = fromHex(input.value)), give());
  one.element.append(input);
  return {
    element: one.element,
    set(values) {
      const three = Array.isArray(values) ? values : [values, values, values];
      amount = Math.max(...three);
      if (amount > 0) colour = three.map((value) => value / amount);
      one.set(amount);
      if (document.activeElement !== input) input.value = toHex(colour);
    },
  };
}
