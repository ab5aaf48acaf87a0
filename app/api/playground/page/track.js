// The mass on its track, in time with the charts: play, pause, scrub. It says in words what happens.

import { get, set } from "./address.js";
import { thresholds } from "./controls.js";
import { h, short } from "./dom.js";
import { marks, svg } from "./svg.js";
import { timesOf } from "./charts/motion.js";

const GROUND = 74;
const LONGEST_ARROW = 90;

export class Track {
  /** @param follow called with the time and the state that are shown */
  constructor(unit, controlUnit, follow) {
    Object.assign(this, { unit, controlUnit, follow, at: 0, plan: null });
    this.mass = svg("rect", { class: "mass", x: -22, y: GROUND - 36, width: 44, height: 36, rx: 3 });
    this.arrow = svg("path", { class: "push" });
    this.body = svg("g", {}, this.mass, this.arrow);
    this.flags = svg("g", {});
    this.ticks = svg("g", { class: "ticks" });
    this.picture = svg("svg", { class: "track", "aria-hidden": "true" },
      svg("path", { class: "rail", d: `M0 ${GROUND}H4000` }), this.ticks, this.flags, this.body);
    this.button = h("button", { type: "button", class: "play", onclick: () => this.toggle() }, "Play");
    this.slider = h("input", { type: "range", min: 0, max: 1, step: 1, value: 0, "aria-label": "Moment of the plan", oninput: () => this.seek(Number(this.slider.value) * this.step) });
    this.text = h("output", { class: "moment" });
    new ResizeObserver(() => { if (this.plan) this.draw(); }).observe(this.picture);
    this.element = h("div", { class: "trackbox" }, this.picture, h("div", { class: "transport" }, this.button, this.slider), this.text);
  }

  show(plan, targets, positions) {
    this.stop();
    this.plan = plan;
    this.step = plan.system.time_step;
    this.times = timesOf(plan.states.length, this.step);
    Object.assign(this, { targets, positions });
    this.slider.max = plan.controls.length;
    this.at = (Number(get("moment")) || 0) * this.step;
    this.draw();
  }

  /** Show the moment at a time because somebody asks for it: the address has it, too. */
  seek(time) {
    if (!this.plan) return;
    this.stop();
    this.go(time);
    set({ moment: Math.round(this.at / this.step) });
  }

  /** Draw the track as wide as it is, and the moment on it. */
  draw() {
    const { targets, positions: [low, high] } = this;
    const width = this.picture.clientWidth || 1000;
    this.x = (position) => 40 + ((position - low) / (high - low)) * (width - 80);
    this.flags.replaceChildren(...targets.map(({ position }) => svg("path", { class: "flag", d: `M${this.x(position)} ${GROUND}v-58l16 8l-16 8` })));
    this.ticks.replaceChildren(...marks(this.positions, width, this.x, GROUND, short));
    this.go(this.at);
  }

  /** Show the moment at a time. */
  go(time) {
    const { plan, step } = this;
    if (!plan) return;
    this.at = Math.min(Math.max(time, 0), this.times.at(-1));
    const exact = this.at / step;
    const k = Math.min(Math.floor(exact + 1e-9), plan.controls.length - 1);
    const share = exact - k;
    const [before, after] = [plan.states[k], plan.states[k + 1]];
    const state = [0, 1].map((index) => before[index] + share * (after[index] - before[index]));
    const control = plan.controls[k];
    const { forward, backward } = thresholds(plan.system);
    const rests = Math.abs(before[1]) < plan.system.velocity_threshold;
    const isWeak = control <= forward && control >= -backward;
    const scale = LONGEST_ARROW / Math.max(...plan.controls.map(Math.abs), 1e-9);
    const tip = control * scale;
    const way = Math.sign(tip);
    const root = way * 24;
    this.body.setAttribute("transform", `translate(${this.x(state[0])} 0)`);
    this.arrow.setAttribute("d", Math.abs(tip) < 2 ? "" : `M${root} ${GROUND - 18}h${tip}m${-8 * way} -6l${8 * way} 6l${-8 * way} 6`);
    this.arrow.setAttribute("class", rests && isWeak ? "push weak" : "push");
    this.mass.setAttribute("class", rests && isWeak ? "mass stuck" : "mass");
    const push = `${short(control)} ${this.controlUnit}`;
    const what = !rests ? "it slides" : isWeak ? `at rest: ${push} is within what static friction holds` : "it breaks away";
    this.text.textContent = `${this.at.toFixed(2)} s · ${short(state[0])} ${this.unit} · ${short(state[1])} ${this.unit}/s · push ${push} · ${what}`;
    this.slider.value = Math.round(exact);
    this.slider.setAttribute("aria-valuetext", this.text.textContent);
    this.follow(this.at, state);
  }

  toggle() {
    if (this.frame) this.seek(this.at);
    else this.play();
  }

  play() {
    if (!this.plan) return;
    this.button.textContent = "Pause";
    const end = this.times.at(-1);
    const from = this.at >= end - 1e-9 ? 0 : this.at;
    let begun = null;
    const next = (now) => {
      begun ??= now;
      const time = from + (now - begun) / 1e3;
      this.go(time);
      if (time < end && this.element.isConnected) this.frame = requestAnimationFrame(next);
      else this.seek(this.at);
    };
    this.frame = requestAnimationFrame(next);
  }

  stop() {
    cancelAnimationFrame(this.frame);
    this.frame = null;
    this.button.textContent = "Play";
  }
}
