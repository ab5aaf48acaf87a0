// The same requests elsewhere: as curl, as Python, and what came of them as files.

import { address, hasKey } from "./api.js";
import { h } from "./dom.js";

const place = document.getElementById("share");

/**
 * Offer what was asked and answered.
 * @param asked [{path, body}]
 * @param plans [{name, plan}], for the files
 */
export function offerShare(asked, plans) {
  place.replaceChildren(
    h("details", {},
      h("summary", {}, "The same request elsewhere"),
      snippet("curl", asked.map(asCurl).join("\n\n")),
      snippet("Python", asPython(asked)),
    ),
    h("div", { class: "files" },
      h("button", { type: "button", onclick: () => save("controls.csv", "text/csv", asCsv(plans)) }, "Controls as CSV"),
      h("button", { type: "button", onclick: () => save("plan.json", "application/json", asJson(plans)) }, "Plan as JSON"),
    ),
  );
}

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

const CALLS = { plan: ["PlanRequest", "plan"], plan_multistep: ["MultistepPlanRequest", "plan_multistep"] };

export function asPython(asked) {
  const kinds = [...new Set(asked.map(({ path }) => CALLS[path][0]))].sort();
  const key = hasKey() ? ', api_key=os.environ["BREAKAWAY_API_KEY"]' : "";
  const calls = asked.map(({ path, body }) => {
    const [kind, call] = CALLS[path];
    const fields = Object.entries(body).map(([name, value]) => `        ${name}=${literal(value)},`);
    return `    answer = planner.${call}(${kind}(\n${fields.join("\n")}\n    ))\n    print(answer.controls)`;
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

function save(name, type, text) {
  const url = URL.createObjectURL(new Blob([text], { type }));
  h("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
