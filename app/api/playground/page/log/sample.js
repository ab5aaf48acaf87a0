// A log for those who have none: of a simulated machine, whose parameters are told nowhere on the page.

import { ask } from "../api.js";

export const NAME = "sample.csv";
const STEP = 0.04;
const LIMIT = 4;
const MACHINE = {
  static_friction: { forward: 0.9, backward: 1.05 }, coulomb_friction: { forward: 0.7, backward: 0.85 },
  viscous_damping: 1.2, control_gain: 0.8, control_limit: LIMIT, time_step: STEP,
};
/** V of 0.8 m/s² each. */

/** Controls that tell friction: in both directions ramps from rest, and dwells at three speeds. */
function excitation() {
  const controls = [];
  const hold = (value, seconds) => { for (let k = 0; k < Math.round(seconds / STEP); k += 1) controls.push(value); };
  for (const way of [1, -1, 1, -1]) {
    for (let k = 0; k < 40; k += 1) controls.push(way * (0.7 + 0.0225 * k));
    hold(0, 0.5);
  }
  for (const push of [1.6, 2.4, 3.6]) {
    for (const way of [1, -1]) {
      hold(way * push, 0.3);
      hold(way * 0.6 * push, 0.5);
      hold(0, 0.6);
    }
  }
  return controls;
}

/** Return the text of the sample. */
export async function sample(signal) {
  const controls = excitation();
  const body = { initial_state: [0, 0], system: MACHINE, controls, disturbance: { acceleration_noise: 0.1 }, sensor: { position_noise: 1e-3 }, seed: 7, include: ["measurements"] };
  const { runs: [{ measurements }] } = await ask("simulate", body, signal);
  const rows = measurements.map(([position], k) => [(k * STEP).toFixed(2), (controls[k] ?? 0).toFixed(3), (1e3 * position).toFixed(2)].join(","));
  return ["time_s,voltage_V,position_mm", ...rows].join("\n");
}
