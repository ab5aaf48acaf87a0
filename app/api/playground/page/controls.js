// The form beside every tab: the task, the machine, the method. What a tab asks for itself is there.

import { get, named, numbers, set } from "./address.js";
import { h, short, words } from "./dom.js";
import { choiceField, numberField, stateField, tickField } from "./fields.js";
import { DIRECTIONS, FRICTIONS, backwardOf, forwardOf, isDirected, machine, methodNamed, offer } from "./request.js";

const form = document.getElementById("controls");
form.addEventListener("submit", (event) => event.preventDefault());

const TAKE_IT = {
  action_diffusion: "Learned: smooth plans that end near the target, in milliseconds, without refinement.",
  dataset_prior: "Random pushes. With refinement the quickest way to a plan that arrives.",
  uniform: "Random controls: the weakest baseline; it hardly gets anywhere.",
  cem: "The paper's optimiser. Needs many candidates, does not arrive exactly.",
  icem: "CEM with coloured noise: fewer rollouts for the same.",
  mppi: "Path-integral control: plans that end near, where no learned model covers the plant.",
};

const DEFAULT_STEPS = 64;
/** As the service has it. */

const OBJECTIVES = [
  ["terminal_error", "just arrive"],
  ["control_energy", "least energy"],
  ["control_smoothness", "smoothest"],
  ["stuck_steps", "fewest stuck steps"],
];

/** Build the form for a tab, which says which parts it has and adds its own. */
export function build(tab) {
  const parts = { task, machine: () => machinePart(), method: methodPart };
  const [focused, open] = [document.activeElement?.id, [...form.querySelectorAll("details[open]")].map((one) => one.id)];
  form.replaceChildren(...tab.parts.map((part) => (typeof part === "function" ? part() : parts[part]())));
  for (const id of open) document.getElementById(id)?.setAttribute("open", "");
  if (focused && document.activeElement === document.body) document.getElementById(focused)?.focus();
}

export const section = (title, ...children) => h("fieldset", {}, h("legend", {}, title), children);

export const state = (name, label) => stateField({
  label,
  pointer: name === "start" ? "/initial_state" : "/target_state",
  unit: machine().position_unit,
  read: () => numbers(name),
  write: (value) => set({ [name]: value.join(",") }),
});

function task() {
  return section("Task", state("start", "Start"), state("target", "Target"));
}

/** The machine: one of those with a name, and all that may be changed of it. */
export function machinePart(title = "Machine") {
  const { system, control_unit: unit, position_unit: position } = machine();
  const force = `${position}/s²`;
  const now = (name, own) => Math.max(Math.abs(own), Math.abs(Number(get(`system.${name}`))));
  const one = (name, label, hint, own, most = 3 * now(name, own) || 1) => numberField({
    name: `system.${name}`, label, hint, pointer: `/system/${name.replace(".", "/")}`,
    otherwise: () => own,
    range: [name === "bias" ? -rounded(most) : 0, rounded(most)], step: rounded(most) / 300,
  });
  const friction = (name, label, hint) => (isDirected()
    ? DIRECTIONS.map((direction) => one(`${name}.${direction}`, `${label}, ${direction}`, hint, (direction === "forward" ? forwardOf : backwardOf)(system[name])))
    : one(name, label, hint, forwardOf(system[name])));
  return section(title,
    choiceField({
      name: "machine", label: "Preset", pointer: "/system",
      choices: offer.machines.map((other) => [other.name, other.title]),
      also: (name) => {
        const easy = easyTarget(offer.machines.find((other) => other.name === name).system);
        return { ...asPreset(), start: null, target: `${easy},0`, goal: easy };
      },
    }),
    friction("static_friction", "Static friction", `${force}: a push below it moves nothing`),
    friction("coulomb_friction", "Coulomb friction", `${force}: what motion costs`),
    friction("viscous_damping", "Viscous damping", "1/s: what speed costs"),
    one("control_limit", "Control limit", unit === force ? `${unit}: force over mass` : unit, system.control_limit),
    h("details", { id: "more-of-the-machine" },
      h("summary", {}, "Bias, gain, Stribeck, time step"),
      one("bias", "Bias", `${force}: slope, gravity, offset`, system.bias, Math.max(1, 2 * now("bias", system.bias))),
      one("control_gain", "Control gain", `${force} for each ${unit}`, system.control_gain),
      one("stribeck_velocity", "Stribeck velocity", `${position}/s; 0: none`, system.stribeck_velocity ?? 0, 0.1),
      one("time_step", "Time step", "s", system.time_step),
      tickField({
        name: "directed", label: "Friction differs by direction", pointer: "/system",
        otherwise: () => FRICTIONS.some((name) => typeof system[name] === "object"),
      }),
    ),
    h("button", { type: "button", class: "quiet", onclick: () => set(asPreset()) }, "Back to the preset"),
  );
}

