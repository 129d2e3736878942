// Numbers and words as a person reads them.

export const STATES = {
  READY: "Ready", WARMING: "Warming up", INACCURATE: "Inaccurate", DEGRADED: "Degraded",
  NOT_READY: "Not ready", AWAY: "No daemon", LOST: "No connection", NONE: "Connecting",
};

export const millimetres = (value, digits = 3) => (value === null || value === undefined ? "–" : value.toFixed(digits));

/** Digits of a length in mm whose expanded uncertainty *u_mm* is known: two of its own, three at
 *  most. *before*, what was shown until now, stays while it is nearly right: figures that change
 *  their length cannot be read. */
export function resolution(u_mm, before = null) {
  if (!(u_mm > 0)) return before ?? 3;
  const exact = 1 - Math.log10(u_mm); // 3 at 0.01 mm, 1 at 1 mm
  if (before !== null && exact > before - 0.2 && exact < before + 1.2) return before;
  return Math.min(Math.max(Math.floor(exact), 0), 3);
}
export const norm = (v) => Math.hypot(...v);
export const micrometres = (value) => (value === null ? "–" : (1000 * value).toFixed(1000 * Math.abs(value) < 100 ? 1 : 0));
export const celsius = (value) => (value === null || value === undefined ? "–" : value.toFixed(2));

export const clock = (ms) =>
  new Date(ms).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false });

/** `14:03:22` today, else with the day. */
export function instant(ms) {
  const then = new Date(ms);
  const today = then.toDateString() === new Date().toDateString();
  return today ? clock(ms) : `${then.toLocaleDateString("sv-SE")} ${clock(ms)}`;
}

export function duration(s) {
  if (s < 90) return `${Math.round(s)} s`;
  if (s < 5400) return `${Math.round(s / 60)} min`;
  if (s < 172800) return `${(s / 3600).toFixed(1)} h`;
  return `${Math.round(s / 86400)} days`;
}

export const signed = (value, digits) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);

/** An element with its text; text is never taken for markup. */
export function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

/** Only what has changed: the browser lays out nothing anew for the same words. */
export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
