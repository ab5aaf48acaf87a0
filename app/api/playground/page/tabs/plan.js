// Plan: a start, a target, a plan; what can be reached, and what the mass does.

import { numbers, set } from "../address.js";
import { ask } from "../api.js";
import { extent, around } from "../charts/chart.js";
import { PhasePlane } from "../charts/phase.js";
import { Motion } from "../charts/motion.js";
import { legend } from "../charts/legend.js";
import { inWords } from "../controls.js";
import { h } from "../dom.js";
import { measures, ofPlan, verdict } from "../measures.js";
import { machine, number, planned } from "../request.js";
import { offerShare, planFiles } from "../share.js";
import { Track } from "../track.js";

export const name = "plan";
export const title = "Plan";
export const parts = ["task", "method", "machine"];

const MOST_DRAWN = 256;

export function open(view) {
  const { position_unit: unit, control_unit: controlUnit } = machine();
  const words = h("p", { class: "verdict" }, " ");
  const friction = h("span");
  const numbersPlace = h("div", { class: "numbers" });
  const plane = new PhasePlane(unit, (which, state) => set({ [which]: state.join(",") }));
  const motion = new Motion({ unit, controlUnit, seek: (time) => track.seek(time) });
  const track = new Track(unit, controlUnit, (time, state) => { motion.mark(time); plane.mark(state); });
  view.replaceChildren(
    words, numbersPlace, track.element,
    h("div", { class: "split" },
      h("div", { class: "column" }, plane.element, legend(KEYS), notes(basics(friction))),
      h("div", { class: "column" }, motion.elements, notes(FURTHER))),
  );
  numbersPlace.replaceChildren(measures([["Error", "–"], ["Floor", "–"], ["Gap", "–"], ["Energy", "–"], ["Stuck steps", "–"], ["Rollouts", "–"], ["Time", "–"]]));

  return async (signal) => {
    const drawn = number("k") <= MOST_DRAWN ? ["candidates"] : [];
    const body = planned(["states", "reachable_set", ...drawn]);
    const begun = performance.now();
    const plan = await ask("plan", body, signal);
    const [start, target] = [plan.predicted_initial_state ?? plan.states[0], numbers("target")];
    const targets = [{ from: 0, to: plan.controls.length, position: target[0], velocity: target[1] }];
    words.textContent = verdict(plan);
    friction.textContent = inWords(plan.system);
    numbersPlace.replaceChildren(measures(ofPlan(plan)));
    plane.show({ start, target, plan });
    motion.show({ plan, targets });
    track.show(plan, targets, around(...extent([...plan.states.map((state) => state[0]), start[0], target[0]]), 0.1));
    offerShare([{ path: "plan", body: planned() }], planFiles([{ name: plan.method, plan }]));
    performance.measure("plan", { start: begun });
    const hidden = drawn.length ? "" : `; candidates are drawn up to K = ${MOST_DRAWN}`;
    return `Planned in ${plan.timing_ms.total.toFixed(1)} ms${hidden}.`;
  };
}

/** What somebody who sees it for the first time wants to know. */
const basics = (friction) => [
  ["What is this?", "A mass that dry friction holds is to get from start to target. The plan is the whole sequence of controls, made beforehand. Drag start and target in the plane above, press Play."],
  ["Why does a small push do nothing?", friction],
  ["What is the floor?", "The error is how far from the target a plan ends, velocity counted with position. The floor is the least error that any controls can end with in so many steps, by the physics alone: 0 within the blue area; outside, no method arrives. The gap between the two is the method's fault."],
  ["Which method?", "To arrive exactly: dataset prior, with Refine ticked. For smooth plans that end near without refinement: action diffusion. Compare shows them side by side."],
];

const FURTHER = [
  ["Can my machine do this move?", "Choose it as preset or set its numbers: the sentence at the top says whether the target can be reached, and in how few steps. Your machine finds the numbers from a log."],
  ["And if its friction is not quite known?", "Then no plan made beforehand arrives: Doubt shows by how much it misses, and Closed loop what measuring on the way does about it."],
];

const notes = (questions) => h("dl", { class: "notes" }, questions.map(([question, answer]) => h("div", {}, h("dt", {}, question), h("dd", {}, answer))));

const KEYS = [["best", "the plan"], ["candidate", "candidates, the better the bluer"], ["set", "what can be reached"], ["rest", "where it can be at rest"]];
