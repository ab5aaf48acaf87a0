// A plan over time: position, velocity and control, one under the other.

import { limits, thresholds } from "../controls.js";
import { around, Chart, extent } from "./chart.js";
import { band, bundle, fan, rug, rule } from "./layers.js";

const POSITION_TOLERANCE = 0.01;
/** m: nearer to the target, waiting counts for nothing (as in the service's stuck steps). */

export const timesOf = (count, step) => Array.from({ length: count }, (_, index) => index * step);

/** Which steps wait below static friction, off the target. */
export function stuckSteps(plan, targetAt) {
  const { forward, backward } = thresholds(plan.system);
  return [...plan.controls.keys()].filter((k) => {
    const [position, velocity] = plan.states[k];
    const control = plan.controls[k];
    return Math.abs(velocity) < plan.system.velocity_threshold && control < forward && control > -backward
      && Math.abs(position - targetAt(k)) > POSITION_TOLERANCE;
  });
}

export class Motion {
  constructor({ unit, controlUnit, seek, only = ["position", "velocity", "control"] }) {
    const x = { label: "time, s" };
    const all = {
      position: { label: "Position", x, y: { label: unit }, lines: [{ label: "position", colour: "best", width: 2.5 }], seek },
      velocity: { label: "Velocity", x, y: { label: `${unit}/s` }, lines: [{ label: "velocity", colour: "best", width: 2.5 }], seek },
      control: { label: "Control: in the shaded band a push is too weak to start the mass", x, y: { label: controlUnit }, lines: [{ label: "control", colour: "best", stepped: true, width: 2.5 }], seek },
    };
    this.charts = Object.fromEntries(only.map((name) => [name, new Chart(all[name])]));
    this.elements = only.map((name) => this.charts[name].element);
  }

  /**
   * @param plan system, controls, states, and perhaps candidates
   * @param targets [{from, to, position, velocity}], by step
   * @param several states (N, H+1, 2) of the same plan on several plants
   * @param span ranges {position, velocity} shared with other charts
   */
  show({ plan, targets, several = [], span = {} }) {
    const step = plan.system.time_step;
    const times = timesOf(plan.states.length, step);
    const { candidates } = plan;
    const x = [0, times.at(-1)];
    const one = (index, name, y) => {
      const chart = this.charts[name];
      if (!chart) return;
      const line = plan.states.map((state) => state[index]);
      const lines = candidates ? candidates.states.map((states) => states.map((state) => state[index])) : several.map((states) => states.map((state) => state[index]));
      const aims = targets.map((target) => target[name]);
      chart.show({
        x, y: span[name] ?? around(...extent([...line, ...aims, ...lines.flat()])),
        data: [times, line],
        under: [
          ...targets.map((target) => aim(target, target[name], step)),
          ...(candidates ? [bundle(times, lines, candidates.terminal_errors)] : []),
          ...(several.length ? [fan(times, lines, "fan")] : []),
        ],
        summary: `from ${line[0].toPrecision(3)} to ${line.at(-1).toPrecision(3)}`,
      });
    };
    one(0, "position");
    one(1, "velocity");
    if (!this.charts.control) return;
    const [low, high] = limits(plan.system);
    const { forward, backward } = thresholds(plan.system);
    const targetAt = (k) => (targets.find((target) => k < target.to) ?? targets.at(-1)).position;
    const stuck = stuckSteps(plan, targetAt);
    this.charts.control.show({
      x, y: around(low, high, 0.1),
      data: [times, [...plan.controls, plan.controls.at(-1)]],
      under: [
        band(Math.max(-backward, low), Math.min(forward, high), "band"),
        ...(candidates ? [bundle(times, candidates.controls.map((controls) => [...controls, controls.at(-1)]), candidates.terminal_errors, { stepped: true })] : []),
      ],
      over: [rule(low, "limit"), rule(high, "limit"), rug(stuck.map((k) => k * step), step, "stuck")],
      summary: `between ${Math.min(...plan.controls).toPrecision(2)} and ${Math.max(...plan.controls).toPrecision(2)}; ${stuck.length} stuck steps`,
    });
  }

  mark(time) {
    for (const chart of Object.values(this.charts)) chart.mark(time);
  }
}

/** A target over the steps for which it is one. */
const aim = ({ from, to }, value, step) => (ctx, u, ratio) => {
  const at = u.valToPos(value, "y", true);
  ctx.strokeStyle = targetColour();
  ctx.lineWidth = 1.5 * ratio;
  ctx.setLineDash([6 * ratio, 4 * ratio]);
  ctx.beginPath();
  ctx.moveTo(u.valToPos(from * step, "x", true), at);
  ctx.lineTo(u.valToPos(to * step, "x", true), at);
  ctx.stroke();
  ctx.setLineDash([]);
};
const targetColour = () => getComputedStyle(document.documentElement).getPropertyValue("--target");
