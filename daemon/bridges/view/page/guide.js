// Guided measuring: what to touch next, how far it is, what was taken or refused, what is covered.

import { element, millimetres, norm, write } from "./say.js";

const KINDS = {
  seats: ["Seats", "A ball in one or more seats, again and again in other postures."],
  artefact: ["Artefact", "The balls of an artefact, in several placements: calibrates the arm."],
  verify: ["Verification", "The points of ISO 10360-12 and ASME B89.4.22: a verdict at the end."],
  poses: ["Poses", "The poses of a table that armd design wrote."],
  tip: ["Tip", "A seat, or a sphere of known diameter: the tip’s offset."],
  interim: ["Interim check", "A short one: whether the arm is still what it was."],
  repeatability: ["Repeatability", "One seat, visited many times over hours: scatter and drift."],
};
const $ = (id) => document.getElementById(id);

/** One kind of measurement to choose. */
function card(kind) {
  const [title, words] = KINDS[kind] ?? [kind, ""];
  const made = element("label", undefined, { class: "card" });
  made.append(element("input", undefined, { type: "radio", name: "kind", value: kind }), element("strong", title), element("span", words));
  return made;
}

/** To read in a tab of their own; the page goes on. */
const links = (files) => files.map(({ name, path }) => element("a", name, { href: path, target: "_blank", rel: "noopener" }));

export class Guide {
  /** *post* sends a deed; *scene* shows where to go. */
  constructor(post, scene) {
    this.post = post;
    this.scene = scene;
    this.said = { phase: "none", state: null };
    this.choices = null;
    for (const button of document.querySelectorAll("[data-deed]"))
      button.addEventListener("click", () => this.do(button.dataset.deed));
    $("begin-open").addEventListener("click", () => this.open());
    $("begin-close").addEventListener("click", () => $("begin").close());
    $("kinds").addEventListener("change", () => this.showKind());
    $("begin-form").addEventListener("submit", (event) => { event.preventDefault(); this.begin(); });
  }

  allow(may) { $("begin-open").hidden = !may; this.may = may; }

  async do(deed, content = {}) {
    const said = await this.post(`/guided/${deed}`, content);
    if (said.error) this.outcome({ event: "failed", text: said.error });
  }

  async open() {
    if (!this.may) return;
    const answer = await fetch("/guided", { cache: "no-store" });
    if (!answer.ok) return;
    const there = await answer.json();
    const options = (names, none) => [...(none ? [element("option", none, { value: "" })] : []), ...names.map((name) => element("option", name, { value: name }))];
    this.names = new Set(there.sessions.map(({ name }) => name));
    $("kinds").replaceChildren(...there.kinds.map(card));
    $("kinds").querySelector("input").checked = true;
    $("artefacts").replaceChildren(...options(there.artefacts, there.artefacts.length ? "none" : `none in ${there.folder}`));
    $("poses").replaceChildren(...options(there.poses, there.poses.length ? undefined : `none in ${there.folder}`));
    $("limits").replaceChildren(...options(there.artefacts, "none"));
    $("going-on").hidden = !there.sessions.length;
    $("sessions").replaceChildren(...there.sessions.map(({ name, results }) => {
      const line = element("li", "");
      const button = element("button", name, { type: "button" });
      button.addEventListener("click", () => this.start("resume", { name }));
      line.append(button, ...links(results.filter((file) => file.name.endsWith(".html"))));
      return line;
    }));
    write($("begin-said"), "");
    this.showKind();
    $("begin").showModal();
  }

  showKind() {
    const kind = $("kinds").querySelector("input:checked").value;
    const name = $("begin-form").elements.name;
    if (name.value === (this.proposed ?? "")) this.proposed = name.value = this.unused(kind);
    for (const label of document.querySelectorAll("#begin [data-for]"))
      label.hidden = !label.dataset.for.split(" ").includes(kind);
  }

  /** A session's name that is not taken: kind, day, and a number from the second on. */
  unused(kind) {
    const day = `${kind} ${new Date().toLocaleDateString("sv-SE")}`;
    for (let number = 1; ; number += 1) {
      const name = number === 1 ? day : `${day} ${number}`;
      if (!this.names.has(name)) return name;
    }
  }

  begin() {
    const content = {};
    for (const field of $("begin-form").elements) {
      if (field.type === "radio" && !field.checked) continue;
      if (!field.name || field.closest("label")?.hidden || field.value === "") continue;
      content[field.name] = field.type === "number" ? Number(field.value) : field.value;
    }
    return this.start("begin", content);
  }

  async start(how, content) {
    write($("begin-said"), "…");
    const { artefact_c, ...wishes } = content;
    const said = await this.post(`/guided/${how}`, wishes);
    write($("begin-said"), said.error ?? "");
    if (said.error) return;
    if (artefact_c !== undefined) await this.do("artefact", { artefact_c });
    $("begin").close();
  }

