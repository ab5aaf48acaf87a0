// Denoise: the sampler's candidates step by step, from noise to plans.

import { get, numbers, set } from "../address.js";
import { ask } from "../api.js";
import { around, Chart, extent } from "../charts/chart.js";
import { band, bundle, rule } from "../charts/layers.js";
import { legend } from "../charts/legend.js";
import { timesOf } from "../charts/motion.js";
import { candidates, limits, rest, section, thresholds } from "../controls.js";
import { distance, h } from "../dom.js";
import { choiceField, numberField } from "../fields.js";
import { machine, number, shared } from "../request.js";
import { offerShare, planFiles } from "../share.js";

export const name = "denoise";
export const title = "Denoise";
export const parts = ["task", sampler, "machine"];

const FRAME_MS = 250;
const KEYS = [["candidate", "candidates, the better the bluer"], ["band", "too weak a push to start the mass"], ["limit", "control limits"], ["target", "target"]];
const ERROR_KEYS = [["best", "the best candidate"], ["median", "the median"]];

function sampler() {
  return section("Sampler",
    choiceField({ name: "sampler", label: "Sampler", pointer: "/method/sampler", choices: [["ddim", "DDIM"], ["dpm_solver", "DPM-Solver++"]] }),
    numberField({ name: "stages", label: "Denoising steps", pointer: "/method/steps", range: [1, 50], step: 1 }),
    numberField({ name: "guidance", label: "Guidance scale", pointer: "/method/guidance_scale", hint: "0 ignores the task, 1 follows it, more sharpens; empty: the model's own"  }),
    candidates(), rest());
}

export function open(view) {
  const { position_unit: unit, control_unit: controlUnit } = machine();
  const x = { label: "time, s" };
  const controls = new Chart({ label: "Controls of all candidates", height: "high", x, y: { label: controlUnit } });
  const positions = new Chart({ label: "Where they would lead", height: "high", x, y: { label: unit } });
  const errors = new Chart({
    label: "Error at each step", height: "low",
    x: { label: "denoising step" }, y: { label: unit, log: true },
    lines: [{ label: "best", colour: "best" }, { label: "median", colour: "series-2", dash: [6, 3] }],
    seek: (step) => choose(Math.round(step)),
  });
  const slider = h("input", { type: "range", min: 0, max: 20, step: 1, "aria-label": "Denoising step", oninput: () => choose(Number(slider.value)) });
  const text = h("output", { class: "moment" });
  const play = h("button", { type: "button", class: "play", onclick: () => (timer ? pause() : start()) }, "Play");
  view.replaceChildren(
    h("p", { class: "verdict" }, "Every candidate begins as noise. Each step the network says what of it is noise, and some of that is taken away; what is left leads nearer to the target."),
    h("div", { class: "transport" }, play, slider), text,
    h("div", { class: "split even" }, controls.element, positions.element), legend(KEYS),
    errors.element, legend(ERROR_KEYS));
  let plan = null;
  let timer = null;

  const last = () => plan.denoising.controls.length - 1;
  const chosen = () => Math.min(get("stage") === "" ? last() : Number(get("stage")) || 0, last());

  function choose(stage) {
    if (!plan) return;
    pause();
    set({ stage: Math.min(Math.max(stage, 0), last()) });
    show();
  }

  function pause() {
    clearInterval(timer);
    timer = null;
    play.textContent = "Play";
  }

  function start() {
    if (!plan) return;
    play.textContent = "Pause";
    let stage = chosen() === last() ? 0 : chosen();
    timer = setInterval(() => {
      if (!view.contains(slider) || stage > last()) { pause(); return; }
      set({ stage });
      show();
      stage += 1;
    }, FRAME_MS);
  }

  function show() {
    const { denoising, system } = plan;
    const stage = chosen();
    const times = timesOf(denoising.states[0][0].length, system.time_step);
    const found = denoising.terminal_errors[stage];
    const [low, high] = limits(system);
    const { forward, backward } = thresholds(system);
    const reach = Math.max(...denoising.controls.flat(2).map(Math.abs));
    slider.max = last();
    slider.value = stage;
    controls.show({
      x: [0, times.at(-1)], y: around(-reach, reach, 0.02),
      under: [
        band(Math.max(-backward, low), Math.min(forward, high), "band"),
        bundle(times, denoising.controls[stage].map((line) => [...line, line.at(-1)]), found, { stepped: true }),
        rule(low, "limit"), rule(high, "limit"),
      ],
      summary: `step ${stage}`,
    });
    const target = numbers("target")[0];
    const ends = denoising.states.at(-1).flat().map((state) => state[0]);
    positions.show({
      x: [0, times.at(-1)], y: around(...extent([...ends, target]), 0.4),
      under: [rule(target, "target"), bundle(times, denoising.states[stage].map((states) => states.map((state) => state[0])), found)],
      summary: `step ${stage}`,
    });
    errors.mark(stage);
    const what = stage === 0 ? "pure noise" : stage === last() ? "the plans" : "on the way";
    text.textContent = `Step ${stage} of ${last()}: ${what}; the best would end ${distance(Math.min(...found), unit)} from the target.`;
  }

  return async (signal) => {
    const method = { name: "action_diffusion", sampler: get("sampler"), steps: number("stages") };
    if (get("guidance") !== "") method.guidance_scale = number("guidance");
    const body = { ...shared(), target_state: numbers("target"), method, include: ["states", "denoising"] };
    plan = await ask("plan", body, signal);
    const steps = plan.denoising.terminal_errors;
    const sorted = steps.map((found) => [...found].sort((a, b) => a - b));
    const [best, middle] = [sorted.map((found) => Math.max(found[0], 1e-9)), sorted.map((found) => Math.max(found[Math.floor(found.length / 2)], 1e-9))];
    errors.show({ x: [0, steps.length - 1], y: [0.7 * Math.min(...best), 1.4 * Math.max(...middle)], data: [steps.map((_, index) => index), best, middle], summary: `the best from ${distance(best[0], unit)} to ${distance(best.at(-1), unit)}` });
    show();
    offerShare([{ path: "plan", body }], planFiles([{ name: plan.method, plan }]));
    return `Denoised ${steps[0].length} candidates in ${steps.length - 1} steps, ${plan.timing_ms.total.toFixed(0)} ms, by ${plan.model.name}.`;
  };
}
