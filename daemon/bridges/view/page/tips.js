// How the tips were calibrated so far, the newest first, and the last of each to be put in force.

import { element, instant, write } from "./say.js";

const $ = (id) => document.getElementById(id);
const GOOD = "good";

export class Tips {
  /** *command* asks the daemon for something. */
  constructor(command) {
    this.command = command;
    this.may = false;
    $("tip-history").addEventListener("toggle", () => this.show());
  }

  /** Whether the page may put a tip in force. */
  allow(may) {
    if (may === this.may) return;
    this.may = may;
    this.show();
  }

  async show() {
    if (!$("tip-history").open) return;
    const answer = await fetch("/tips", { cache: "no-store" });
    if (!answer.ok) return;
    const all = (await answer.json()).reverse();
    const seen = new Set();
    $("tip-rows").replaceChildren(...all.map((tip) => {
      const last = !seen.has(tip.name);
      seen.add(tip.name);
      return this.row(tip, last);
    }));
    $("no-tips").hidden = all.length > 0;
  }

  row(tip, last) {
    const name = tip.name === "-" ? "the calibration’s own" : tip.name;
    const u = 2 * Math.max(...tip.standard_uncertainty_mm);
    const row = element("tr", "", { title: tip.verdict });
    const doing = element("td", "");
    if (last && this.may && tip.verdict === GOOD && tip.name !== "-") {
      const button = element("button", "Put in force", { type: "button", "aria-label": `Put in force: ${name}` });
      button.addEventListener("click", () => this.command("/command/keep_tip", { name: tip.name }));
      doing.append(button);
    }
    const moved = tip.moved_mm === undefined ? "" : tip.moved_mm.toFixed(3);
    row.append(
      element("th", name, { scope: "row" }),
      element("td", instant(Date.parse(tip.measured))),
      element("td", tip.offset_mm.map((x) => x.toFixed(3)).join(", ")),
      element("td", u.toFixed(3)),
      element("td", tip.form_error_mm.toFixed(3)),
      element("td", moved),
      element("td", tip.verdict.split(":")[0]),
      doing,
    );
    return row;
  }
}
