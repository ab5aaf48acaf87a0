// What a log says of its machine: its parameters, how well they explain it, its friction, and what to do next.

import { set } from "../address.js";
import { around, Chart, extent } from "../charts/chart.js";
import { colour } from "../charts/colours.js";
import { area, rule, strands } from "../charts/layers.js";
import { legend } from "../charts/legend.js";
import { easyTarget } from "../controls.js";
import { distance, h, short, words } from "../dom.js";
import { reserve, table } from "../measures.js";
import { frictionAt } from "../plant.js";
import { backwardOf, DIRECTIONS, forwardOf, FRICTIONS, RELATIVE } from "../request.js";

const SPEEDS = 60;
const COVERED = [0.025, 0.975];
/** Of the ensemble, between the edges of a band. */
const MOST_RELATIVE = 90;

export class Findings {
  /** @param unit of positions, @param controlUnit as far as the log says it */
  constructor(unit, controlUnit) {
    Object.assign(this, { unit, controlUnit });
    this.words = h("p", { class: "verdict" });
    this.notes = h("div", { class: "found-notes" });
    this.parameters = reserve(5);
    this.plan = h("button", { type: "button", class: "primary", onclick: () => this.planWith() }, "Plan with it");
    const x = { label: "time, s" };
    this.motion = new Chart({ label: "Position, measured and predicted", height: "low", x, y: { label: unit }, lines: [{ label: "measured", colour: "text", width: 1.5 }] });
    this.errors = new Chart({ label: "Predicted less measured", height: "low", x, y: { label: `m${unit}` } });
    this.friction = new Chart({ label: "Friction over velocity, with its band", height: "high", x: { label: `velocity, ${unit}/s` }, y: { label: `${unit}/s²` } });
    this.element = h("div", {}, this.words, h("div", { class: "next" }, this.plan, h("span", { class: "hint" }, "takes the plant, and how unsure it is, to the tab Plan")),
      this.notes, this.parameters, h("div", { class: "split even" },
        h("div", {}, this.motion.element, this.errors.element, legend([["measured", "measured"], ["rival", "predicted, from the start of each stretch"]])),
        h("div", {}, this.friction.element, legend([["best", "friction while it slides"], ["set", "95 % of the plants that it may be"], ["rest", "static friction"]]))));
  }

  show({ fields, notes, answer }) {
    this.answer = answer;
    const { fit } = answer;
    const late = answer.delay_steps ? ` Its controls act ${answer.delay_steps} ${answer.delay_steps === 1 ? "step" : "steps"} late.` : "";
    const lag = answer.position_lag ? ` It moves on between its samples, as machines do: tell a controller's observer of a position_lag of ${short(answer.position_lag, 3)} s.` : "";
    const untold = answer.parameters.some((one) => !one.identifiable) ? " The log does not tell all of it: the table says what, and why." : "";
    this.words.textContent = `This plant predicts the position ${short(fit.window_s, 2)} s ahead to ${distance(fit.end_error_rms, this.unit)} (r.m.s.), which explains ${explained(fit.r2)} % of the motion.${late}${lag}${untold}`;
    this.notes.replaceChildren(...[
      ["Assumed", notes], ["Warnings", answer.warnings], ["Record next", answer.advice.map(plain)],
    ].filter(([, items]) => items.length).map(([what, items]) => list(what, items)));
    this.parameters.replaceChildren(table("Parameters, with their 95 % intervals", ["Parameter", "Value", "Between", "Unit", h("span", { class: "told" }, "Does the log tell it?")],
      answer.parameters.map((one) => [
        words(one.name.replace(".", ", ")).replace("coulomb", "Coulomb"), short(one.value, 4), `${short(one.interval[0], 4)} and ${short(one.interval[1], 4)}`, this.unitOf(one.name),
        h("span", { class: "told" }, one.identifiable ? "yes" : `no: ${one.why_not}`),
      ])));
    this.showMotion(fields, answer);
    this.showFriction(fields, answer);
  }

  unitOf(name) {
    const force = `${this.unit}/s²`;
    if (name.startsWith("viscous")) return "1/s";
    return name === "control_gain" ? `${force} for each ${this.controlUnit}` : force;
  }

  showMotion({ time_step: step, positions }, { predictions, fit }) {
    const times = positions.map((_, k) => k * step);
    const x = [0, times.at(-1)];
    const { first_samples: starts, positions: predicted } = predictions;
    const within = starts.map((start, index) => predicted[index].map((_, k) => (start + k) * step));
    const errors = starts.map((start, index) => predicted[index].map((position, k) => 1e3 * (position - positions[start + k])));
    const summary = `predicted ${short(fit.window_s, 2)} s ahead to ${distance(fit.end_error_rms, this.unit)}`;
    this.motion.show({ x, y: around(...extent(positions)), data: [times, positions], over: [strands(within, predicted, "series-2")], summary });
    this.errors.show({ x, y: around(...extent(errors.flat())), under: [rule(0, "limit"), strands(within, errors, "series-2")], summary });
  }

