// Measurements and events, the newest on top.

import { clock, element, instant, micrometres, millimetres, norm, resolution, write } from "./say.js";

const MOST = 1000;

export class Measurements {
  /** `warnings(bits)`: titles of the flags that say something against a measurement. */
  constructor(body, changed, warnings) {
    this.body = body;
    this.changed = changed;
    this.warnings = warnings;
    this.clear();
    body.addEventListener("click", (event) => {
      const row = event.target.closest("tr");
      if (row) this.pick(row.dataset.id, event.shiftKey || event.ctrlKey || event.metaKey);
    });
  }

  clear() {
    this.all = [];
    this.picked = [];
    this.body.replaceChildren();
  }

  add(measurement, fresh) {
    this.all.push(measurement);
    const m = measurement;
    const row = element("tr", undefined, { "data-id": m.id, "aria-selected": "false" });
    const deviation = m.sd ? micrometres(norm(m.sd)) : "–";
    const expanded = m.u ? micrometres(2 * norm(m.u)) : "–";
    row.append(element("td", String(this.all.length)));
    const digits = resolution(m.u ? 2 * Math.max(...m.u) : 0);
    for (const i of [0, 1, 2]) row.append(element("td", m.p ? millimetres(m.p[i], digits) : "–"));
    row.append(element("td", deviation), element("td", expanded), element("td", clock(m.ms), { class: "wide" }));
    if (!m.p || this.warnings(m.f)) row.classList.add("doubt");
    if (fresh) row.classList.add("fresh");
    this.body.prepend(row);
    if (this.body.children.length > MOST) this.body.lastChild.remove();
    this.changed(false);
  }

  get last() { return this.all.findLast((m) => m.p) ?? null; }
  get chosen() { return this.picked.map((id) => this.all.find((m) => m.id === id)).filter(Boolean); }
  number(m) { return this.all.indexOf(m) + 1; }

  pick(id, more) {
    const has = this.picked.includes(id);
    if (more) this.picked = has ? this.picked.filter((other) => other !== id) : [...this.picked, id];
    else this.picked = has && this.picked.length === 1 ? [] : [id];
    this.mark();
  }

  everything() { this.picked = this.all.map((m) => m.id); this.mark(); }

  none() { this.picked = []; this.mark(); }

  /** The one before (−1) or after (+1) the one picked last. */
  step(by, more) {
    if (!this.all.length) return;
    const at = this.all.findIndex((m) => m.id === this.picked.at(-1));
    const next = at < 0 ? this.all.length - 1 : Math.min(Math.max(at + by, 0), this.all.length - 1);
    const id = this.all[next].id;
    this.picked = more ? [...new Set([...this.picked, id])] : [id];
    this.mark();
    this.body.querySelector(`[data-id="${id}"]`)?.scrollIntoView({ block: "nearest" });
  }

  mark() {
    for (const row of this.body.children) row.setAttribute("aria-selected", String(this.picked.includes(row.dataset.id)));
    this.changed(true);
  }

  /** What there is to say of those picked. */
  words() {
    const chosen = this.chosen;
    if (chosen.length === 1) {
      const [m] = chosen;
      const deviations = m.sd ? `s = ${m.sd.map((x) => micrometres(x)).join(", ")} µm in x, y, z of ${m.n} readings over ${m.s.toFixed(2)} s` : "a single reading";
      const doubts = this.warnings(m.f);
      return `No. ${this.number(m)}: ${deviations}; tip ${m.tip ?? "of the calibration"}${doubts ? `; ${doubts}` : ""}`;
    }
    const placed = chosen.filter((m) => m.p);
    if (placed.length === 2) {
      const d = placed[1].p.map((x, i) => x - placed[0].p[i]);
      return `No. ${this.number(placed[0])} to ${this.number(placed[1])}: ${millimetres(norm(d))} mm (dx ${millimetres(d[0])}, dy ${millimetres(d[1])}, dz ${millimetres(d[2])})`;
    }
    return chosen.length ? `${chosen.length} picked` : "";
  }
}

export class Events {
  constructor(list, none) { this.list = list; this.none = none; this.clear(); }

  clear() { this.list.replaceChildren(); this.none.hidden = false; this.top = null; }

  /** One that says what the one before it said stands with that: how often, and since when. */
  add(event) {
    if (this.top?.text === event.text && this.top.severity === event.severity) {
      this.top.times += 1;
      const item = this.list.firstChild;
      write(item.querySelector("time"), instant(event.ms));
      item.querySelector("time").dateTime = new Date(event.ms).toISOString();
      write(item.querySelector("small"), ` ${this.top.times} times since ${instant(this.top.ms)}`);
      return;
    }
    this.top = { text: event.text, severity: event.severity, ms: event.ms, times: 1 };
    const item = element("li", undefined, { "data-severity": event.severity });
    item.append(element("time", instant(event.ms), { datetime: new Date(event.ms).toISOString() }), element("span", event.text));
    item.lastChild.append(element("small", ""));
    this.list.prepend(item);
    if (this.list.children.length > 300) this.list.lastChild.remove();
    this.none.hidden = true;
  }
}

