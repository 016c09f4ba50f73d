// The timeline: it records the light as it moves, and plays by sending it again. With nothing recorded, it turns the
// environment once round.

import { $, clamp, pressed, slider } from "./dom.js";
import { about, product, slerp, wrapped } from "./geometry.js";
import { activeEnvironment } from "./light.js";

const MOST = 5000;
const LENGTHS = { low: 0.5, high: 120, scale: "log", unit: "s" };

export function mountTimeline(app) {
  const clip = { seconds: 8, hold: 0, loop: true, ease: false, samples: [] };
  let at = 0;
  let started = null;
  let recording = null;
  let base = null;

  const scrub = slider("scrub", "Time", { low: 0, high: 100, step: 0.1, unit: "%" }, (value) => go(value / 100));
  const length = slider("length", "Length", LENGTHS, (value) => (clip.seconds = value));
  const hold = slider("hold", "Hold", { low: 0, high: 10, step: 0.1, unit: "s" }, (value) => (clip.hold = value));
  $("scrub-slot").append(scrub.element);
  $("length-slot").append(length.element);
  $("hold-slot").append(hold.element);

  $("record").onclick = () => (recording ? stopRecording() : record());
  $("play").onclick = () => (started === null ? play() : stop());
  for (const name of ["loop", "ease"]) $(name).onclick = () => ((clip[name] = !clip[name]), show());
  app.on("welcome", () => {
    $("timeline").hidden = !app.shared.values.light;
    show();
  });
  app.shared.on((keys) => {
    if (recording && keys.includes("light") && recording.samples.length < MOST) take();
  });

  function take() {
    recording.samples.push({ seconds: (performance.now() - recording.since) / 1000, light: app.shared.values.light });
  }

  function record() {
    stop();
    recording = { since: performance.now(), samples: [] };
    take();
    show();
  }

  function stopRecording() {
    take();
    clip.seconds = Math.max(0.5, recording.samples.at(-1).seconds);
    clip.samples = recording.samples;
    recording = null;
    at = 0;
    show();
  }

  function play() {
    if (recording) stopRecording();
    if (at >= 1) at = 0;
    base = app.shared.values.light;
    started = performance.now() - at * clip.seconds * 1000;
    show();
    requestAnimationFrame(advance);
  }

  function stop() {
    started = null;
    base = null;
    show();
  }

  function advance(now) {
    if (started === null) return;
    const seconds = (now - started) / 1000;
    if (seconds > clip.seconds + clip.hold) {
      if (!clip.loop) {
        go(1);
        return stop();
      }
      started = now;
    }
    go(clamp(seconds / clip.seconds, 0, 1));
    requestAnimationFrame(advance);
  }

  function go(share) {
    at = share;
    scrub.set(100 * share);
    const light = lightAt(clip.ease ? share * share * (3 - 2 * share) : share);
    if (light) app.shared.set({ light });
  }

  function lightAt(share) {
    if (!clip.samples.length) return turnedRound(share);
    const seconds = share * clip.samples.at(-1).seconds;
    const next = clip.samples.findIndex((sample) => sample.seconds >= seconds);
    if (next <= 0) return clip.samples[0].light;
    const [p, q] = [clip.samples[next - 1], clip.samples[next]];
    return mixed(p.light, q.light, (seconds - p.seconds) / Math.max(1e-9, q.seconds - p.seconds));
  }

  function turnedRound(share) {
    base ??= app.shared.values.light;
    const own = activeEnvironment(app);
    if (!own) return null;
    const turned = (group) => ({ ...group, turn: product(about(360 * share), group.turn) });
    return { ...base, groups: base.groups.map((group) => (group.id === own.id ? turned(group) : group)) };
  }

  function show() {
    scrub.set(100 * at);
    length.set(clip.seconds);
    hold.set(clip.hold);
    pressed($("record"), recording !== null);
    pressed($("play"), started !== null);
    $("play").textContent = started === null ? "▶ Play" : "■ Stop";
    for (const name of ["loop", "ease"]) pressed($(name), clip[name]);
    const held = clip.samples.length ? `${clip.samples.length} samples` : "one turn";
    $("clip").textContent = recording ? "recording…" : held;
  }

  app.clip = () => clip;
  app.takeClip = (saved) => {
    stop();
    Object.assign(clip, saved);
    show();
  };
}

/** The light between two samples: what both have moves, the rest jumps. */
function mixed(from, to, t) {
  const groups = to.groups.map((group) => {
    const same = (one) => ["id", "kind", "source"].every((key) => one[key] === group[key]);
    const before = from.groups.find(same);
    return before ? between(before, group, t) : group;
  });
  const fades = from.blend?.source === to.blend?.source && to.blend;
  return { groups, blend: fades ? { ...to.blend, t: line(from.blend.t, to.blend.t, t) } : to.blend };
}

const line = (a, b, t) => a + (b - a) * t;

function between(from, to, t) {
  const moved = { ...to };
  for (const name of ["gain", "elevation", "radius"]) if (name in to) moved[name] = line(from[name], to[name], t);
  // The shorter way round.
  if ("azimuth" in to) moved.azimuth = wrapped(from.azimuth + (wrapped(to.azimuth - from.azimuth + 180) - 180) * t);
  if (to.turn) moved.turn = slerp(from.turn, to.turn, t);
  moved.tint = to.tint.map((value, k) => line(from.tint[k], value, t));
  return moved;
}