  showFriction({ time_step: step, positions }, { system, systems }) {
    const fastest = fastestOf(positions, step);
    const speeds = Array.from({ length: SPEEDS }, (_, k) => (fastest * (k + 1)) / SPEEDS);
    const sides = [[1, forwardOf], [-1, backwardOf]].map(([way, of]) => {
      const along = speeds.map((speed) => way * speed);
      const curve = speeds.map((speed) => way * frictionAt(system, speed, way));
      const edges = COVERED.map((share) => speeds.map((speed) => quantile(systems.map((plant) => way * frictionAt(plant, speed, way)), share)));
      const statics = systems.map((plant) => way * of(plant.static_friction));
      const hold = { value: way * of(system.static_friction), low: quantile(statics, COVERED[0]), high: quantile(statics, COVERED[1]) };
      return { along, curve, edges, hold };
    });
    const holds = sides.map(({ hold }) => hold);
    this.friction.show({
      x: [-fastest, fastest], y: around(...extent(sides.flatMap(({ edges, hold }) => [...edges.flat(), ...Object.values(hold)]))),
      under: [
        ...sides.map(({ along, edges: [low, high] }) => area(along, low, high, "reachable")),
        strands(sides.map(({ along }) => along), sides.map(({ curve }) => curve), "best"),
      ],
      over: [whiskers(holds)],
      summary: `static friction ${short(holds[0].value)} forward, ${short(-holds[1].value)} backward`,
    });
  }

  /** Take the plant to the tab Plan, each of its parameters as uncertain as its interval says. */
  planWith() {
    const { system, parameters } = this.answer;
    const rounded = (value) => Number(value.toPrecision(5));
    const directed = FRICTIONS.some((name) => typeof system[name] === "object");
    const plant = Object.entries(system).flatMap(([name, value]) => {
      if (!FRICTIONS.includes(name) || !directed) return [[`system.${name}`, rounded(value)]];
      return DIRECTIONS.map((way) => [`system.${name}.${way}`, rounded((way === "forward" ? forwardOf : backwardOf)(value))]);
    });
    const relative = RELATIVE.map((name) => {
      const shares = parameters.filter((one) => one.name.split(".")[0] === name)
        .map(({ value, interval: [low, high] }) => (100 * Math.max(value - low, high - value)) / Math.max(Math.abs(value), 1e-9));
      return [`relative.${name}`, Math.min(MOST_RELATIVE, Math.ceil(10 * Math.max(0, ...shares)) / 10)];
    });
    set({
      tab: "plan", machine: "own", "own.position_unit": this.unit, "own.control_unit": this.controlUnit, directed: directed ? "yes" : null,
      ...Object.fromEntries(plant), ...Object.fromEntries(relative), uncertain: "yes",
      method: "dataset_prior", refine: "yes", start: null, target: `${easyTarget(system)},0`, goal: easyTarget(system),
    });
  }
}

/** Per cent, rounded down: no fit explains all. */
const explained = (r2) => (Math.floor(1e4 * r2) / 100).toFixed(2).replace("-", "−");
const list = (title, items) => h("div", {}, h("h2", {}, title), h("ul", {}, items.map((item) => h("li", {}, item))));
const plain = (text) => text.replaceAll("`", "");

/** Return the fastest that positions change, over some samples at a time. */
function fastestOf(positions, step) {
  const few = Math.max(1, Math.round(0.05 / step));
  return Math.max(...positions.slice(few).map((position, k) => Math.abs(position - positions[k]))) / (few * step);
}

function quantile(values, share) {
  const sorted = [...values].sort((a, b) => a - b);
  const at = share * (sorted.length - 1);
  const below = Math.floor(at);
  return sorted[below] + (at - below) * ((sorted[below + 1] ?? sorted[below]) - sorted[below]);
}

/** What static friction may be, at rest. */
const whiskers = (statics) => (ctx, u, ratio) => {
  const x = u.valToPos(0, "x", true);
  ctx.strokeStyle = ctx.fillStyle = colour("at-rest");
  ctx.lineWidth = 3 * ratio;
  for (const { value, low, high } of statics) {
    ctx.beginPath();
    ctx.moveTo(x, u.valToPos(low, "y", true));
    ctx.lineTo(x, u.valToPos(high, "y", true));
    ctx.stroke();
    ctx.beginPath();
    ctx.arc(x, u.valToPos(value, "y", true), 4 * ratio, 0, 7);
    ctx.fill();
  }
};
