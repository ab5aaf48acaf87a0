// What lies under and over the lines of a chart: bundles of candidates, bands, marks.

import { colour, rankColour } from "./colours.js";
import { trace } from "./chart.js";

/** Many lines ys[i] over xs, faint and coloured by their rank, the best on top. */
export function bundle(xs, lines, errors, { stepped = false, xsOf = () => xs } = {}) {
  const order = [...lines.keys()].sort((a, b) => errors[b] - errors[a]);
  return (ctx, u, ratio) => {
    ctx.lineWidth = ratio;
    ctx.globalAlpha = Math.max(0.16, Math.min(0.6, 12 / lines.length));
    order.forEach((index, place) => {
      ctx.strokeStyle = rankColour(1 - (place + 1) / order.length);
      ctx.stroke(trace(u, xsOf(index), lines[index], { stepped }));
    });
    ctx.globalAlpha = 1;
  };
}

/** Many lines of one colour. */
export const fan = (xs, lines, name) => (ctx, u, ratio) => {
  ctx.lineWidth = ratio;
  ctx.globalAlpha = 0.4;
  ctx.strokeStyle = colour(name);
  for (const line of lines) ctx.stroke(trace(u, xs, line));
  ctx.globalAlpha = 1;
};

/** Many lines of one colour, each over xs of its own. */
export const strands = (xs, lines, name) => (ctx, u, ratio) => {
  ctx.lineWidth = 1.5 * ratio;
  ctx.strokeStyle = colour(name);
  lines.forEach((line, index) => ctx.stroke(trace(u, xs[index], line)));
};

/** A band between two y values. */
export const band = (low, high, name) => (ctx, u) => {
  const top = u.valToPos(high, "y", true);
  ctx.fillStyle = colour(name);
  ctx.fillRect(u.bbox.left, top, u.bbox.width, u.valToPos(low, "y", true) - top);
};

/** The area between two lines over xs; where there is none of them, it is null. */
export const area = (xs, low, high, name) => (ctx, u) => {
  const known = [...xs.keys()].filter((k) => low[k] !== null);
  const back = known.toReversed();
  ctx.fillStyle = colour(name);
  ctx.fill(trace(u, [...known, ...back].map((k) => xs[k]), [...known.map((k) => low[k]), ...back.map((k) => high[k])], { close: true }));
};

/** A dashed horizontal or vertical line. */
export const rule = (value, name, { vertical = false, dash = [5, 4] } = {}) => (ctx, u, ratio) => {
  const { left, top, width, height } = u.bbox;
  const at = u.valToPos(value, vertical ? "x" : "y", true);
  ctx.strokeStyle = colour(name);
  ctx.lineWidth = 1.5 * ratio;
  ctx.setLineDash(dash.map((part) => part * ratio));
  ctx.beginPath();
  if (vertical) { ctx.moveTo(at, top); ctx.lineTo(at, top + height); }
  else { ctx.moveTo(left, at); ctx.lineTo(left + width, at); }
  ctx.stroke();
  ctx.setLineDash([]);
};

/** Bars at the foot of a chart, from x to x + width. */
export const rug = (xs, width, name) => (ctx, u, ratio) => {
  const foot = u.bbox.top + u.bbox.height;
  ctx.fillStyle = colour(name);
  for (const x of xs) {
    const left = u.valToPos(x, "x", true);
    ctx.fillRect(left, foot - 6 * ratio, u.valToPos(x + width, "x", true) - left, 6 * ratio);
  }
};

/** The reachable set: an area, and where in it the mass can be at rest. */
export const reachable = (set) => (ctx, u, ratio) => {
  const path = new Path2D();
  for (const polygon of set.polygons) {
    trace(u, polygon.map((corner) => corner[0]), polygon.map((corner) => corner[1]), { close: true, path });
  }
  ctx.fillStyle = colour("reachable");
  ctx.fill(path);
  const rest = new Path2D();
  for (const [low, high] of set.at_rest) trace(u, [low, high], [0, 0], { path: rest });
  ctx.strokeStyle = colour("at-rest");
  ctx.lineWidth = 3 * ratio;
  ctx.stroke(rest);
};

/** The gap between a target and the nearest state that can be reached. */
export const shortfall = (target, nearest) => (ctx, u, ratio) => {
  ctx.strokeStyle = colour("bad");
  ctx.lineWidth = 1.5 * ratio;
  ctx.setLineDash([3 * ratio, 3 * ratio]);
  ctx.stroke(trace(u, [target[0], nearest[0]], [target[1], nearest[1]]));
  ctx.setLineDash([]);
  ctx.fillStyle = colour("bad");
  ctx.beginPath();
  ctx.arc(u.valToPos(nearest[0], "x", true), u.valToPos(nearest[1], "y", true), 4 * ratio, 0, 7);
  ctx.fill();
};

/** A line through states. */
export const path = (states, name, width = 2.5) => (ctx, u, ratio) => {
  ctx.strokeStyle = colour(name);
  ctx.lineWidth = width * ratio;
  ctx.lineJoin = "round";
  ctx.stroke(trace(u, states.map((state) => state[0]), states.map((state) => state[1])));
};
