// What a log says of its machine: its parameters, how well they explain it, its friction, and what to do next.

import { set } from "../address.js";
import { around, Chart, extent } from "../charts/chart.js";
import { colour } from "../charts/colours.js";
import { area, strands } from "../charts/layers.js";
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
  constructor() {
    this.words = h("p", { class: "verdict" });
    this.notes = h("div", { class: "found-notes" });
    this.parameters = reserve(6);
    this.plan = h("button", { type: "button", class: "primary", onclick: () => planWith(this.shown) }, "Plan with it");
    this.motion = new Chart({ label: "Measured, and predicted a stretch at a time", height: "high", x: { label: "time, s" }, y: { label: "" }, lines: [{ label: "measured", colour: "text", width: 1.5 }] });
    this.friction = new Chart({ label: "Friction over velocity, with its band", height: "high", x: { label: "velocity" }, y: { label: "" }, lines: [{ label: "friction", colour: "best" }] });
    this.element = h("div", {}, this.words, h("div", { class: "next" }, this.plan, h("span", { class: "hint" }, "takes the plant, and how unsure it is, to the tab Plan")),
      this.notes, this.parameters, h("div", { class: "split even" },
        h("div", {}, this.motion.element, legend([["measured", "measured"], ["rival", "predicted from the start of each stretch"]])),
        h("div", {}, this.friction.element, legend([["best", "friction while it slides"], ["set", "95 % of the plants that it may be"], ["rest", "static friction"]]))));
  }

  show({ fields, notes, found, answer }) {
    const turns = ["rad", "deg", "rev"].includes(found.position.unit);
    this.unit = turns ? "rad" : "m";
    this.controlUnit = found.control.unit || "unit";
    this.shown = { answer, unit: this.unit, controlUnit: this.controlUnit };
    const { fit } = answer;
    const late = answer.delay_steps ? ` Its controls act ${answer.delay_steps} ${answer.delay_steps === 1 ? "step" : "steps"} late.` : "";
    this.words.textContent = `This plant predicts ${short(100 * fit.r2, 4)} % of what the machine moves in ${short(fit.window_s, 2)} s: ${distance(fit.end_error_rms, this.unit)} off on (root mean square) average.${late}`;
    this.notes.replaceChildren(...[
      ["Assumed", notes], ["Warnings", answer.warnings], ["Record next", answer.advice.map(plain)],
    ].filter(([, items]) => items.length).map(([what, items]) => list(what, items)));
    this.parameters.replaceChildren(table("Parameters, with their 95 % intervals", ["Parameter", "Value", "Between", "Unit", "Does the log tell it?"],
      answer.parameters.map((one) => [
        words(one.name.replace(".", ", ")), short(one.value, 4), `${short(one.interval[0], 4)} and ${short(one.interval[1], 4)}`, this.unitOf(one.name),
        one.identifiable ? "yes" : h("span", { class: "why" }, `no: ${one.why_not}`),
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
    const { first_samples: starts, positions: predicted } = predictions;
    this.motion.show({
      x: [0, times.at(-1)], y: around(...extent(positions)), data: [times, positions],
      over: [strands(starts.map((start, index) => predicted[index].map((_, k) => (start + k) * step)), predicted, "series-2")],
      summary: `predicted ${short(fit.window_s, 2)} s ahead to ${distance(fit.end_error_rms, this.unit)}`,
    });
  }

  showFriction({ time_step: step, positions }, { system, systems }) {
    const fastest = fastestOf(positions, step);
    const speeds = Array.from({ length: SPEEDS }, (_, k) => (fastest * (k + 1)) / SPEEDS);
    const curve = (plant, way) => speeds.map((speed) => way * frictionAt(plant, speed, way));
    const both = (of) => [...of(-1).toReversed(), null, ...of(1)];
    const band = (way, share) => speeds.map((_, k) => quantile(systems.map((plant) => way * frictionAt(plant, speeds[k], way)), share));
    const x = [...speeds.map((speed) => -speed).toReversed(), 0, ...speeds];
    const [low, high] = COVERED.map((share) => both((way) => band(way, share)));
    const statics = [[1, forwardOf], [-1, backwardOf]].map(([way, of]) => {
      const values = systems.map((plant) => way * of(plant.static_friction));
      return { value: way * of(system.static_friction), low: quantile(values, COVERED[0]), high: quantile(values, COVERED[1]) };
    });
    const [least, most] = extent([...low, ...high, ...statics.flatMap(Object.values)].filter((value) => value !== null));
    const half = SPEEDS;
    this.friction.show({
      x: [-fastest, fastest], y: around(least, most), data: [x, both((way) => curve(system, way))],
      under: [[0, half], [half + 1, x.length]].map(([from, to]) => area(x.slice(from, to), low.slice(from, to), high.slice(from, to), "reachable")),
      over: [whiskers(statics)],
      summary: `static friction ${short(statics[0].value)} forward, ${short(-statics[1].value)} backward`,
    });
  }
}

/** Take the plant to the tab Plan, each of its parameters as uncertain as its interval says. */
function planWith({ answer: { system, parameters }, unit, controlUnit }) {
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
    tab: "plan", machine: "own", "own.position_unit": unit, "own.control_unit": controlUnit, directed: directed ? "yes" : null,
    ...Object.fromEntries(plant), ...Object.fromEntries(relative), uncertain: "yes",
    method: "dataset_prior", refine: "yes", start: null, target: `${easyTarget(system)},0`, goal: easyTarget(system),
  });
}

const list = (title, items) => h("div", {}, h("h2", {}, title), h("ul", {}, items.map((item) => h("li", {}, item))));
const legend = (entries) => h("ul", { class: "legend" }, entries.map(([kind, text]) => h("li", {}, h("span", { class: `key ${kind}` }), text)));
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
