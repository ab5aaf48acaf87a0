// Compare: several methods on the same task and seed, one after the other so that times are fair.

import { get, numbers, set } from "../address.js";
import { ask } from "../api.js";
import { around, Chart, extent } from "../charts/chart.js";
import { legend } from "../charts/legend.js";
import { timesOf } from "../charts/motion.js";
import { rule } from "../charts/layers.js";
import { candidates, rest, section } from "../controls.js";
import { distance, h, short, words } from "../dom.js";
import { reserve, swatch, table } from "../measures.js";
import { machine, method, offer, planned } from "../request.js";
import { offerShare, planFiles } from "../share.js";

export const name = "compare";
export const title = "Compare";
export const parts = ["task", chosen, "machine"];

const BINS = { first: -5, last: 1, each: 4 };
/** Of errors: powers of ten in m, and bins for each. */

const entrants = () => get("compare").split(",").filter(Boolean);
const titleOf = (entrant) => words(entrant.replace("+", "")) + (entrant.endsWith("+") ? ", refined" : "");

function chosen() {
  const tick = (entrant, label) => {
    const box = h("input", {
      type: "checkbox", checked: entrants().includes(entrant), "aria-label": titleOf(entrant),
      onchange: () => {
        const others = entrants().filter((one) => one !== entrant);
        set({ compare: (box.checked ? [...others, entrant] : others).join(",") || "none" });
      },
    });
    return h("td", {}, h("label", {}, box, label));
  };
  return section("Methods",
    h("table", { class: "choices" }, h("tbody", {}, offer.methods.map(({ name: one }) =>
      h("tr", {}, h("th", { scope: "row" }, words(one)), tick(one, "as is"), tick(`${one}+`, "refined"))))),
    candidates(), rest());
}

export function open(view) {
  const { position_unit: unit } = machine();
  const results = reserve(entrants().length);
  const lines = offer.methods.flatMap(() => [0, 1]).map((_, index) => ({ label: "", colour: `series-${1 + (index % 6)}`, dash: index >= 6 ? [6, 3] : undefined, stepped: true }));
  const position = new Chart({ label: "Position of each plan", height: "high", x: { label: "time, s" }, y: { label: unit }, lines: lines.map((line) => ({ ...line, stepped: false })) });
  const errors = new Chart({ label: "Candidates by their error", height: "high", x: { label: `error, ${unit}`, log: true }, y: { label: "candidates" }, lines });
  const words = h("p", { class: "verdict" }, " ");
  view.replaceChildren(words, results, h("div", { class: "split even" }, errors.element, position.element), legend([["target", "target; among the errors, the floor"]]));

  return async (signal) => {
    const found = [];
    const asked = [];
    for (const entrant of entrants().filter((one) => one !== "none")) {
      const body = { ...planned(["states", "candidate_errors"]), method: method(entrant.replace("+", "")) };
      delete body.refine;
      if (entrant.endsWith("+")) body.refine = true;
      asked.push({ path: "plan", body: { ...body, include: ["states"] } });
      found.push({ name: titleOf(entrant), plan: await ask("plan", body, signal) });
      show(found);
    }
    show(found);
    if (found.length) offerShare(asked, planFiles(found));
    return found.length ? `Compared ${found.length} on one task with one seed.` : "Choose methods to compare.";
  };

  function show(found) {
    const best = Math.min(...found.map(({ plan }) => plan.terminal_error));
    results.replaceChildren(table("Measures of each method", ["Method", "Error", "Gap", "Energy", "Stuck", "Time", "Rollouts"],
      found.map(({ name: one, plan }, index) => [
        swatch(1 + (index % 6), one),
        h(plan.terminal_error <= best + 1e-6 ? "strong" : "span", {}, distance(plan.terminal_error, unit)),
        distance(plan.gap, unit), short(plan.control_energy), String(plan.stuck_steps), `${short(plan.timing_ms.total)} ms`, String(plan.cost.rollouts),
      ])));
    if (!found.length) return;
    words.textContent = verdict(found);
    const [{ plan: first }] = found;
    const padded = (rows) => [...rows, ...lines.slice(rows.length).map(() => rows[0].map(() => null))];
    const times = timesOf(first.states.length, first.system.time_step);
    const all = found.map(({ plan }) => plan.states.map((state) => state[0]));
    const target = numbers("target")[0];
    position.show({ x: [0, times.at(-1)], y: around(...extent([...all.flat(), target])), data: [times, ...padded(all)], under: [rule(target, "target")], summary: found.map(({ name: one }) => one).join(", ") });
    const counts = found.map(({ plan }) => histogram(plan.candidate_errors));
    errors.show({
      x: [10 ** BINS.first, 10 ** BINS.last], y: [0, 1.08 * Math.max(...counts.flat())],
      data: [edges(), ...padded(counts)], under: [floor(first)],
      summary: found.map(({ name: one, plan }) => `${one}: median ${distance(median(plan.candidate_errors), unit)}`).join("; "),
    });
  }
}

/** Say which of them to take. */
function verdict(found) {
  const { position_unit: unit } = machine();
  const { floor } = found[0].plan.reachability;
  const exact = found.filter(({ plan }) => plan.gap < 1e-5).sort((a, b) => a.plan.timing_ms.total - b.plan.timing_ms.total)[0];
  const nearest = found.toSorted((a, b) => a.plan.gap - b.plan.gap)[0];
  return [
    floor < 1e-5 ? "" : `The target cannot be reached: no method ends nearer than ${distance(floor, unit)} (the floor).`,
    exact ? `The quickest without a gap: ${exact.name}, in ${short(exact.plan.timing_ms.total)} ms.` : `All have a gap; the least has ${nearest.name}: ${distance(nearest.plan.gap, unit)}.`,
    "As is, a method gives the best of its candidates; refined, it descends from there. cem, icem and mppi need more candidates than the others.",
  ].join(" ").trim();
}

const edges = () => Array.from({ length: (BINS.last - BINS.first) * BINS.each + 1 }, (_, index) => 10 ** (BINS.first + index / BINS.each));

/** Count errors by bins of equal ratio; what lies beyond goes into the outermost. */
function histogram(values) {
  const counts = edges().map(() => 0);
  for (const value of values) {
    const bin = Math.floor((Math.log10(Math.max(value, 1e-300)) - BINS.first) * BINS.each);
    counts[Math.min(Math.max(bin, 0), counts.length - 2)] += 1;
  }
  return counts;
}

const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
const floor = (plan) => (plan.reachability.floor > 10 ** BINS.first ? rule(plan.reachability.floor, "bad", { vertical: true }) : () => {});
