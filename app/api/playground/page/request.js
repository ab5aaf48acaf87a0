// From the state of the page to the body of a request: what is as ever is left out.

import { get, named, numbers } from "./address.js";

export const FRICTIONS = ["static_friction", "coulomb_friction", "viscous_damping"];
export const DIRECTIONS = ["forward", "backward"];
const OTHERS = ["stribeck_velocity", "bias", "control_gain", "control_limit", "time_step", "velocity_threshold"];

/** What the service offers; filled once it has answered. */
export const offer = { machines: [], methods: [] };

/** A machine that nobody published: its numbers are in the address, and begin as those of another one. */
export const ownMachine = (other) => ({
  ...other,
  name: "own",
  title: "your own machine",
  get position_unit() { return get("own.position_unit") || other.position_unit; },
  get control_unit() { return get("own.control_unit") || other.control_unit; },
});

export const machine = () => offer.machines.find((one) => one.name === get("machine")) ?? offer.machines[0];
export const methodNamed = (name) => offer.methods.find((one) => one.name === name);

/** Whether friction differs by direction. */
export function isDirected() {
  const said = get("directed");
  return said ? said === "yes" : FRICTIONS.some((name) => typeof machine().system[name] === "object");
}

export const forwardOf = (value) => (typeof value === "object" ? value.forward : value);
export const backwardOf = (value) => (typeof value === "object" ? value.backward : value);

/** The plant: the machine's, but for what was changed. */
export function system() {
  const own = machine().system;
  const said = (name, otherwise) => (get(`system.${name}`) === "" ? otherwise : Number(get(`system.${name}`)));
  const plant = { ...own };
  for (const name of FRICTIONS) {
    plant[name] = isDirected()
      ? {
          forward: said(`${name}.forward`, forwardOf(own[name])),
          backward: said(`${name}.backward`, backwardOf(own[name])),
        }
      : said(name, forwardOf(own[name]));
  }
  for (const name of OTHERS) {
    const value = said(name, own[name] ?? null);
    if (value === null || (name === "stribeck_velocity" && value === 0)) delete plant[name];
    else plant[name] = value;
  }
  return plant;
}

export const isChanged = () => named("system.").length > 0 || get("directed") !== "";

/** A number of the state, as it is to be sent: nonsense goes to the service, which says so. */
export const number = (name) => (get(name) === "" ? undefined : Number(get(name)));

/** A method with the options that were changed. */
export function method(name) {
  const prefix = `method.${name}.`;
  const options = {};
  for (const key of named(prefix)) {
    const path = key.slice(prefix.length).split(".");
    const last = path.pop();
    let place = options;
    for (const part of path) place = place[part] ??= {};
    const text = get(key);
    place[last] = text === "" || Number.isNaN(Number(text)) ? text : Number(text);
  }
  return Object.keys(options).length ? { name, ...options } : name;
}

/** What all requests have in common. */
export function shared() {
  const body = { initial_state: numbers("start"), num_candidates: number("k") };
  if (get("seed") !== "") body.seed = number("seed");
  if (get("horizon") !== "") body.horizon = number("horizon");
  if (isChanged() || machine().name === "own") body.system = system();
  else if (machine().name !== "paper") body.system = machine().name;
  return body;
}

export const RELATIVE = ["coulomb_friction", "static_friction", "viscous_damping", "control_gain", "bias"];

/** By what share each parameter may be off. */
export const relative = () => Object.fromEntries(RELATIVE.map((one) => [one, Number(get(`relative.${one}`)) / 100]));

/** The body of a plan for the task, by the chosen method. */
export function planned(include = ["states"]) {
  const body = { ...shared(), target_state: numbers("target"), method: method(get("method")) };
  if (get("refine")) body.refine = true;
  if (get("uncertain")) body.uncertainty = { relative: relative() };
  if (get("objective") !== "terminal_error") body.objective = get("objective");
  return { ...body, include };
}
