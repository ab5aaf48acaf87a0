// The same requests elsewhere: as curl, as Python, and what came of them as files.

import { address, hasKey } from "./api.js";
import { h } from "./dom.js";

const place = document.getElementById("share");

/**
 * Offer what was asked and answered.
 * @param asked [{path, body}]
 * @param files [{label, name, type, text}]: what is saved as a file, text() its content
 */
export function offerShare(asked, files = []) {
  place.replaceChildren(
    h("details", { class: asked.length ? "" : "hidden" },
      h("summary", {}, "The same request elsewhere"),
      snippet("curl", asked.map(asCurl).join("\n\n")),
      snippet("Python", asPython(asked)),
    ),
    h("div", { class: "files" }, files.map((file) => h("button", { type: "button", onclick: () => save(file) }, file.label))),
  );
}

/** The files of plans [{name, plan}]. */
export const planFiles = (plans) => [
  { label: "Controls as CSV", name: "controls.csv", type: "text/csv", text: () => asCsv(plans) },
  { label: "Plan as JSON", name: "plan.json", type: "application/json", text: () => asJson(plans) },
];

export const withdrawShare = () => place.replaceChildren();

function snippet(name, text) {
  const written = h("pre", { tabindex: 0, "aria-label": name }, text);
  const say = (word) => {
    copy.textContent = word;
    setTimeout(() => { copy.textContent = `Copy as ${name}`; }, 1500);
  };
  const copy = h("button", { type: "button", onclick: async () => {
    if (navigator.clipboard) {
      await navigator.clipboard.writeText(text);
      say("Copied");
    } else { // over plain HTTP from elsewhere browsers have none
      getSelection().selectAllChildren(written);
      say("Selected: copy it");
    }
  } }, `Copy as ${name}`);
  return h("div", { class: "snippet" }, written, copy);
}

export function asCurl({ path, body }) {
  const key = hasKey() ? " \\\n  -H \"Authorization: Bearer $BREAKAWAY_API_KEY\"" : "";
  const text = JSON.stringify(body).replaceAll("'", "'\\''");
  return `curl -s ${address(path)} -H 'Content-Type: application/json'${key} \\\n  -d '${text}'`;
}

/** Of the Python client: what a request is, and what of its answer is printed. */
const CALLS = {
  plan: ["PlanRequest", "controls"],
  plan_multistep: ["MultistepPlanRequest", "controls"],
  simulate: ["SimulateRequest", "runs[0].final_state"],
  identify: ["IdentifyRequest", "parameters"],
};

export function asPython(asked) {
  const kinds = [...new Set(asked.map(({ path }) => CALLS[path][0]))].sort();
  const key = hasKey() ? ', api_key=os.environ["BREAKAWAY_API_KEY"]' : "";
  const calls = asked.map(({ path, body }) => {
    const [kind, printed] = CALLS[path];
    const fields = Object.entries(body).map(([name, value]) => `        ${name}=${literal(value)},`);
    return `    answer = planner.${path}(${kind}(\n${fields.join("\n")}\n    ))\n    print(answer.${printed})`;
  });
  return [
    ...(hasKey() ? ["import os", ""] : []),
    `from app.client import ${["PlannerClient", ...kinds].sort().join(", ")}`, "",
    `with PlannerClient("${address("").replace(/\/$/, "")}"${key}) as planner:`,
    ...calls,
  ].join("\n");
}

/** Write a JSON value as Python has it. */
function literal(value) {
  if (value === null) return "None";
  if (typeof value === "boolean") return value ? "True" : "False";
  if (Array.isArray(value)) return `[${value.map(literal).join(", ")}]`;
  if (typeof value === "object") return `{${Object.entries(value).map(([name, item]) => `"${name}": ${literal(item)}`).join(", ")}}`;
  return JSON.stringify(value);
}

function asCsv(plans) {
  const rows = ["plan,step,time_s,position,velocity,control"];
  for (const { name, plan } of plans) {
    plan.states.forEach(([position, velocity], k) => {
      rows.push([name, k, Number((k * plan.system.time_step).toPrecision(12)), position, velocity, plan.controls[k] ?? ""].join(","));
    });
  }
  return `${rows.join("\n")}\n`;
}

const FOR_THE_EYE = ["candidates", "candidate_errors", "reachable_set", "denoising"];

function asJson(plans) {
  const bare = plans.map(({ name, plan }) => [
    name,
    Object.fromEntries(Object.entries(plan).filter(([field]) => !FOR_THE_EYE.includes(field))),
  ]);
  return JSON.stringify(bare.length === 1 ? bare[0][1] : Object.fromEntries(bare), null, 1);
}

function save({ name, type, text }) {
  const url = URL.createObjectURL(new Blob([text()], { type }));
  h("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
