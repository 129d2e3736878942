// The page: what the server tells, put where a person looks for it.

import { Curves } from "./curves.js";
import { Features } from "./features.js";
import { Guide } from "./guide.js";
import { Events, Measurements } from "./lists.js";
import { STATES, celsius, duration, element, instant, micrometres, millimetres, norm, resolution, write } from "./say.js";
import { ArmScene } from "./scene.js";
import * as sound from "./sound.js";
import { listen } from "./stream.js";
import { Tips } from "./tips.js";

const OLD_MS = 700; // a point older than this is no reading any more
const $ = (id) => document.getElementById(id);
const page = { arm: null, health: null, link: null, hello: null, live: null, lastMs: 0, connected: false, quiet: true, digits: null };

// --- colours ----------------------------------------------------------------------------------

function theme(name) {
  document.documentElement.dataset.theme = name;
  write($("theme"), name === "dark" ? "Light" : "Dark");
  scene?.recolour();
  curves?.build();
}

function turnTheme() {
  const name = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  sound.keep("theme", name);
  theme(name);
}

const curves = new Curves($("chart"), $("sensors"));
let scene = null;
theme(sound.recall("theme") ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"));
try {
  scene = new ArmScene($("canvas"));
} catch (error) {
  console.warn(error);
  $("canvas").hidden = true;
  $("no-scene").hidden = false;
}

const guide = new Guide(post, scene);
const tips = new Tips(command);

// --- lists ------------------------------------------------------------------------------------

let features = null;
const measurements = new Measurements($("rows"), () => {
  const placed = measurements.all.filter((m) => m.p);
  scene?.points(placed.map((m) => m.p), measurements.chosen.filter((m) => m.p).map((m) => m.p));
  write($("picked"), measurements.words());
  features?.offer(measurements.chosen.filter((m) => m.p));
  write($("count"), measurements.all.length ? String(measurements.all.length) : "");
  showNone();
  showDistance();
}, flagWarnings);
features = new Features();
const events = new Events($("events"), $("none-happened"));

// --- what the server tells --------------------------------------------------------------------

listen(
  {
    hello(hello) {
      if (page.hello && page.hello.version !== hello.version) { location.reload(); return; }
      page.hello = hello;
      page.connected = true;
      page.quiet = true; // the past makes no sound
      measurements.clear();
      events.clear();
      fetch("/temperatures").then((answer) => answer.json()).then((past) => curves.begin(past)).catch(() => {});
      setTimeout(() => { page.quiet = false; }, 1500);
      showState();
      showMeanings();
      showWriting();
    },
    link(link) { page.link = link; showState(); },
    arm(arm) { page.arm = arm; showArm(); },
    health(health) { page.health = health; curves.add(health); showHealth(); showState(); },
    live(live) { page.live = live; page.lastMs = performance.now(); showLive(); },
    guided(said) {
      guide.show(said);
      if (!page.quiet && said.outcome?.event === "refused") sound.play(false);
    },
    event(event) { events.add(event); },
    measurement(measurement) {
      measurements.add(measurement, !page.quiet);
      if (!page.quiet) sound.play(measurement.p !== null);
    },
  },
  () => { page.connected = false; showState(); },
);

// --- showing ----------------------------------------------------------------------------------

function showState() {
  let state = "NONE";
  let reason = "";
  if (!page.connected) { state = page.hello ? "LOST" : "NONE"; reason = page.hello ? "armd view does not answer; trying again" : ""; }
  else if (!page.link?.here) { state = "AWAY"; reason = page.link?.text ?? ""; }
  else if (page.health) { state = page.health.state; reason = page.link.text || page.health.reason; }
  $("state").dataset.state = state === "LOST" ? "AWAY" : state;
  write($("state-word"), STATES[state] ?? state);
  write($("state-reason"), reason);
  write($("serial"), page.link?.serial ?? "");
  document.title = page.link?.serial ? `${page.link.serial} · ${STATES[state] ?? state}` : "armd";
  showAge();
}

function showLive() {
  const { p, u, c, q, seq, f } = page.live;
  const figures = $("figures");
  page.digits = resolution(u ? 2 * Math.max(...u) : 0, page.digits);
  ["x", "y", "z"].forEach((axis, i) => {
    write($(axis), millimetres(p?.[i], page.digits));
    write($(`u${axis}`), u ? `± ${(2 * u[i]).toFixed(page.digits)}` : "");
  });
  figures.dataset.seq = seq;
  write($("correction"), c ? `${micrometres(norm(c))} µm` : "–");
  showFlags(f);
  showDistance();
  guide.follow(p);
  showAge();
  if (scene) {
    scene.follow(p);
    if (q) scene.pose(q, p);
  }
}

let flagsShown = -1;
function showFlags(bits) {
  if (bits === flagsShown || !page.hello) return;
  flagsShown = bits;
  const standing = Object.entries(page.hello.flags)
    .filter(([bit]) => (bits >>> Number(bit)) & 1)
    .map(([, flag]) => element("li", flag.title, { "data-severity": flag.severity, title: flag.text, "data-flag": flag.name }));
  $("flags").replaceChildren(...(standing.length ? standing : [element("li", "no flags", { class: "none" })]));
}

function flagWarnings(bits) {
  return Object.entries(page.hello?.flags ?? {}).filter(([bit, flag]) => (bits >>> Number(bit)) & 1 && flag.severity !== "info").map(([, flag]) => flag.title.toLowerCase()).join(", ");
}

/** A figure that nobody renews must not look like one that is. */
function showAge() {
  const age = performance.now() - page.lastMs;
  const old = !page.live || age > OLD_MS;
  $("readout").classList.toggle("old", old);
  const text = !page.live ? "no point yet" : `no point for ${(age / 1000).toFixed(age < 10000 ? 1 : 0)} s: these are the last figures`;
  $("held").hidden = !old;
  if (old && !(page.connected && page.link?.here)) { write($("rate"), "–"); write($("latency"), "–"); }
  if (old) write($("held"), text);
}
setInterval(showAge, 250);

function showDistance() {
  const from = measurements.last;
  const to = page.live?.p;
  write($("distance"), from && to ? `${millimetres(norm(to.map((x, i) => x - from.p[i])), page.digits)} mm` : "–");
}

function showHealth() {
  const { rates, drops, latency, uptime_s, stamp_ns, interim } = page.health;
  const lost = drops.lost ?? 0;
  write($("rate"), `${rates.points_hz.toFixed(0)} points/s, ${lost} lost`);
  write($("latency"), latency.p99 === undefined ? "–" : `99 % within ${latency.p99.toFixed(1)} ms`);
  $("latency").title = "from the latch of the angles to the point's publication";
  $("interim-row").hidden = !interim;
  write($("interim"), interim ? lastCheck(interim) : "–");
  write($("daemon"), `armd ${page.arm?.armd ?? ""}, up for ${duration(uptime_s)}`);
  $("daemon").title = `since ${instant(stamp_ns / 1e6 - 1000 * uptime_s)}`;
}

/** What health says of the history of interim checks. */
function lastCheck({ check, age_h, state, reason }) {
  if (!check) return reason || "none known";
  const age = age_h < 0 ? "dated after now" : `${duration(3600 * age_h)} ago`;
  return `${check}, ${age}: ${state === "changed" ? "the arm has changed" : "in control"}`;
}

function showNone() {
  const none = page.arm?.trigger === null;
  $("no-trigger").hidden = !none;
  $("none-measured").hidden = none || measurements.all.length > 0;
}

function showMeanings() {
  flagsShown = -1;
  $("meanings").replaceChildren(...Object.values(page.hello.flags).map((flag) => {
    const row = element("div");
    row.append(element("dt", flag.title, { "data-severity": flag.severity }), element("dd", flag.text));
    return row;
  }));
}

function showArm() {
  const { arm } = page;
  scene?.build(arm.geometry);
  page.digits = null;
  showNone();
  flagsShown = -1;
  if (page.live) showLive();
  const with_ = (node, text, small) => node.replaceChildren(text, element("small", small));
  const offset = arm.geometry.tip.map((x) => x.toFixed(3)).join(", ");
  with_($("tip"), `${arm.tip ?? "the calibration’s own"}, radius ${arm.geometry.radius_mm.toFixed(3)} mm`, `offset ${offset} mm; since ${instant(arm.since_ms.tip)}`);
  const c = arm.calibration;
  if (c) {
    with_($("calibration"), `${c.file} · ${c.sha256.slice(0, 8)}`, `identified ${instant(Date.parse(c.created))}, ${c.terms} terms; in force since ${instant(arm.since_ms.calibration)}`);
    const ranges = Object.values(c.range_c);
    const low = Math.min(...ranges.map((r) => r[0]));
    const high = Math.max(...ranges.map((r) => r[1]));
    write($("range"), ranges.length ? `${celsius(low)} to ${celsius(high)} °C` : `the reference temperature, ${celsius(arm.reference_c)} °C`);
  } else {
    with_($("calibration"), "none", "nominal geometry, as drawn");
    write($("range"), "–");
  }
  $("tips").replaceChildren(element("option", "the calibration’s own tip", { value: "" }), ...arm.tips.map((name) => element("option", name, { value: name })));
  $("tips").value = arm.tip ?? "";
  if (page.health) showHealth();
  showWriting();
  tips.show();
}

// --- doing ------------------------------------------------------------------------------------

function showWriting() {
  $("writing").hidden = !(page.hello?.writing && page.arm?.commands);
  guide.allow(page.hello?.writing ?? false);
  tips.allow(!$("writing").hidden);
}

/** Asks for something to be done; what was done, or why not. */
async function post(path, content) {
  try {
    const answer = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) });
    const kind = answer.headers.get("Content-Type") ?? "";
    return kind.startsWith("application/json") ? await answer.json() : { error: await answer.text() };
  } catch (error) {
    return { error: String(error) };
  }
}

