// Temperatures of the last hour, or how fast they change.

import uPlot from "./vendor/uplot.js";
import { celsius, element, signed, write } from "./say.js";

const KEPT_MS = 3600e3;
const OVER_MS = 60e3; // a rate of change is a slope over this stretch, as the daemon judges it
const AFTER_MS = 10e3;

export class Curves {
  constructor(box, list) {
    this.box = box;
    this.list = list;
    this.sensors = [];
    this.rows = []; // ms and °C of each sensor
    this.rates = []; // K/h of each sensor, for each row
    this.drift = false;
    new ResizeObserver(() => this.resize()).observe(box);
  }

  /** The past hour, as the server kept it. */
  begin({ sensors, rows }) {
    this.sensors = sensors;
    this.rows = rows;
    this.rates = rows.map((_, i) => this.slopes(i));
    this.build();
  }

  /** One health message. */
  add(health) {
    const sensors = Object.keys(health.temperatures);
    const ms = health.stamp_ns / 1e6;
    if (sensors.join() !== this.sensors.join()) this.begin({ sensors, rows: [] });
    if (this.rows.length && ms <= this.rows.at(-1)[0]) return;
    this.rows.push([ms, ...Object.values(health.temperatures)]);
    this.rates.push(this.slopes(this.rows.length - 1));
    while (ms - this.rows[0][0] > KEPT_MS) { this.rows.shift(); this.rates.shift(); }
    this.show();
  }

  /** Least-squares slopes over the last minute before row *i*, K/h; null where not known yet. */
  slopes(i) {
    const end = this.rows[i][0];
    let first = i;
    while (first > 0 && end - this.rows[first - 1][0] <= OVER_MS) first--;
    const over = this.rows.slice(first, i + 1);
    return this.sensors.map((_, s) => slope(over.filter((row) => row[s + 1] !== null).map((row) => [row[0], row[s + 1]])));
  }

  toggle() {
    this.drift = !this.drift;
    this.build();
    return this.drift;
  }

  build() {
    this.plot?.destroy();
    this.box.replaceChildren();
    this.list.replaceChildren(...this.sensors.map((name, s) => element("li", name, { class: `s${(s % 9) + 1}` })));
    if (!this.sensors.length) { this.list.replaceChildren(element("li", "This arm has no temperature sensors.")); return; }
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    const axis = { stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { show: false }, font: `${this.letter()}px system-ui` };
    this.holder = element("div");
    this.holder.setAttribute("role", "img");
    this.holder.setAttribute("aria-label", this.drift ? "Change of each temperature in kelvin per hour" : "Temperatures of the last hour in degrees Celsius");
    this.box.append(this.holder);
    this.plot = new uPlot(
      {
        width: Math.max(this.box.clientWidth, 50), height: Math.max(this.box.clientHeight, 50),
        padding: [8, 8, 0, 0], legend: { show: false }, cursor: { drag: { x: false, y: false } },
        series: [{}, ...this.sensors.map((name, s) => ({ label: name, stroke: colour(`c${(s % 9) + 1}`), width: 1.6, points: { show: false } }))],
        axes: [
          { ...axis, size: 30, values: (_, marks) => marks.map((s) => new Date(1000 * s).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false }).replace(/:00$/, "")), space: 70 },
          { ...axis, size: 58, values: (_, marks) => marks.map((mark) => `${mark} ${this.drift ? "K/h" : "°C"}`), space: 32 },
        ],
        scales: { y: { range: (_, low, high) => around(low, high, this.drift ? 4 : 0.4) } },
      },
      this.data(), this.holder,
    );
    this.show();
  }

  data() {
    const values = this.drift ? this.rates : this.rows.map((row) => row.slice(1));
    return [this.rows.map((row) => row[0] / 1000), ...this.sensors.map((_, s) => values.map((row) => row[s]))];
  }

  show() {
    if (!this.plot) return;
    this.plot.setData(this.data());
    const now = this.rows.at(-1);
    const rates = this.rates.at(-1);
    this.sensors.forEach((name, s) => {
      const rate = rates?.[s] ?? null;
      write(this.list.children[s], `${name} ${celsius(now?.[s + 1] ?? null)} °C${rate === null ? "" : ` ${signed(rate, 1)} K/h`}`);
    });
  }

  letter() { return Math.round(0.78 * parseFloat(getComputedStyle(document.documentElement).fontSize)); }

  resize() {
    if (this.plot && this.box.clientWidth) this.plot.setSize({ width: this.box.clientWidth, height: this.box.clientHeight });
  }
}

function slope(pairs) {
  if (pairs.length < 3 || pairs.at(-1)[0] - pairs[0][0] < AFTER_MS) return null;
  const t0 = pairs[0][0];
  let t = 0, y = 0;
  for (const [at, value] of pairs) { t += at - t0; y += value; }
  t /= pairs.length; y /= pairs.length;
  let top = 0, bottom = 0;
  for (const [at, value] of pairs) { top += (at - t0 - t) * (value - y); bottom += (at - t0 - t) ** 2; }
  return (top / bottom) * 3.6e6;
}

/** At least *least* high, so that noise looks like noise. */
function around(low, high, least) {
  if (low === null || !Number.isFinite(low)) return [0, 1];
  const missing = Math.max(0, least - (high - low)) / 2;
  const air = 0.06 * (high - low);
  return [low - missing - air, high + missing + air];
}
