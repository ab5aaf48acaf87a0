// Columns of a log: which is what, and in which unit. The names and units are those of `breakaway identify`.

import { LogProblem } from "./problem.js";

export const ROLES = {
  time: ["time", "t", "timestamp"],
  control: ["control", "controls", "u", "command", "input", "force", "voltage", "current"],
  position: ["position", "positions", "p", "x", "y", "angle", "q"],
  velocity: ["velocity", "velocities", "v", "speed", "xd", "qd"],
};
const TURN = 2 * Math.PI;
const LENGTHS = { m: 1, cm: 1e-2, mm: 1e-3, um: 1e-6, rad: 1, deg: TURN / 360, rev: TURN };
const TIMES = { s: 1, ms: 1e-3, us: 1e-6 };
export const UNITS = {
  time: TIMES,
  position: LENGTHS,
  velocity: {
    ...Object.fromEntries(Object.entries(LENGTHS).flatMap(([length, a]) => Object.entries(TIMES).map(([time, b]) => [`${length}/${time}`, a / b]))),
    rpm: TURN / 60,
  },
};
/** What each is in SI; a control may be in any unit. */
const HEADING = /^(?<name>.*?)\s*[[(](?<unit>[^\])]*)[\])]$|^(?<stem>.+)_(?<suffix>[^_]+)$/;

/** Return the name of a column and the unit in its heading, as in `position [mm]`, `t_ms`. */
export function split(heading) {
  const { groups } = heading.match(HEADING) ?? {};
  return groups ? [groups.name || groups.stem, groups.unit || groups.suffix || ""] : [heading, ""];
}

/** Say whether a heading names a role. */
export const isNamed = (role, heading) => [heading, split(heading)[0]].some((name) => ROLES[role].includes(name.toLowerCase()));

/**
 * Return the column of a role as {name, unit, isStated, values}, values in SI units, or null.
 * @param columns values by heading
 * @param chosen {name, unit}, as far as somebody chose; "none" is no column
 */
export function find(role, columns, { name = "", unit = "" } = {}) {
  if (name === "none") return null;
  if (name) {
    if (!(name in columns)) throw new LogProblem(role, `there is no column '${name}'; there are ${Object.keys(columns).join(", ")}`);
    const headed = split(name)[1];
    return inSi(role, name, unit || (UNITS[role] && !(headed in UNITS[role]) ? "" : headed), columns[name]);
  }
  const heading = Object.keys(columns).find((one) => isNamed(role, one));
  return heading === undefined ? null : inSi(role, heading, unit || split(heading)[1], columns[heading]);
}

function inSi(role, name, unit, values) {
  const wrong = [...values.keys()].filter((row) => !Number.isFinite(values[row]));
  if (wrong.length) {
    throw new LogProblem(role, `${name} has ${wrong.length} values that are no finite numbers, the first in row ${wrong[0] + 1}`);
  }
  const units = UNITS[role];
  if (!units) return { name, unit, isStated: true, values };
  if (!unit) return { name, unit: Object.keys(units)[0], isStated: false, values };
  if (!(unit in units)) throw new LogProblem(role, `${name}: the unit '${unit}' is none of ${Object.keys(units).join(", ")}`);
  return { name, unit, isStated: true, values: values.map((value) => units[unit] * value) };
}