const asPreset = () => Object.fromEntries([...named("system."), "directed"].map((name) => [name, null]));

/** A target that a plant reaches with ease: a share of what full control makes of the time. */
export function easyTarget(system) {
  const push = limits(system)[1] * system.control_gain - Math.abs(system.bias) - forwardOf(system.coulomb_friction);
  const seconds = DEFAULT_STEPS * system.time_step;
  const speed = Math.min(push * seconds, push / Math.max(1e-9, forwardOf(system.viscous_damping)));
  return Number(Math.min(0.06 * push * seconds ** 2, 0.15 * speed * seconds).toPrecision(1));
}

const rounded = (value) => Number(value.toPrecision(2));

/** The method with its options, and how hard to try. */
function methodPart() {
  const name = get("method");
  const options = optionsOf(name);
  return section("Method",
    methodChoice(),
    candidates(),
    tickField({ name: "refine", label: "Refine until it arrives", pointer: "/refine" }),
    choiceField({ name: "objective", label: "Objective", pointer: "/objective", choices: OBJECTIVES }),
    tickField({ name: "uncertain", label: "Plan for all plants that it may be", pointer: "/uncertainty", hint: "its friction and gain off by as much as set in the tab Doubt" }),
    options.length ? h("details", { id: "options" }, h("summary", {}, `Options of ${words(name)}`), options) : null,
    rest(),
  );
}

export const methodChoice = () => choiceField({
  name: "method", label: "Method", pointer: "/method", hint: TAKE_IT[get("method")],
  choices: offer.methods.map((one) => [one.name, words(one.name)]),
});

export const candidates = () => numberField({ name: "k", label: "Candidates K", pointer: "/num_candidates", range: [1, 256], step: 1 });

/** Seed and horizon. */
export const rest = () => h("div", { class: "pair" },
  numberField({ name: "horizon", label: "Steps H", pointer: "/horizon", otherwise: () => DEFAULT_STEPS }),
  numberField({ name: "seed", label: "Seed", pointer: "/seed" }),
);

/** Fields for a method's options, from the schema that requests are checked against. */
export function optionsOf(name) {
  const schema = methodNamed(name).options;
  const fields = [];
  const add = (properties, path) => {
    for (const [option, property] of Object.entries(properties)) {
      if (option === "name") continue;
      const resolved = property.$ref ? schema.$defs[property.$ref.split("/").pop()] : property;
      if (resolved.properties) {
        add(resolved.properties, [...path, option]);
        continue;
      }
      const field = {
        name: `method.${name}.${[...path, option].join(".")}`,
        label: words(option), pointer: `/method/${[...path, option].join("/")}`,
        hint: resolved.description?.split("\n\n")[0].replaceAll("`", ""),
        otherwise: () => resolved.default ?? "",
      };
      if (resolved.enum) fields.push(choiceField({ ...field, choices: resolved.enum.map((value) => [value, words(value)]) }));
      else fields.push(numberField(field));
    }
  };
  add(schema.properties, []);
  return fields;
}

/** Say in words what control does to a mass at rest. */
export function inWords(system) {
  const { control_unit: unit } = machine();
  const { forward, backward } = thresholds(system);
  const ways = waysOut(system);
  const held = `At rest, static friction holds the mass against any push between ${short(-backward)} and ${short(forward)} ${unit}.`;
  if (!ways.length) return `${held} The limits allow none that is stronger: it never moves.`;
  return `${held} Only a stronger one breaks it away${ways.length === 2 ? "" : `, and only ${ways[0]}`}; then Coulomb friction slows what slides.`;
}

/** Which ways the limits let a mass at rest break away. */
export function waysOut(system) {
  const { forward, backward } = thresholds(system);
  const [low, high] = limits(system);
  return [[high > forward, "forward"], [low < -backward, "backward"]].filter(([can]) => can).map(([, way]) => way);
}

/** The controls (in their unit) beyond which a mass at rest breaks away. */
export function thresholds(system) {
  const { static_friction: friction, bias = 0, control_gain: gain } = system;
  return {
    forward: (forwardOf(friction) - bias) / gain,
    backward: (backwardOf(friction) + bias) / gain,
  };
}

export function limits(system) {
  const limit = system.control_limit;
  return typeof limit === "object" ? [limit.lower, limit.upper] : [-limit, limit];
}
