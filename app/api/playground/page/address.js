// The state of the page: text by name, and the address that says all of it but what is as ever.
// No key ever gets in here. What the names mean to a request is in request.js.

export const DEFAULTS = {
  tab: "plan",
  start: "0,0",
  target: "0.6,0",
  machine: "paper",
  method: "action_diffusion",
  k: "16",
  seed: "7",
  horizon: "",
  refine: "",
  objective: "terminal_error",
  compare: "action_diffusion,dataset_prior,cem,dataset_prior+",
  sampler: "ddim",
  stages: "20",
  stage: "",
  moment: "0",
  "relative.coulomb_friction": "10",
  "relative.static_friction": "10",
  "relative.viscous_damping": "0",
  "relative.control_gain": "5",
  "relative.bias": "0",
  risk: "mean",
  targets: "0.4,0;-0.4,0;0.2,0",
  goal: "0.3",
  controller: "receding_horizon",
  noise: "0.2",
  delay: "0",
  "off.static_friction": "15",
  "off.coulomb_friction": "12",
  "off.viscous_damping": "0",
  "off.control_gain": "-4",
  "off.bias": "0",
  direction: "auto",
};

/** How what is there is looked at: nothing has to be asked anew for these. */
export const VIEWS = ["stage", "moment"];
/** What a closed loop that is under way takes in as it goes. */
export const LIVE = ["goal", "off.static_friction", "off.coulomb_friction", "off.viscous_damping", "off.control_gain", "off.bias"];

const BETWEEN_MS = 100;
/** Browsers take an address seldom: a slider that is dragged would change it too often. */

const values = new Map();
const listeners = new Set();

export const get = (name) => values.get(name) ?? DEFAULTS[name] ?? "";
export const numbers = (name) => get(name).split(",").map(Number);

/** Change some values; null is as ever. Going to another tab is a step that "back" takes back. */
export function set(changes, { push = "tab" in changes } = {}) {
  for (const [name, value] of Object.entries(changes)) {
    if (value === null || String(value) === (DEFAULTS[name] ?? "")) values.delete(name);
    else values.set(name, String(value));
  }
  if (push) write("pushState");
  else if (!waiting) {
    if (performance.now() - written >= BETWEEN_MS) write("replaceState");
    else waiting = setTimeout(() => write("replaceState"), BETWEEN_MS);
  }
  for (const listener of listeners) listener(Object.keys(changes));
}

let written = -Infinity;
let waiting = null;

function write(method) {
  clearTimeout(waiting);
  waiting = null;
  written = performance.now();
  const address = "#" + new URLSearchParams([...values]).toString().replaceAll("%2C", ",").replaceAll("%3B", ";");
  if (address !== (location.hash || "#")) history[method](null, "", address);
}

/** All names that begin so and have a value of their own. */
export const named = (prefix) => [...values.keys()].filter((name) => name.startsWith(prefix));

/** Call with the names that changed, now and whenever some do. */
export const listen = (listener) => listeners.add(listener);

function read() {
  values.clear();
  for (const [name, value] of new URLSearchParams(location.hash.slice(1))) values.set(name, value);
}

read();
addEventListener("popstate", () => {
  read();
  for (const listener of listeners) listener(["tab"]);
});
