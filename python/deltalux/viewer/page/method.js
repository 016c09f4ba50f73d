// The method, or two side by side, with their budgets; freezing and stepping; and what a frame says of itself.

import { $, choices, div, element, percent, pressed, readable, slider } from "./dom.js";

const AMOUNTS = {
  terms: { low: 1, high: 4096, step: 1, scale: "log", unit: "terms", first: 30 },
  milliseconds: { low: 0.05, high: 50, scale: "log", unit: "ms", first: 2 },
  error: { low: 1e-4, high: 1, scale: "log", unit: "of 1", first: 0.01 },
};
const WEIGHTS = { none: "no weight", "root-area": "root of area", cost: "gain for cost" };

// An error of light this many seconds ago is marked with its age.
const OLD = 0.3;

export function mountMethod(app) {
  const panels = { a: panel(app, "a"), b: panel(app, "b") };

  $("compare").onclick = () => {
    const { method } = app.shared.values;
    app.shared.set({ method: { ...method, b: method.b ? null : besides(app.welcome.methods, method.a) } });
    app.view.set(method.b ? { wipe: false, with: "exact" } : { wipe: true, with: "b" });
  };
  $("freeze").onclick = () => app.shared.set({ frozen: !app.shared.values.frozen });
  $("step").onclick = () => app.shared.values.frozen && app.send({ step: 1 });

  const update = () => {
    const { method, frozen } = app.shared.values;
    $("methods").hidden = !method || !app.welcome.methods?.length;
    if ($("methods").hidden) return;
    $("panel-b").hidden = !method.b;
    pressed($("compare"), Boolean(method.b));
    pressed($("freeze"), Boolean(frozen));
    $("step").disabled = !frozen;
    panels.a.update(method.a);
    if (method.b) panels.b.update(method.b);
  };
  app.on("welcome", () => {
    for (const one of Object.values(panels)) one.fill(app.welcome);
    update();
  });
  app.shared.on((keys) => (keys.includes("method") || keys.includes("frozen")) && update());
  app.on("stats", () => app.soon("readouts", () => showReadouts(app.stats), app.often));
}

/** Another method with the same budget, to begin a comparison with. */
function besides(methods, method) {
  const other = methods.find(({ name, budgets }) => name !== method.name && budgets.includes(method.budget));
  return { ...method, name: other?.name ?? method.name };
}

function panel(app, side) {
  const change = (changes) => {
    const { method } = app.shared.values;
    app.shared.set({ method: { ...method, [side]: { ...method[side], ...changes } } });
  };
  const known = (name) => app.welcome.methods.find((one) => one.name === name);
  const select = (name, title, act) =>
    element("select", { id: `${name}-${side}`, ariaLabel: title, onchange: ({ target }) => act(target.value) });
  const setBudget = (budget) => change({ budget, amount: AMOUNTS[budget].first });
  const name = select("method", "Method", (value) => {
    const { budgets } = known(value);
    const own = app.shared.values.method[side];
    if (budgets.length === 0) change({ name: value });
    else if (budgets.includes(own.budget)) change({ name: value });
    else change({ name: value, budget: budgets[0], amount: AMOUNTS[budgets[0]].first });
  });
  const budget = select("budget", "Budget", setBudget);
  const weight = select("weight", "Weight", (value) => change({ weight: value }));
  const slot = div("amount");
  let amount = null;
  $(`panel-${side}`).append(name, budget, slot, weight);

  const remake = (kind, most) => {
    const range = { ...AMOUNTS[kind] };
    if (kind === "terms") range.high = Math.max(2, most);
    amount = { kind, ...slider(`amount-${side}`, "Amount", range, (value) => change({ amount: value })) };
    slot.replaceChildren(amount.element);
  };
  return {
    fill({ methods, weights }) {
      choices(name, methods.map((one) => [one.name, one.title]));
      choices(weight, weights.map((one) => [one, WEIGHTS[one] ?? one]));
      amount = null;
    },
    update(method) {
      const { budgets } = known(method.name) ?? { budgets: [] };
      const whole = budgets.length === 0;
      budget.hidden = slot.hidden = weight.hidden = whole;
      name.value = method.name;
      if (whole) return;
      choices(budget, budgets.map((one) => [one, one]));
      budget.value = method.budget;
      weight.value = method.weight;
      if (amount?.kind !== method.budget) remake(method.budget, app.welcome.columns?.count ?? 4096);
      amount.set(method.amount);
    },
  };
}

function showReadouts({ a, b, error, error_b: errorB, age }) {
  if (!a) return;
  $("converged").hidden = !a.converged;
  $("late").hidden = !a.late;
  list($("readouts"), [...ofFrame(a, b ? "A frame" : "frame"), ...ofError(error, age), ...ofBound(a)]);
  $("readouts-b").hidden = !b;
  if (b) list($("readouts-b"), [...ofFrame(b, "B frame"), ...ofError(errorB, age), ...ofBound(b)]);
}

function list(target, told) {
  target.replaceChildren(...told.map(([name, value]) =>
    div("", element("dt", { textContent: name }), element("dd", { textContent: value }))));
}

function ofFrame({ seconds, columns, resets }, name) {
  const told = [[name, `${readable(1000 * seconds)} ms`], ["columns sent", readable(columns)]];
  if (resets?.length) told.push(["reset", resets.length > 3 ? `${resets.length} bands` : `band ${resets.join(", ")}`]);
  return told;
}

const ofError = (error, age) =>
  error === undefined ? [] : [["error", percent(error) + (age > OLD ? ` · ${readable(age)} s ago` : "")]];

function ofBound({ relative_pending: pending, relative_truncation: truncation, ...absolute }) {
  if (Number.isFinite(pending)) {
    const whole = percent(pending + (truncation ?? 0));
    return [["bound", `${whole} = ${percent(pending)} not sent + ${percent(truncation)} truncated`]];
  }
  const named = [["pending", "not sent"], ["truncation", "truncated"]];
  const parts = named.filter(([key]) => Number.isFinite(absolute[key]));
  const told = parts.map(([key, name]) => `${readable(absolute[key])} ${name}`);
  return told.length ? [["bound", told.join(" + ")]] : [];
}
