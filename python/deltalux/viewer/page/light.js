// The panel of light: environments to swap in, a fade between two, and the groups that make up the light.

import { fromHex, toHex } from "./colours.js";
import { $, button, choices, div, element, plain, pressed, slider } from "./dom.js";

const MOST = 16;
const SHARED = { gain: 0, tint: [1, 1, 1], mute: false, solo: false };
const RANGES = {
  gain: { low: -20, high: 20, step: 0.1, unit: "stops" },
  azimuth: { low: 0, high: 360, step: 1, unit: "°" },
  elevation: { low: -90, high: 90, step: 1, unit: "°" },
  radius: { low: 0.3, high: 60, scale: "log", unit: "°" },
};
const UNTURNED = [0, 0, 0, 1];
// A disc of the sun's size at this gain lights about as much as a bright sky; a lamp of 15 degrees about the same.
const SUN = { kind: "lamp", azimuth: 135, elevation: 40, radius: 0.3, gain: 15 };
const LAMP = { kind: "lamp", azimuth: 225, elevation: 30, radius: 15, gain: 3 };

let chosen = null;

/** The environment that turns and swaps: the chosen one, or the first. */
export function activeEnvironment(app) {
  const own = app.shared.values.light?.groups.filter((group) => group.kind === "environment") ?? [];
  return own.find((group) => group.id === chosen) ?? own[0];
}

export function changeGroup(app, id, changes) {
  const { light } = app.shared.values;
  const groups = light.groups.map((group) => (group.id === id ? { ...group, ...changes } : group));
  app.shared.set({ light: { ...light, groups } });
}

export function freeId(app, letter) {
  const taken = new Set(app.shared.values.light.groups.map((group) => group.id));
  let number = 1;
  while (taken.has(letter + number)) number += 1;
  return letter + number;
}

export function mountLight(app) {
  const rows = new Map();

  app.addGroup = (group) => {
    const { light } = app.shared.values;
    if (light.groups.length >= MOST) {
      app.say(`A light has at most ${MOST} groups.`);
      return false;
    }
    app.shared.set({ light: { ...light, groups: [...light.groups, { ...SHARED, ...group }] } });
    return true;
  };
  $("add-sun").onclick = () => app.addGroup({ ...SUN, id: freeId(app, "s") });
  $("add-lamp").onclick = () => app.addGroup({ ...LAMP, id: freeId(app, "s") });
  $("add-environment").onclick = () => {
    const id = freeId(app, "e");
    const source = activeEnvironment(app)?.source ?? app.welcome.sources[0].name;
    if (app.addGroup({ id, kind: "environment", source, turn: UNTURNED })) chosen = id;
    update();
  };

  const fade = slider("fade-amount", "Fade", { low: 0, high: 1, step: 0.01 }, (t) => blend({ t }));
  $("fade-slot").append(fade.element);
  $("fade-to").onchange = () => blend({ source: $("fade-to").value || null });
  const blend = (changes) => {
    const { light } = app.shared.values;
    app.shared.set({ light: { ...light, blend: { ...light.blend, ...changes } } });
  };

  app.on("welcome", () => {
    $("light").hidden = !app.shared.values.light;
    offer();
  });
  app.on("sources", offer);
  app.shared.on((keys) => keys.includes("light") && update());

  function offer() {
    const { sources } = app.welcome;
    $("add-environment").hidden = $("fade").hidden = sources.length === 0;
    $("thumbs").replaceChildren(...sources.map(thumb));
    choices($("fade-to"), [["", "nothing"], ...sources.map(({ name }) => [name, name])]);
    update();
  }

  function thumb({ name, thumb: picture }) {
    const image = element("img", { src: picture, alt: "", width: 64, height: 32 });
    const text = element("span", { textContent: name });
    const act = () => {
      const group = activeEnvironment(app);
      if (group) changeGroup(app, group.id, { source: name });
      else app.addGroup({ id: freeId(app, "e"), kind: "environment", source: name, turn: UNTURNED });
    };
    const made = button(`thumb-${plain(name)}`, "", act, { className: "thumb", title: `Light by ${name}` });
    made.append(image, text);
    return made;
  }

  function update() {
    const { light } = app.shared.values;
    if (!light || !app.welcome) return;
    const active = activeEnvironment(app);
    for (const { name } of app.welcome.sources) pressed($(`thumb-${plain(name)}`), name === active?.source);
    $("fade-to").value = light.blend?.source ?? "";
    $("fade-slot").hidden = !light.blend?.source;
    fade.set(light.blend?.t ?? 0);

    for (const [id, row] of rows) {
      if (light.groups.some((group) => group.id === id && group.kind === row.kind)) continue;
      row.element.remove();
      rows.delete(id);
    }
    for (const group of light.groups) {
      if (!rows.has(group.id)) rows.set(group.id, groupRow(app, group, update));
      const row = rows.get(group.id);
      if (!row.element.isConnected) $("groups").append(row.element);
      row.update(group, group.id === active?.id);
    }
  }
}

/** The controls of one group, made once and then kept up to date, so that a drag on one is not torn from it. */
function groupRow(app, { id, kind }, update) {
  const change = (changes) => changeGroup(app, id, changes);
  const current = () => app.shared.values.light.groups.find((group) => group.id === id);
  const flip = (name) => () => change({ [name]: !current()[name] });
  const title = button(`group-${id}`, "", () => {
    if (kind === "environment") chosen = id;
    update();
  }, { className: "name" });
  const mute = button(`mute-${id}`, "M", flip("mute"), { title: "Mute", ariaLabel: `Mute ${id}` });
  const solo = button(`solo-${id}`, "S", flip("solo"), { title: "Solo", ariaLabel: `Solo ${id}` });
  const tint = element("input", { id: `tint-${id}`, type: "color", title: "Tint", ariaLabel: `Tint of ${id}` });
  tint.oninput = () => change({ tint: fromHex(tint.value) });
  const remove = button(`remove-${id}`, "×", () => {
    const { light } = app.shared.values;
    if (kind === "paint") app.send({ unpaint: id });
    app.shared.set({ light: { ...light, groups: light.groups.filter((group) => group.id !== id) } });
  }, { title: "Remove", ariaLabel: `Remove ${id}` });
  const names = kind === "lamp" ? Object.keys(RANGES) : ["gain"];
  const sliders = Object.fromEntries(names.map((name) => {
    const text = name[0].toUpperCase() + name.slice(1);
    return [name, slider(`${name}-${id}`, text, RANGES[name], (value) => change({ [name]: value }))];
  }));
  const head = div("head", title, mute, solo, tint, remove);
  if (kind === "paint") head.insertBefore(button(`unpaint-${id}`, "Clear", () => app.send({ unpaint: id })), remove);
  const whole = div("group", head, ...Object.values(sliders).map((one) => one.element));
  return {
    element: whole,
    kind,
    update(group, active) {
      const names = { environment: group.source, lamp: group.radius < 1 ? "sun" : "lamp", paint: "paint" };
      title.textContent = `${names[kind]} · ${id}`;
      title.title = kind === "environment" ? "Turn and swap this one" : "";
      whole.classList.toggle("active", active);
      if (kind === "environment") pressed(title, active);
      pressed(mute, group.mute);
      pressed(solo, group.solo);
      if (document.activeElement !== tint) tint.value = toHex(group.tint);
      for (const [name, one] of Object.entries(sliders)) one.set(group[name]);
    },
  };
}