async function command(path, content) {
  write($("answer"), "…");
  const said = await post(path, content);
  write($("answer"), said.done ?? said.error ?? "done");
}

$("writing").addEventListener("submit", (event) => { event.preventDefault(); command("/command/tip", { name: $("tips").value }); });
$("reload").addEventListener("click", () => command("/command/reload", {}));

function showSound() {
  $("sound").setAttribute("aria-pressed", String(sound.isOn()));
  write($("sound"), sound.isOn() ? "Sound on" : "Sound off");
}
const turnSound = () => { sound.toggle(); showSound(); };
showSound();

function turnCurves() {
  const drift = curves.toggle();
  $("show-c").setAttribute("aria-pressed", String(!drift));
  $("show-drift").setAttribute("aria-pressed", String(drift));
}

$("sound").addEventListener("click", turnSound);
$("theme").addEventListener("click", turnTheme);
$("help-open").addEventListener("click", () => $("help").showModal());
for (const [id, drift] of [["show-c", false], ["show-drift", true]])
  $(id).addEventListener("click", () => { if (curves.drift !== drift) turnCurves(); });
for (const button of document.querySelectorAll("[data-view]"))
  button.addEventListener("click", () => scene?.view(button.dataset.view));

const KEYS = {
  0: () => scene?.view("iso"), 1: () => scene?.view("front"), 2: () => scene?.view("side"), 3: () => scene?.view("top"),
  s: turnSound, t: turnTheme, d: turnCurves, e: () => $("csv").click(), "?": () => $("help").showModal(),
  j: (event) => measurements.step(-1, event.shiftKey), k: (event) => measurements.step(1, event.shiftKey),
  m: () => guide.open(), x: () => guide.key("x"), a: () => guide.key("a"),
  A: () => measurements.everything(),
  J: () => measurements.step(-1, true), K: () => measurements.step(1, true), Escape: () => measurements.none(),
};
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || $("help").open || $("begin").open) return;
  if (event.target.closest("input:not([type=checkbox]), select, textarea")) return;
  KEYS[event.key]?.(event);
});

export { page, scene };
