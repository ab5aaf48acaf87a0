// Doubt: what plans come to where the plant is known to within some per cent only.

import { get, numbers } from "../address.js";
import { ask } from "../api.js";
import { around, Chart, extent } from "../charts/chart.js";
import { rule } from "../charts/layers.js";
import { legend } from "../charts/legend.js";
import { Motion } from "../charts/motion.js";
import { candidates, methodChoice, rest, section } from "../controls.js";
import { distance, h } from "../dom.js";
import { choiceField, numberField } from "../fields.js";
import { reserve, swatch, table } from "../measures.js";
import { machine, planned, relative } from "../request.js";
import { offerShare, planFiles } from "../share.js";

export const name = "doubt";
export const title = "Doubt";
export const parts = ["task", doubt, way, "machine"];

const PARAMETERS = [
  ["coulomb_friction", "Coulomb friction"], ["static_friction", "Static friction"],
  ["viscous_damping", "Viscous damping"], ["control_gain", "Control gain"], ["bias", "Bias"],
];
const RISKS = { mean: "mean", worst: "worst", cvar: { cvar: 0.9 } };

function way() {
  return section("Method", methodChoice(), candidates(), rest());
}

function doubt() {
  return section("How far off it may be",
    PARAMETERS.map(([parameter, label]) => numberField({
      name: `relative.${parameter}`, label: `${label}, ± %`, pointer: `/uncertainty/relative/${parameter}`, range: [0, 30], step: 1,
    })),
    choiceField({ name: "risk", label: "Plan for the least", pointer: "/uncertainty/risk", choices: [["mean", "mean error"], ["cvar", "mean of the worst tenth"], ["worst", "worst error"]] }));
}

export function open(view) {
  const { position_unit: unit, control_unit: controlUnit } = machine();
  const words = h("p", { class: "verdict" }, " ");
  const results = reserve(7);
  const motions = ["nominal", "robust"].map((kind) => {
    const motion = new Motion({ unit, controlUnit, colour: kind === "nominal" ? "series-2" : "best" });
    return { kind, motion, element: h("div", { class: "column" }, h("h2", {}, kind === "nominal" ? "Nominal: planned for the plant as it is said to be" : "Robust: planned for all plants that it may be"), motion.elements) };
  });
  const shares = new Chart({
    label: "Share of the plants on which a plan ends within an error", height: "low",
    x: { label: `error, ${unit}` }, y: { label: "share" },
    lines: [{ label: "nominal", colour: "series-2", stepped: true }, { label: "robust", colour: "best", stepped: true }],
  });
  view.replaceChildren(words, results, shares.element, legend([["rival", "nominal"], ["best", "robust"], ["target", "the bound (r.m.s.)"]]), h("div", { class: "split even" }, motions.map(({ element }) => element)));

  return async (signal) => {
    const plans = [];
    const asked = [];
    for (const robust of [false, true]) {
      const uncertainty = { relative: relative(), risk: RISKS[get("risk")] ?? get("risk"), robust };
      const body = { ...planned(["states", "ensemble"]), refine: true, uncertainty };
      asked.push({ path: "plan", body });
      plans.push(await ask("plan", body, signal));
    }
    show(...plans);
    offerShare(asked, planFiles([{ name: "nominal", plan: plans[0] }, { name: "robust", plan: plans[1] }]));
    return `Judged on ${plans[0].robustness.num_systems} plants, others than the robust plan was made with.`;
  };

  function show(...plans) {
    const [nominal, robust] = plans.map((plan) => plan.robustness);
    const target = numbers("target");
    const row = (what, pick) => [what, pick(nominal), pick(robust)];
    const length = (pick) => (one) => distance(pick(one), unit);
    const share = (limit) => (one) => `${Math.round(100 * one.within[limit])} %`;
    results.replaceChildren(table("Errors over the plants", ["", swatch(2, "Nominal"), swatch(1, "Robust")], [
      row("mean", length((one) => one.mean_error)), row("median", length((one) => one.median_error)),
      row("nine in ten within", length((one) => one.p90_error)), row("worst", length((one) => one.worst_error)),
      row(`within 0.01 ${unit}`, share("0.01")), row(`within 0.05 ${unit}`, share("0.05")),
      row("r.m.s.", length((one) => one.rms_error)),
    ]));
    const bound = robust.first_order_bound;
    const { reachable, floor } = plans[0].reachability;
    const boundWords = !reachable ? ` Even on the plant as it is said to be no plan ends nearer than ${distance(floor, unit)} (the floor).` : bound ? ` No fixed sequence of controls can do better than about ${distance(bound, unit)} r.m.s. (the bound): only feedback can.` : "";
    const how = robust.mean_error < 0.9 * nominal.mean_error - 1e-6 ? " Moving both ways, over and back, lets errors cancel." : "";
    words.textContent = `With that doubt the nominal plan ends ${distance(nominal.mean_error, unit)} off on average, the robust one ${distance(robust.mean_error, unit)}.${how}${boundWords}`;
    const sorted = [nominal, robust].map((one) => [...one.errors].sort((a, b) => a - b));
    const most = 1.05 * Math.max(...sorted.map((errors) => errors[Math.floor(0.98 * (errors.length - 1))]), 1e-9);
    const grid = Array.from({ length: 201 }, (_, index) => (most * index) / 200);
    const below = sorted.map((errors) => grid.map((limit) => errors.filter((error) => error <= limit).length / errors.length));
    shares.show({
      x: [0, most], y: [0, 1.05], data: [grid, ...below],
      under: bound ? [rule(bound, "bad", { vertical: true })] : [],
      summary: `the nominal plan ends within 0.05 ${unit} on ${share("0.05")(nominal)}, the robust one on ${share("0.05")(robust)}`,
    });
    const span = Object.fromEntries(["position", "velocity"].map((which, index) => [which, around(...extent([
      target[index], ...plans.flatMap((plan) => plan.robustness.fan.flat().map((state) => state[index])),
    ]))]));
    motions.forEach(({ motion }, index) => {
      const plan = plans[index];
      motion.show({ plan, several: plan.robustness.fan, span, targets: [{ from: 0, to: plan.controls.length, position: target[0], velocity: target[1] }] });
    });
  }
}
