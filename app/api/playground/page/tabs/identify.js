// Your machine: from a log of it to its plant, and how sure that is; one click plans with it.

import { get, set } from "../address.js";
import { ask } from "../api.js";
import { section } from "../controls.js";
import { distance, h, short } from "../dom.js";
import { choiceField, numberField } from "../fields.js";
import { isNamed, ROLES, UNITS } from "../log/columns.js";
import { Findings } from "../log/findings.js";
import { LogProblem } from "../log/problem.js";
import { columnsOf, readLog } from "../log/read.js";
import { NAME, sample } from "../log/sample.js";
import { number } from "../request.js";
import { offerShare } from "../share.js";

export const name = "identify";
export const title = "Your machine";
export const parts = [logPart, columnsPart, knownPart];

const POINTERS = { time: "/time_step", control: "/controls", position: "/positions", velocity: "/velocities" };
const CLEARED = ["time_step", ...Object.keys(ROLES).flatMap((role) => [`log.${role}`, `log.${role}.unit`])];

const MOST_WRITTEN = 20_000;
/** Characters of a log that is written out as a request. */

let log = null;
/** {name, text, columns}: the file stays in memory, the address has its name alone. */

/** Take a file: its columns are recognised anew. */
function take(file) {
  log = file;
  set({ ...Object.fromEntries(CLEARED.map((one) => [one, null])), log: file.name });
}

async function takeFile(file) {
  if (file) take({ name: file.name, text: await file.text() });
}

const trySample = (text = "Try a sample") => h("button", { type: "button", onclick: () => take({ name: NAME }) }, text);

function logPart() {
  const input = h("input", { id: "log-file", type: "file", accept: ".csv,.tsv,.txt,text/csv", "aria-describedby": "log-error log-hint", onchange: () => takeFile(input.files[0]) });
  const drop = h("div", {
    class: "field drop", "data-pointer": "/log",
    ondragover: (event) => { event.preventDefault(); drop.classList.add("over"); },
    ondragleave: () => drop.classList.remove("over"),
    ondrop: (event) => { event.preventDefault(); drop.classList.remove("over"); takeFile(event.dataTransfer.files[0]); },
  },
    h("label", { for: "log-file" }, "CSV file, or drop one here"), input,
    h("span", { class: "hint", id: "log-hint" }, get("log") ? `now: ${get("log")}` : "times, controls and positions of the machine in motion; it is sent to this service alone"),
    h("span", { class: "error", id: "log-error", role: "alert" }));
  return section("Log", drop, trySample());
}

function columnsPart() {
  const columns = Object.keys(log?.columns ?? {});
  const optional = ["time", "velocity"];
  const own = (role) => {
    const heading = columns.find((one) => isNamed(role, one));
    return heading ? `${heading} (by name)` : optional.includes(role) ? "none (by name)" : "by name";
  };
  return section("Columns", Object.keys(ROLES).map((role) => h("div", { class: "column-row" },
    choiceField({
      name: `log.${role}`, label: role[0].toUpperCase() + role.slice(1), pointer: POINTERS[role],
      choices: [["", own(role)], ...columns.map((one) => [one, one]), ...(optional.includes(role) ? [["none", "none"]] : [])],
    }),
    UNITS[role] ? choiceField({
      name: `log.${role}.unit`, label: h("span", {}, "Unit", h("span", { class: "unseen" }, ` of ${role}`)), pointer: "",
      choices: [["", "as headed"], ...Object.keys(UNITS[role]).map((unit) => [unit, unit])],
    }) : null)),
    numberField({ name: "time_step", label: "Time step, s", pointer: "", hint: "where no column has times" }));
}

function knownPart() {
  return section("What is known",
    numberField({ name: "known.control_limit", label: "Control limit", pointer: "/known", hint: "units of control; empty: the largest in the log" }),
    choiceField({ name: "direction", label: "Friction by direction", pointer: "/direction_dependent", choices: [["auto", "let the log say"], ["yes", "may differ"], ["no", "is the same"]] }),
    numberField({ name: "log_delay", label: "Delay, steps", pointer: "/delay_steps", hint: "of the actuator; empty: let the log say" }));
}

export function open(view) {
  const invitation = h("div", { class: "invitation" },
    h("p", { class: "verdict" }, "Record your machine's control and position while it moves, at even times: from rest slowly up to where it breaks away, then at several speeds, both ways. From that follows its friction, its gain, how sure they are, and what to record next."),
    h("p", {}, "The first row names the columns, with their units, as in ", h("code", {}, "time_s,voltage_V,position_mm"), "; any other names are chosen in the form."),
    h("p", {}, "Drop the file here, choose it in the form, or see what comes of a sample: ", trySample("See a sample")));
  view.replaceChildren(invitation);
  invitation.ondragover = (event) => event.preventDefault();
  invitation.ondrop = (event) => { event.preventDefault(); takeFile(event.dataTransfer.files[0]); };

  return async (signal) => {
    if (!get("log")) {
      view.replaceChildren(invitation);
      return "There is no log yet.";
    }
    if (get("log") === NAME && !(log?.name === NAME && log.text)) log = { name: NAME, text: await sample(signal) };
    if (log?.name !== get("log")) {
      throw new LogProblem("file", `choose ${get("log")} again: the address has its name alone`);
    }
    if (!log.columns) {
      log.columns = columnsOf(log.text);
      set({ log: log.name }); // builds the form anew, with these columns
      return "";
    }
    const chosen = Object.fromEntries(Object.keys(ROLES).map((role) => [role, { name: get(`log.${role}`), unit: get(`log.${role}.unit`) }]));
    const { fields, notes, found } = readLog(log.columns, chosen, number("time_step"));
    const options = { seed: 7, include: ["predictions"] };
    if (get("known.control_limit") !== "") options.known = { control_limit: number("known.control_limit") };
    if (get("direction") !== "auto") options.direction_dependent = get("direction") === "yes";
    if (get("log_delay") !== "") options.delay_steps = number("log_delay");
    const body = { ...fields, ...options };
    const answer = await ask("identify", body, signal);
    const unit = ["rad", "deg", "rev"].includes(found.position.unit) ? "rad" : "m";
    const findings = new Findings(unit, found.control.unit || "unit");
    findings.show({ fields, notes, answer });
    view.replaceChildren(findings.element);
    const isShort = log.text.length < MOST_WRITTEN;
    offerShare(isShort ? [{ path: "identify", body: { ...body, include: [] } }] : [], [
      { label: "Plant as JSON", name: "system.json", type: "application/json", text: () => JSON.stringify({ system: answer.system }, null, 1) },
      { label: "Log as CSV", name: log.name, type: "text/csv", text: () => log.text },
    ]);
    const { fit } = answer;
    return `Identified from ${fields.controls.length} samples in ${short(answer.timing_ms.total / 1e3, 2)} s; predicts ${short(fit.window_s, 2)} s ahead to ${distance(fit.end_error_rms, unit)}.`;
  };
}
