// A log as text of a CSV file: its columns, and what `/identify` is asked with them.

import { dsvFormat } from "../vendor/d3-dsv/d3-dsv.mjs";
import { atEvenTimes } from "./even_times.js";
import { find, ROLES } from "./columns.js";
import { LogProblem } from "./problem.js";

const DELIMITERS = [",", ";", "\t", " "];

/** Return the values of a file's columns by heading; what is no number is NaN. */
export function columnsOf(text) {
  const lines = text.replace(/^\uFEFF/, "").split(/\r?\n/).map((line) => line.split("#")[0].trim()).filter(Boolean);
  if (!lines.length) throw new LogProblem("file", "the file is empty");
  if (text.includes("\0")) throw new LogProblem("file", "the file is no text: columns of numbers by name are, as CSV");
  const delimiter = DELIMITERS.find((one) => lines[0].includes(one));
  if (!delimiter) throw new LogProblem("file", "the file has one column only; a log has controls and positions at least, divided by commas");
  const rows = dsvFormat(delimiter).parseRows(lines.join("\n")).map((row) => row.map((cell) => cell.trim()));
  const isHeaded = !rows[0].every((cell) => cell !== "" && Number.isFinite(Number(cell)));
  const headings = isHeaded ? rows.shift() : rows[0].map((_, index) => String(index));
  const long = rows.findIndex((row) => row.length > headings.length);
  if (long >= 0) {
    throw new LogProblem("file", `row ${long + 1} has ${rows[long].length} values, where there are ${headings.length} columns`);
  }
  if (rows.length < 2) throw new LogProblem("file", "the file has no rows of numbers below its headings");
  return Object.fromEntries(headings.map((heading, index) => [heading, rows.map((row) => (row[index] ? Number(row[index]) : NaN))]));
}

/**
 * Return {fields of the request, notes, found columns by role}.
 * @param columns values by heading
 * @param chosen by role {name, unit}, as far as somebody chose
 * @param timeStep s, where no column has times
 */
export function readLog(columns, chosen = {}, timeStep = undefined) {
  const found = Object.fromEntries(Object.keys(ROLES).map((role) => [role, find(role, columns, chosen[role])]));
  const thereAre = `there are ${Object.keys(columns).join(", ")}`;
  for (const role of ["control", "position"]) {
    if (!found[role]) throw new LogProblem(role, `no column is a ${role}; ${thereAre}; choose one`);
  }
  const notes = Object.entries(found)
    .filter(([role, column]) => column && role !== "control" && !column.isStated)
    .map(([role, column]) => `${column.name} is taken as ${role} in ${column.unit}`);
  let series = Object.fromEntries(Object.entries(found).filter(([role, column]) => column && role !== "time").map(([role, column]) => [role, column.values]));
  let step = timeStep;
  if (step === undefined) {
    if (!found.time) throw new LogProblem("time", `no column has times; ${thereAre}; choose one, or give the time step`);
    const even = atEvenTimes(found.time.values, series);
    ({ step, series } = even);
    if (even.note) notes.push(even.note);
  }
  const fields = { time_step: step, controls: series.control, positions: series.position };
  if (series.velocity) fields.velocities = series.velocity;
  return { fields, notes, found };
}
