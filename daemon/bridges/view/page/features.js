// Features through the measurements picked, and what two of them are to each other.

import { element, millimetres, write } from "./say.js";

const LEAST = { point: 1, line: 2, plane: 3, circle: 3, sphere: 4, cylinder: 5 };
const MOST = 300; // points of one feature: they go in one address
const $ = (id) => document.getElementById(id);

export class Features {
  constructor() {
    this.all = [];
    this.chosen = [];
    this.made = 0;
    for (const shape of Object.keys(LEAST)) {
      const button = element("button", shape, { type: "button" });
      button.addEventListener("click", () => this.make(shape));
      $("shapes").append(button);
    }
  }

  /** The measurements picked, those with a position. */
  offer(chosen) {
    this.chosen = chosen;
    $("shapes").hidden = chosen.length < 2 || chosen.length > MOST;
    [...$("shapes").children].forEach((button) => { button.disabled = chosen.length < LEAST[button.textContent]; });
  }

  async make(shape) {
    const of = `${shape}:${this.chosen.map((m) => m.id).join(",")}`;
    const told = await ask({ of });
    if (told.error) { write($("related"), told.error); return; }
    this.made += 1;
    const box = element("input", undefined, { type: "checkbox" });
    const label = element("label");
    label.append(box, element("span", `${shape} ${this.made}: ${words(told)}`));
    const item = element("li");
    item.append(label);
    box.addEventListener("change", () => this.relate());
    this.all.push({ name: `${shape} ${this.made}`, of, box });
    $("features").prepend(item);
    this.relate();
  }

  /** Of two that are ticked: distance and angle. */
  async relate() {
    const two = this.all.filter((feature) => feature.box.checked);
    if (two.length !== 2) { write($("related"), this.all.length > 1 ? "tick two features for their distance and angle" : ""); return; }
    const told = await ask({ of: two[0].of, and: two[1].of });
    const said = told.error ? [told.error] : [
      told.distance && `distance ${millimetres(told.distance.value)} mm${expanded(told.distance, "mm", 3)}`,
      told.angle && `angle ${told.angle.value.toFixed(4)}°${expanded(told.angle, "°", 4)}`,
    ];
    write($("related"), `${two[0].name}, ${two[1].name}: ${said.filter(Boolean).join("; ")}`);
  }
}

async function ask(query) {
  try {
    const answer = await fetch(`/feature?${new URLSearchParams(query)}`, { cache: "no-store" });
    const kind = answer.headers.get("Content-Type") ?? "";
    return kind.startsWith("application/json") ? await answer.json() : { error: await answer.text() };
  } catch (error) {
    return { error: String(error) };
  }
}

function words(told) {
  const three = (v, digits) => v.map((x) => x.toFixed(digits)).join(", ");
  const u = told.radius_standard_uncertainty_mm;
  const where = told.point_standard_uncertainty_mm;
  return [
    told.radius_mm !== null && `radius ${millimetres(told.radius_mm)} mm${u === null ? "" : ` (U ${millimetres(2 * u)}, k = 2)`}, of the tip’s centre`,
    `at ${three(told.point_mm, 3)} mm${where ? ` (U ${three(where.map((x) => 2 * x), 3)})` : ""}`,
    told.direction && `along ${three(told.direction, 5)}`,
    `form error ${millimetres(told.form_error_mm)} mm of ${told.n} points`,
  ].filter(Boolean).join("; ");
}

const expanded = (found, unit, digits) =>
  (found.standard_uncertainty === null ? "" : ` (U ${(2 * found.standard_uncertainty).toFixed(digits)} ${unit}, k = 2)`);
