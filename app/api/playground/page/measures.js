// Tables of measures: what a plan came to, in rows or beside others.

import { waysOut } from "./controls.js";
import { distance, h, short } from "./dom.js";
import { machine } from "./request.js";

/** A list of terms and values that keeps its place while it waits. */
export const measures = (entries) => h("dl", { class: "measures" }, entries.map(([term, value, title]) => h("div", { title }, h("dt", {}, term), h("dd", {}, value))));

export function ofPlan(plan) {
  const { position_unit: unit } = machine();
  return [
    ["Error", distance(plan.terminal_error, unit), "Distance of the last state from the target, position and velocity as one"],
    ["Floor", distance(plan.reachability.floor, unit), "The least error that any control sequence can have"],
    ["Gap", distance(plan.gap, unit), "Error less the floor: what the method is to blame for"],
    ["Energy", short(plan.control_energy), "Sum of the squared controls"],
    ["Stuck steps", String(plan.stuck_steps), "Steps at rest, too weak a push, off the target"],
    ["Rollouts", String(plan.cost.rollouts), "Control sequences that were simulated"],
    ["Time", `${short(plan.timing_ms.total)} ms`, "In the service"],
  ];
}

/** A table; cells are text or elements. */
export const table = (caption, head, rows) => h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": caption },
  h("table", {},
    h("caption", {}, caption),
    h("thead", {}, h("tr", {}, head.map((cell) => h("th", { scope: "col" }, cell)))),
    h("tbody", {}, rows.map((cells) => h("tr", {}, cells.map((cell, index) => h(index ? "td" : "th", index ? {} : { scope: "row" }, cell)))))));

/** A place for a table, as high as its rows will be. */
export function reserve(rows) {
  const place = h("div", { class: "results" });
  place.style.minHeight = `${64 + 30 * rows}px`;
  return place;
}

/** The colour of a line beside its name. */
export const swatch = (index, name) => h("span", {}, h("i", { class: `swatch series-${index}` }), name);

/** Say what came of a plan, for somebody who sees it for the first time. */
export function verdict(plan) {
  const { position_unit: unit } = machine();
  const { reachability: reach } = plan;
  const { length } = plan.controls;
  const seconds = (steps) => short(steps * plan.system.time_step);
  if (!reach.reachable) {
    const [position, velocity] = reach.nearest_state;
    const nearest = `${short(position)} ${unit} at ${short(velocity)} ${unit}/s, an error of ${distance(reach.floor, unit)} (the floor)`;
    const help = waysOut(plan.system).length ? "More steps, a higher limit or another target would help." : "No push within the limits breaks the mass away: a higher limit would help, more steps would not.";
    return `This target cannot be reached in ${length} steps (${seconds(length)} s), whatever the method: the nearest that any plan ends is ${nearest}. This plan has an error of ${distance(plan.terminal_error, unit)}. ${help}`;
  }
  const can = `The target can be reached in ${reach.minimum_steps} of the ${length} steps (${seconds(reach.minimum_steps)} of ${seconds(length)} s)`;
  if (plan.robustness) {
    const { mean_error: mean, worst_error: worst, num_systems: count } = plan.robustness;
    return `${can} if the plant is as it is said to be. On ${count} plants that it may be this plan ends ${distance(mean, unit)} off on average, ${distance(worst, unit)} at worst: only a closed loop gets nearer.`;
  }
  if (plan.gap < 1e-5) return `${can}, and this plan arrives.`;
  if (plan.gap < 0.01) return `${can}; this plan ends ${distance(plan.gap, unit)} off. Refinement would close that gap.`;
  return `${can}, but this plan ends ${distance(plan.gap, unit)} off: the method's fault, not the machine's. Try refinement, more candidates or another method.`;
}
