// A chart by uPlot: its axes, scales, lines and cursor; what lies under the lines is drawn in layers.

import uPlot from "../vendor/uplot/uPlot.esm.js";
import { h, tenTo } from "../dom.js";
import { colour, themes } from "./colours.js";

const charts = new Set();

themes.addEventListener("change", () => { for (const chart of charts) if (chart.isShown) chart.build(); });

const LEAST = 1e-9;

/** Range of values with some air. Around one value alone it is as wide as that is large, or 1: nobody reads an axis of noise. */
export function around(low, high, air = 0.06) {
  const width = high - low;
  const size = Math.max(Math.abs(low), Math.abs(high));
  if (width < Math.max(LEAST, 1e-6 * size)) {
    const half = (size < LEAST ? 1 : size) / 2;
    return [low - half, high + half];
  }
  return [low - air * width, high + air * width];
}

export function extent(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

/** Draw a line through (xs[i], ys[i]) of a chart's values. */
export function trace(u, xs, ys, { stepped = false, close = false, path = new Path2D() } = {}) {
  for (let i = 0; i < xs.length; i += 1) {
    const x = u.valToPos(xs[i], "x", true);
    const y = u.valToPos(ys[i], "y", true);
    if (i === 0) path.moveTo(x, y);
    else {
      if (stepped) path.lineTo(x, u.valToPos(ys[i - 1], "y", true));
      path.lineTo(x, y);
    }
  }
  if (close) path.closePath();
  return path;
}

export class Chart {
  /**
   * @param label what it shows, in words
   * @param x, y {label, log}: the axes
   * @param lines [{label, colour, stepped, width, dash, points}], for the data after the x values
   * @param height a class of the style sheet: "low", "high"
   * @param seek called with the x value that is pointed at
   * @param role "group" where there is something to use within
   */
  constructor({ label, x, y, lines = [], height = "low", seek = null, role = "img" }) {
    this.options = { label, x, y, lines, seek };
    this.area = h("div", { class: `plot ${height}`, role, "aria-label": label });
    this.element = h("figure", { class: "chart" }, h("figcaption", {}, label), this.area);
    const empty = ({ log }) => (log ? [0.1, 1] : [0, 1]);
    this.content = { x: empty(x), y: empty(y), data: [empty(x), ...lines.map(() => [null, null])], under: [], over: [] };
    this.playhead = h("div", { class: "playhead hidden" });
    this.isShown = false;
    charts.add(this);
    new ResizeObserver(() => this.resize()).observe(this.area);
  }

  /** Show data [xs, ys of each line], within ranges x and y; under and over are layers (ctx, u). */
  show({ x, y, data, under = [], over = [], summary }) {
    this.content = { x, y, data: data ?? [[x[0], x[1]], ...this.options.lines.map(() => [null, null])], under, over };
    if (summary) this.area.setAttribute("aria-label", `${this.options.label}: ${summary}`);
    if (this.plot) this.plot.setData(this.content.data);
    else this.build();
  }

  /** Put the vertical line of the moment at an x value. */
  mark(x) {
    this.moment = x;
    if (!this.plot) return;
    const left = this.plot.valToPos(x, "x");
    this.playhead.classList.toggle("hidden", !(left >= 0 && left <= this.plot.over.clientWidth + 1));
    this.playhead.style.transform = `translateX(${left}px)`;
  }

  /** What lies over the plot is placed once scales and size are settled. */
  placed() {
    if (this.moment !== undefined) this.mark(this.moment);
    this.onplaced?.();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.area;
    if (!width) return;
    if (this.plot) this.plot.setSize({ width, height });
    else this.build();
  }

  build() {
    const { clientWidth: width, clientHeight: height } = this.area;
    if (!width) return;
    this.plot?.destroy();
    this.isShown = true;
    const { x, y, lines, seek } = this.options;
    const axis = ({ label, log }, isX) => ({
      stroke: colour("faint-text"), label, labelSize: 18, labelFont: "12px system-ui", font: "12px system-ui",
      size: isX ? 24 : 52, gap: 4, space: isX ? 50 : spaceBetween, labelGap: isX ? -2 : 2,
      grid: { stroke: colour("grid"), width: 1, ...(log && { filter: powersOnly }) },
      ticks: { stroke: colour("grid"), width: 1, size: 4, ...(log && { filter: powersOnly }) },
      values: log ? (u, values) => values.map((value) => (value === null ? "" : powers(value))) : (u, values) => values.map((value) => String(Number(value.toPrecision(6))).replace("-", "−")),
    });
    const layers = (name) => (u) => {
      const { ctx } = u;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      for (const layer of this.content[name]) layer(ctx, u, devicePixelRatio);
      ctx.restore();
    };
    this.plot = new uPlot({
      width, height,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false }, x: false, y: false },
      padding: [8, 14, 0, 0],
      scales: {
        x: { time: false, distr: x.log ? 3 : 1, range: () => this.content.x },
        y: { distr: y.log ? 3 : 1, range: () => this.content.y },
      },
      axes: [axis(x, true), axis(y, false)],
      series: [{}, ...lines.map((line) => ({
        label: line.label, stroke: () => colour(line.colour), width: line.width ?? 2, dash: line.dash,
        points: { show: false }, paths: line.stepped ? uPlot.paths.stepped({ align: 1 }) : undefined, spanGaps: false,
      }))],
      hooks: { drawAxes: [layers("under")], draw: [layers("over"), () => this.placed()] },
    }, this.content.data, this.area);
    this.plot.over.append(this.playhead);
    if (seek) {
      this.plot.over.addEventListener("pointerdown", (event) => {
        const move = (moved) => seek(this.plot.posToVal(moved.clientX - this.plot.over.getBoundingClientRect().left, "x"));
        move(event);
        this.plot.over.setPointerCapture(event.pointerId);
        this.plot.over.onpointermove = move;
        this.plot.over.onpointerup = () => { this.plot.over.onpointermove = null; };
      });
    }
    this.onbuild?.(this.plot);
  }
}

/** Between numbers beside a chart of a height, pixels: a low one has some, too. */
const spaceBetween = (u, index, low, high, height) => Math.max(18, Math.min(30, height / 4));
const isPower = (value) => Math.abs(Math.log10(value) - Math.round(Math.log10(value))) < 1e-6;
const powersOnly = (u, splits) => splits.map((value) => (value !== null && isPower(value) ? value : null));
const powers = (value) => {
  if (!isPower(value)) return "";
  const power = Math.round(Math.log10(value));
  return power >= -2 && power <= 3 ? String(10 ** power) : tenTo(power);
};
