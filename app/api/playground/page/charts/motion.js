// A plan over time: position, velocity and control, one under the other.

import { limits, thresholds } from "../controls.js";
import { around, Chart, extent } from "./chart.js";
import { colour } from "./colours.js";
import { band, bundle, fan, rug, rule } from "./layers.js";
import { legend } from "./legend.js";

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
  constructor({ unit, controlUnit, seek, colour = "best" }) {
    const one = (label, y, more, x = {}) => new Chart({ label, x, y: { label: y }, lines: [{ label, colour, width: 2.5, ...more }], seek });
    this.colour = colour;
    this.charts = {
      position: one("Position", unit),
      velocity: one("Velocity", `${unit}/s`),
      control: one("Control", controlUnit, { stepped: true }, { label: "time, s" }),
    };
    this.elements = [...Object.values(this.charts).map((chart) => chart.element), legend(KEYS)];
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
      const line = plan.states.map((state) => state[index]);
      const lines = candidates ? candidates.states.map((states) => states.map((state) => state[index])) : several.map((states) => states.map((state) => state[index]));
      const aims = targets.map((target) => target[name]);
      this.charts[name].show({
        x, y: span[name] ?? around(...extent([...line, ...aims, ...lines.flat()])),
        data: [times, line],
        under: [
          ...targets.map((target) => aim(target, target[name], step)),
          ...(candidates ? [bundle(times, lines, candidates.terminal_errors)] : []),
          ...(several.length ? [fan(times, lines, this.colour)] : []),
        ],
        summary: `from ${line[0].toPrecision(3)} to ${line.at(-1).toPrecision(3)}`,
      });
    };
    one(0, "position");
    one(1, "velocity");
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

const KEYS = [
  ["band", "too weak a push to start the mass"], ["limit", "control limits"], ["stuck", "stuck steps"], ["target", "target"],
];

/** A target over the steps for which it is one. */
const aim = ({ from, to }, value, step) => (ctx, u, ratio) => {
  const at = u.valToPos(value, "y", true);
  ctx.strokeStyle = colour("target");
  ctx.lineWidth = 1.5 * ratio;
  ctx.setLineDash([6 * ratio, 4 * ratio]);
  ctx.beginPath();
  ctx.moveTo(u.valToPos(from * step, "x", true), at);
  ctx.lineTo(u.valToPos(to * step, "x", true), at);
  ctx.stroke();
  ctx.setLineDash([]);
};