  /** What the server tells of it. */
  show(said) {
    this.said = said;
    const { phase, state, outcome, results, files, so_far } = said;
    const on = phase !== "none" && state !== null;
    document.querySelector("main").classList.toggle("guided", on);
    $("guide").hidden = !on;
    if (!on) { this.scene?.target(null, null); this.scene?.ghost(null); return; }
    write($("guide-title"), `${state.kind}: ${state.session.split("/").at(-1)}`);
    $("guide-title").title = state.session;
    write($("progress"), `${state.done} of ${state.wanted}${state.left_out ? `, ${state.left_out} left out` : ""}`);
    $("bar").value = state.wanted ? (state.done + state.left_out) / state.wanted : 0;
    const { next } = state;
    const words = { measuring: "everything is measured", ending: "being worked out…", ended: "done" }[phase];
    write($("next-target"), next && phase === "measuring" ? next.target : words);
    $("next-word").hidden = !next || phase !== "measuring";
    if ($("next-word").hidden) { this.scene?.target(null, null); write($("away"), ""); }
    write($("next-where"), next && phase === "measuring" ? `in ${next.placement}${next.place ? `: ${next.place}` : ""}` : "");
    write($("next-how"), next && phase === "measuring" ? [next.how, next.why].filter(Boolean).join("; ") : "");
    this.scene?.ghost(phase === "measuring" ? (next?.posture_deg ?? null) : null);
    this.outcome(outcome);
    const estimate = [state.estimate?.text, so_far && `as armd calibrate has it: ${so_far}`];
    write($("estimate"), estimate.filter(Boolean).join(" · "));
    this.cover(state);
    const over = phase === "ending" || phase === "ended"; // then what the commands say matters
    $("coverage").hidden = over;
    $("ranges").hidden = over;
    const read = element("p", "", { class: "files" });
    read.append(...links(files));
    $("results").replaceChildren(read, ...results.flatMap((done) => [
      element("h3", `${done.command}: ${done.code === 0 ? "done" : done.code === 1 ? "the answer is no" : "failed"}`),
      element("pre", [done.output, done.error].filter(Boolean).join("\n")),
    ]));
    for (const button of document.querySelectorAll("[data-deed]"))
      button.hidden = (button.dataset.deed === "close") !== (phase === "ended") || phase === "ending";
  }

  outcome(told) {
    $("outcome").dataset.event = told?.event ?? "";
    const before = { reading: `taken (${told?.number}): `, refused: "refused: ", failed: "" }[told?.event] ?? "";
    write($("outcome"), told ? before + told.text : "press the button, at rest");
  }

  /** Targets by placement, then joints and temperatures. */
  cover({ coverage, next }) {
    const placements = [...new Set(coverage.targets.map((t) => t.placement))];
    const targets = [...new Set(coverage.targets.map((t) => t.target))];
    const cells = new Map(coverage.targets.map((t) => [`${t.placement}\n${t.target}`, t]));
    const across = placements.length <= targets.length ? placements : targets;
    const down = across === placements ? targets : placements;
    const head = element("tr");
    head.append(element("th", ""), ...across.map((name) => element("th", name, { scope: "col" })));
    $("coverage").tHead.replaceChildren(head);
    $("coverage").tBodies[0].replaceChildren(...down.map((name) => {
      const row = element("tr");
      row.append(element("th", name, { scope: "row" }));
      for (const other of across) {
        const [placement, target] = across === placements ? [other, name] : [name, other];
        const cell = cells.get(`${placement}\n${target}`);
        const made = element("td", cell ? `${cell.done}/${cell.wanted}` : "");
        if (cell && cell.done >= cell.wanted) made.className = "full";
        if (next && next.placement === placement && next.target === target) made.className = "now";
        row.append(made);
      }
      return row;
    }));
    const range = (low, high, unit) => (low === null ? "–" : `${low.toFixed(unit === "°" ? 0 : 1)} to ${high.toFixed(unit === "°" ? 0 : 1)} ${unit}`);
    $("ranges").replaceChildren(
      ...coverage.joints.map((j) => element("li", `joint ${j.joint}: ${range(j.low_deg, j.high_deg, "°")}, ${(100 * j.share).toFixed(0)} %`)),
      ...coverage.temperatures.map((t) => element("li", `${t.sensor}: ${range(t.low_c, t.high_c, "°C")}`)),
    );
  }

  /** With every new point, mm (null: none). */
  follow(tip) {
    const next = this.said.phase === "measuring" ? this.said.state?.next : null;
    if (!next) { write($("away"), ""); return; }
    const at = next.position_mm;
    this.scene?.target(at, tip);
    const away = at && tip ? norm(at.map((x, i) => x - tip[i])) : null;
    write($("away"), away === null ? "" : away < 10 ? `${millimetres(away)} mm` : `${away.toFixed(0)} mm away`);
    $("away").classList.toggle("near", away !== null && away <= next.near_mm);
  }

  /** Keys, while it measures. */
  key(name) {
    const deed = { x: "delete", a: "again" }[name];
    if (deed && this.said.phase === "measuring") this.do(deed);
  }
}
