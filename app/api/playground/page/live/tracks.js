// Machines on their tracks, one above the other: masses to push, a target to move.

import { h, short } from "../dom.js";
import { marks, svg } from "../svg.js";

const ROW = 76;
const TOP = 62;
const PIXELS_OF_FULL = 90;
/** A mass that is pulled so far is pushed as hard as full control does; twice as far, twice as hard. */
const HARDEST = 3;
const LEAST_PUSH_MS = 250;

export class Tracks {
  /**
   * @param titles of the tracks, from above
   * @param unit of positions
   * @param aim called with a position that is pointed at
   */
  constructor(titles, unit, aim) {
    this.unit = unit;
    this.held = 0;
    this.rows = titles.map((title, index) => this.row(title, index));
    this.ticks = svg("g", { class: "ticks" });
    this.flags = svg("g", {});
    this.picture = svg("svg", { class: "tracks", "aria-hidden": "true" }, this.ticks, this.flags, ...this.rows.map(({ element }) => element));
    this.picture.style.height = `${TOP + ROW * (titles.length - 1) + 34}px`;
    this.picture.addEventListener("pointerup", (event) => {
      if (!this.x || event.target.closest(".machine")) return;
      aim(Number(this.positionAt(event).toPrecision(2)));
    });
    new ResizeObserver(() => { if (this.span) this.draw(); }).observe(this.picture);
  }

  row(title, index) {
    const ground = TOP + ROW * index;
    const mass = svg("rect", { class: "mass", x: -22, y: ground - 36, width: 44, height: 36, rx: 3 });
    const arrow = svg("path", { class: "push" });
    const band = svg("path", { class: "pulled" });
    const body = svg("g", { class: "machine" }, mass, arrow);
    const name = svg("text", { class: "name", x: 8, y: ground - 42 }, title);
    const element = svg("g", {}, svg("path", { class: "rail", d: `M0 ${ground}H4000` }), name, band, body);
    body.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      body.setPointerCapture(event.pointerId);
      body.onpointermove = (moved) => { this.pointed = { index, at: moved.clientX - this.picture.getBoundingClientRect().left }; };
      body.onpointermove(event);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      body.addEventListener(end, () => { body.onpointermove = null; this.pointed = null; });
    }
    return { ground, mass, arrow, band, body, element, name };
  }

  rename(titles) {
    titles.forEach((title, index) => { this.rows[index].name.textContent = title; });
  }

  /** Two buttons that push for as long as they are held, by pointer or key. */
  buttons() {
    return [[-1, "◀ Push"], [1, "Push ▶"]].map(([way, text]) => {
      let begun = null;
      const press = () => { if (begun === null) { begun = performance.now(); this.held = way * 1.5; } };
      const release = () => {
        if (begun === null) return;
        setTimeout(() => { this.held = 0; }, LEAST_PUSH_MS - (performance.now() - begun));
        begun = null;
      };
      const isPress = (event) => event.key === " " || event.key === "Enter";
      return h("button", {
        type: "button", class: "pushing", "aria-label": way < 0 ? "Push both masses backward" : "Push both masses forward",
        onpointerdown: press, onpointerup: release, onpointerleave: release, onpointercancel: release, onblur: release,
        onkeydown: (event) => { if (isPress(event)) press(); },
        onkeyup: (event) => { if (isPress(event)) release(); },
        onclick: (event) => { if (event.detail === 0 && !this.held) { press(); release(); } },
      }, text);
    });
  }

  /** How hard all masses are pushed, as a share of what full control does to them. */
  get push() {
    if (!this.pointed) return this.held;
    const { index, at } = this.pointed;
    return Math.max(-HARDEST, Math.min(HARDEST, (at - this.rows[index].at) / PIXELS_OF_FULL));
  }

  /** Show positions [low, high] and a target. */
  place(span, target) {
    Object.assign(this, { span, target });
    this.draw();
  }

  draw() {
    const [low, high] = this.span;
    const width = this.picture.clientWidth || 1000;
    this.x = (position) => 40 + ((position - low) / (high - low)) * (width - 80);
    this.positionAt = (event) => low + ((event.clientX - this.picture.getBoundingClientRect().left - 40) / (width - 80)) * (high - low);
    this.shown = null;
    this.flags.replaceChildren(...this.rows.map(({ ground }) => svg("path", { class: "flag", d: `M${this.x(this.target)} ${ground}v-44l14 7l-14 7` })));
    this.ticks.replaceChildren(...marks(this.span, width, this.x, this.rows.at(-1).ground, short));
  }

  /** Show where the masses are now, as machines [{position, share of full control, stuck}]. */
  show(machines) {
    const { push } = this;
    const shown = JSON.stringify([machines, push]);
    if (shown === this.shown) return;
    this.shown = shown;
    machines.forEach(({ position, share, stuck }, index) => {
      const { ground, mass, arrow, band, body } = this.rows[index];
      const at = this.x(position);
      this.rows[index].at = at;
      const tip = 60 * share;
      const way = Math.sign(tip);
      body.setAttribute("transform", `translate(${at.toFixed(1)} 0)`);
      arrow.setAttribute("d", Math.abs(tip) < 2 ? "" : `M${way * 24} ${ground - 18}h${tip}m${-8 * way} -6l${8 * way} 6l${-8 * way} 6`);
      arrow.setAttribute("class", stuck ? "push weak" : "push");
      mass.setAttribute("class", stuck ? "mass stuck" : "mass");
      band.setAttribute("d", push ? `M${at} ${ground - 44}h${push * PIXELS_OF_FULL}` : "");
    });
  }
}
