// The position-velocity plane: what can be reached, the plan, and two handles to drag.

import { h, short } from "../dom.js";
import { around, Chart, extent, trace } from "./chart.js";
import { rankColour } from "./colours.js";
import { path, reachable, shortfall } from "./layers.js";

const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const KEY_STEP = 0.01;

export class PhasePlane {
  /** @param moved called with "start" or "target" and the new state, as it is let go */
  constructor(unit, moved) {
    this.unit = unit;
    this.moved = moved;
    this.chart = new Chart({
      label: "Phase plane", height: "high", role: "group",
      x: { label: `position, ${unit}` }, y: { label: `velocity, ${unit}/s` },
    });
    this.element = this.chart.element;
    this.states = { start: [0, 0], target: [0, 0] };
    this.handles = { start: this.handle("start"), target: this.handle("target") };
    this.dot = h("div", { class: "dot hidden" });
    this.chart.onbuild = (plot) => {
      plot.over.append(this.dot, this.handles.start, this.handles.target);
    };
    this.chart.onplaced = () => this.place();
  }

  show({ start, target, plan }) {
    this.states = { start, target };
    const set = plan.reachable_set;
    const { candidates } = plan;
    const corners = [...set.polygons.flat(), ...set.at_rest.flat().map((position) => [position, 0]), ...plan.states, start, target];
    const under = [reachable(set)];
    if (candidates) under.push(candidatePaths(candidates));
    under.push(path(plan.states, "best"));
    if (!plan.reachability.reachable) under.push(shortfall(target, plan.reachability.nearest_state));
    this.chart.show({
      x: around(...extent(corners.map((corner) => corner[0]))),
      y: around(...extent(corners.map((corner) => corner[1]))),
      under,
      summary: `from ${this.words(start)} to ${this.words(plan.states.at(-1))}; the target is ${this.words(target)}`,
    });
  }

  /** Put the dot of the moment at a state. */
  mark(state) {
    this.moment = state;
    if (this.chart.plot) this.put(this.dot, state);
    this.dot.classList.remove("hidden");
  }

  words(state) {
    return `${short(state[0])} ${this.unit} at ${short(state[1])} ${this.unit}/s`;
  }

  place() {
    if (!this.chart.plot) return;
    for (const [name, state] of Object.entries(this.states)) {
      this.put(this.handles[name], state);
      this.handles[name].setAttribute("aria-label", `${name}: ${this.words(state)}. Drag it, or use the arrow keys.`);
    }
    if (this.moment) this.put(this.dot, this.moment);
  }

  put(element, state) {
    const { plot } = this.chart;
    element.style.transform = `translate(${plot.valToPos(state[0], "x")}px, ${plot.valToPos(state[1], "y")}px)`;
  }

  handle(name) {
    const button = h("button", { type: "button", class: `handle ${name}` }, h("span", {}, name));
    const scaled = (value, scale) => {
      const { min, max } = this.chart.plot.scales[scale];
      const digits = Math.max(0, 3 - Math.ceil(Math.log10(max - min)));
      return Number(Math.min(max, Math.max(min, value)).toFixed(digits));
    };
    const move = (event) => {
      const { plot } = this.chart;
      const area = plot.over.getBoundingClientRect();
      this.states[name] = [
        scaled(plot.posToVal(event.clientX - area.left, "x"), "x"),
        snapped(scaled(plot.posToVal(event.clientY - area.top, "y"), "y"), plot),
      ];
      this.place();
    };
    button.addEventListener("pointerdown", (event) => {
      button.setPointerCapture(event.pointerId);
      button.onpointermove = move;
      event.stopPropagation();
    });
    button.addEventListener("pointerup", () => {
      if (!button.onpointermove) return;
      button.onpointermove = null;
      this.moved(name, this.states[name]);
    });
    button.addEventListener("keydown", (event) => {
      const way = KEYS[event.key];
      if (!way) return;
      event.preventDefault();
      const { x, y } = this.chart.plot.scales;
      const state = this.states[name];
      this.states[name] = [
        scaled(state[0] + way[0] * KEY_STEP * (x.max - x.min), "x"),
        scaled(state[1] + way[1] * KEY_STEP * (y.max - y.min), "y"),
      ];
      this.place();
      this.moved(name, this.states[name]);
    });
    return button;
  }
}

const SNAP_PIXELS = 8;

/** Near the axis a state is at rest: that is what most targets are. */
const snapped = (velocity, plot) => (Math.abs(plot.valToPos(velocity, "y") - plot.valToPos(0, "y")) < SNAP_PIXELS ? 0 : velocity);

/** Lines of all candidates through the plane, the best on top. */
function candidatePaths({ states, terminal_errors: errors }) {
  const order = [...states.keys()].sort((a, b) => errors[b] - errors[a]);
  return (ctx, u, ratio) => {
    ctx.lineWidth = ratio;
    ctx.globalAlpha = Math.max(0.12, Math.min(0.5, 10 / states.length));
    order.forEach((index, place) => {
      ctx.strokeStyle = rankColour(1 - (place + 1) / order.length);
      ctx.stroke(trace(u, states[index].map((one) => one[0]), states[index].map((one) => one[1])));
    });
    ctx.globalAlpha = 1;
  };
}
