// What is shared with the server and its other clients, and what is this page's own. Values are replaced, never
// written into: so a change is known by its key, and what was before can be had again.

export class Store {
  constructor(values = {}) {
    this.values = values;
    this.listeners = [];
  }

  on(listener) {
    this.listeners.push(listener);
  }

  /** New values instead of all that stood: whoever shows them hears of the welcome that they came with. */
  begin(values) {
    this.values = values;
  }

  /** Changes values; `from`: "here", "there" for what came from the server, or "asked" where this page wanted that. */
  set(changes, from = "here") {
    const before = this.values;
    this.values = { ...before, ...changes };
    for (const listener of this.listeners) listener(Object.keys(changes), from, before);
  }
}

// Changes within this many milliseconds are one step of undo: a drag, not its hundred moves.
const TOGETHER = 600;
const STEPS = 200;
const UNDONE = new Set(["light", "method", "materials", "curves", "editing", "lamps", "background"]);

export class History {
  constructor(shared) {
    this.shared = shared;
    this.past = [];
    this.future = [];
    this.last = -Infinity;
    this.moving = false;
    shared.on((keys, from, before) => this.note(keys, from, before));
  }

  note(keys, from, before) {
    if (from === "there" || this.moving) return;
    const own = keys.filter((key) => UNDONE.has(key));
    if (!own.length) return;
    const now = performance.now();
    const latest = this.past.at(-1);
    // What was asked for by a button is a step of its own.
    const alone = from === "asked";
    const goesOn = now - this.last <= TOGETHER && latest && own.every((key) => key in latest);
    if (alone || !goesOn) this.past.push(pick(before, own));
    this.past.splice(0, this.past.length - STEPS);
    this.future = [];
    this.last = alone ? -Infinity : now;
  }

  undo() {
    this.move(this.past, this.future);
  }

  redo() {
    this.move(this.future, this.past);
  }

  move(from, to) {
    const step = from.pop();
    if (!step) return;
    to.push(pick(this.shared.values, Object.keys(step)));
    this.moving = true;
    this.shared.set(step);
    this.moving = false;
    this.last = -Infinity;
  }
}

export const pick = (values, keys) => Object.fromEntries(keys.map((key) => [key, values[key]]));
