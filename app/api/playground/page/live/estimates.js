// What a controller has learned of its machine: estimates with their bands, and the truth, over time.

import { around, Chart, extent } from "../charts/chart.js";
import { area } from "../charts/layers.js";
import { forwardOf } from "../request.js";

const SIGMAS = 2;
/** Of a band: 95 % of a normal distribution. */

const PARAMETERS = [
  {
    name: "static friction, forward", unit: (force) => force, true: (plant) => forwardOf(plant.static_friction),
    band: ({ static_forward: band }) => band,
  },
  {
    name: "Coulomb friction, forward", unit: (force) => force, true: (plant) => forwardOf(plant.coulomb_friction),
    band: ({ system, coulomb_std: std }) => spread(forwardOf(system.coulomb_friction), std * forwardOf(system.coulomb_friction)),
  },
  {
    name: "control gain", unit: (force, control) => (control === force ? "" : `${force} per ${control}`), true: (plant) => plant.control_gain,
    band: ({ system, gain_std: std }) => spread(system.control_gain, std * system.control_gain),
  },
  {
    name: "bias", unit: (force) => force, true: (plant) => plant.bias,
    band: ({ system, bias_std: std }) => spread(system.bias, std),
  },
];

const spread = (value, std) => [value - SIGMAS * std, value + SIGMAS * std];

export class Estimates {
  constructor(force, control) {
    this.charts = PARAMETERS.map(({ name, unit }) => new Chart({
      label: name[0].toUpperCase() + name.slice(1), height: "small", x: {}, y: { label: unit(force, control) },
      lines: [{ label: "true", colour: "target", dash: [6, 4] }, { label: "estimate", colour: "best" }],
    }));
    this.element = this.charts.map(({ element }) => element);
  }

  /** What is kept of a step: for each parameter the truth, and the band, none without an estimate. */
  static of(plant, estimate) {
    return PARAMETERS.map((one) => [one.true(plant), ...(estimate ? one.band(estimate) : [null, null])]);
  }

  /** @param kept of each step, as `of` has them */
  show(times, x, kept) {
    this.charts.forEach((chart, index) => {
      const columns = [0, 1, 2].map((column) => kept.map((each) => each[index][column]));
      const [truth, low, high] = columns;
      const middle = low.map((value, k) => (value === null ? null : (value + high[k]) / 2));
      const [least, most] = extent(columns.flat().filter((value) => value !== null));
      const air = Math.max(1e-3, 0.02 * Math.abs(most));
      chart.show({ x, y: around(least - air, most + air), data: [times, truth, middle], under: [area(times, low, high, "reachable")] });
    });
  }
}
