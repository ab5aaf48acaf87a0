// Samples at even times, as the service takes them, from what was sampled nearly so.

import { LogProblem } from "./problem.js";

const JITTER = 0.02;
/** By what share time steps may differ to count as even. */
const MOST_JITTER = 0.6;
/** By more, samples are missing. */
const GAP = 5;
/** Time steps; a longer one divides two logs. */

const general = (value, digits = 6) => String(Number(value.toPrecision(digits)));

/** Return {step, series, note}: the time step, and the series by role at even times. */
export function atEvenTimes(times, series) {
  const steps = times.slice(1).map((time, index) => time - times[index]);
  const usual = median(steps);
  if (usual < 0) throw new LogProblem("time", "time runs backwards: is the newest sample the first?");
  const still = steps.findIndex((step) => step <= 0);
  if (still >= 0) {
    throw new LogProblem("time", `time does not go on from ${general(times[still])} to ${general(times[still + 1])} s, row ${still + 1}: is it two logs in one?`);
  }
  const [longest, shortest] = [Math.max(...steps), Math.min(...steps)];
  if (longest > GAP * usual) {
    throw new LogProblem("time", `a gap of ${general(longest, 3)} s after row ${steps.indexOf(longest) + 1}, where ${general(usual, 3)} s are usual: it is two logs in one; give one of them`);
  }
  const off = Math.max(...steps.map((step) => Math.abs(step / usual - 1)));
  const even = (times.at(-1) - times[0]) / steps.length;
  if (off <= JITTER) return { step: even, series, note: null };
  if (off > MOST_JITTER) {
    throw new LogProblem("time", `time steps lie between ${general(shortest, 3)} and ${general(longest, 3)} s, too uneven to be taken at even times: samples are missing`);
  }
  const at = times.map((_, index) => times[0] + even * index);
  const before = [];
  for (let index = 0, last = 0; index < at.length; index += 1) {
    while (last + 1 < times.length && times[last + 1] <= at[index]) last += 1;
    before.push(last);
  }
  const between = (values) => at.map((time, index) => {
    const k = Math.min(before[index], times.length - 2);
    const share = Math.min(1, (time - times[k]) / (times[k + 1] - times[k]));
    return values[k] + share * (values[k + 1] - values[k]);
  });
  return {
    step: even,
    // A control holds until the next one; what is measured goes on meanwhile.
    series: Object.fromEntries(Object.entries(series).map(([role, values]) => [role, role === "control" ? before.map((k) => values[k]) : between(values)])),
    note: `time steps differ by up to ${Math.round(100 * off)}%; samples are taken at even ones of ${general(even, 4)} s`,
  };
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const half = Math.floor(sorted.length / 2);
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}
