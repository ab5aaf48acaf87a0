// Sequence: several targets, one after the other; segments appear as they are planned.

import { get, set } from "../address.js";
import { events } from "../api.js";
import { Motion } from "../charts/motion.js";
import { extent, around } from "../charts/chart.js";
import { section, state } from "../controls.js";
import { distance, h, short } from "../dom.js";
import { stateField } from "../fields.js";
import { reserve, table } from "../measures.js";
import { machine, planned, system } from "../request.js";
import { say } from "../run.js";
import { offerShare, planFiles } from "../share.js";
import { Track } from "../track.js";

export const name = "sequence";
export const title = "Sequence";
export const parts = [task, "method", "machine"];

const targets = () => get("targets").split(";").map((text) => text.split(",").map(Number));
const write = (list) => set({ targets: list.map((one) => one.join(",")).join(";") });

function task() {
  const rows = h("div");
  const show = () => rows.replaceChildren(...targets().map((_, index) => h("div", { class: "target-row" },
    stateField({
      label: `Target ${index + 1}`, pointer: `/targets/${index}`, unit: machine().position_unit,
      read: () => targets()[index] ?? [], write: (value) => write(targets().with(index, value)),
    }),
    h("button", { type: "button", class: "quiet", "aria-label": `Remove target ${index + 1}`, disabled: targets().length < 2, onclick: () => { write(targets().toSpliced(index, 1)); show(); } }, "×"))));
  show();
  return section("Task", state("start", "Start"), rows,
    h("button", { type: "button", onclick: () => { write([...targets(), targets().at(-2) ?? [0, 0]]); show(); } }, "Add a target"));
}

export function open(view) {
  const { position_unit: unit, control_unit: controlUnit } = machine();
  const results = reserve(targets().length);
  const motion = new Motion({ unit, controlUnit, seek: (time) => track.seek(time) });
  const track = new Track(unit, controlUnit, (time) => motion.mark(time));
  view.replaceChildren(results, track.element, h("div", { class: "column" }, motion.elements));

  return async (signal) => {
    const { target_state: _, ...rest } = planned();
    const body = { ...rest, targets: targets() };
    const segments = [];
    for await (const { kind, data } of events("plan_multistep", body, signal)) {
      if (kind === "plan") {
        show(data.segments, data.system);
        offerShare([{ path: "plan_multistep", body }], planFiles([{ name: data.method, plan: data }]));
        return `Planned ${data.segments.length} segments in ${data.timing_ms.total.toFixed(1)} ms; they end ${distance(data.mean_end_error, unit)} off on average.`;
      }
      segments.push(data);
      show(segments, system());
      say(`Planned ${segments.length} of ${body.targets.length} segments…`);
    }
    throw new Error("the events ended without a plan");
  };

  function show(segments, plant) {
    const plan = {
      system: plant,
      controls: segments.flatMap((one) => one.controls),
      states: [segments[0].states[0], ...segments.flatMap((one) => one.states.slice(1))],
    };
    const horizon = segments[0].controls.length;
    const aims = segments.map((_, index) => {
      const [position, velocity] = targets()[index];
      return { from: index * horizon, to: (index + 1) * horizon, position, velocity };
    });
    motion.show({ plan, targets: aims });
    track.show(plan, aims, around(...extent([...plan.states.map((one) => one[0]), ...aims.map((aim) => aim.position)]), 0.08));
    results.replaceChildren(table("Segments", ["Target", "Error", "Floor", "Gap", "Energy", "Stuck", "Time"], segments.map((one, index) => [
      targets()[index].map((value) => short(value)).join(", "),
      distance(one.terminal_error, unit), distance(one.reachability.floor, unit), distance(one.gap, unit),
      short(one.control_energy), String(one.stuck_steps), `${short(one.timing_ms.total)} ms`,
    ])));
  }
}
