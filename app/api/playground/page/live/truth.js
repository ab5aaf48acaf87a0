// The machine itself, as its sliders say: how it differs from what controllers believe of it.

import { get } from "../address.js";
import { section } from "../controls.js";
import { numberField } from "../fields.js";
import { DIRECTIONS, machine, system } from "../request.js";

const SHARES = [
  ["static_friction", "Static friction", "above 20 % is more than the controllers reckon with"],
  ["coulomb_friction", "Coulomb friction"],
  ["viscous_damping", "Viscous damping"],
  ["control_gain", "Control gain", "above 5 % is more than they reckon with"],
];

/** The part of the form: it changes the machines while they run. */
export function truthPart() {
  const force = `${machine().position_unit}/s²`;
  return section("The machine itself, off by",
    SHARES.map(([name, label, hint]) => numberField({ name: `off.${name}`, label: `${label}, %`, pointer: "", range: [-40, 40], step: 1, hint })),
    numberField({ name: "off.bias", label: `Bias, ${force}`, pointer: "", range: [-0.3, 0.3], step: 0.01, hint: "an untold slope" }));
}

/** The plant of the simulated machines. Static friction is never below Coulomb friction. */
export function truth() {
  const plant = system();
  const scaled = (name, value) => value * Math.max(0.01, 1 + Number(get(`off.${name}`)) / 100);
  for (const [name] of SHARES) {
    plant[name] = typeof plant[name] === "object"
      ? Object.fromEntries(DIRECTIONS.map((direction) => [direction, scaled(name, plant[name][direction])]))
      : scaled(name, plant[name]);
  }
  const [hold, drag] = [plant.static_friction, plant.coulomb_friction];
  plant.static_friction = typeof hold === "object"
    ? Object.fromEntries(DIRECTIONS.map((direction) => [direction, Math.max(hold[direction], drag[direction])]))
    : Math.max(hold, drag);
  plant.bias = (plant.bias ?? 0) + Number(get("off.bias"));
  return plant;
}
