// One controller with a machine of its own: it measures, asks, and does what it is told.

import { Machine } from "./machine.js";
import { Session } from "../session.js";

export class Lane {
  constructor(title) {
    this.title = title;
    this.machine = new Machine();
    this.energy = 0;
    this.roundTripMs = null;
    this.observerError = null;
    this.answer = null;
  }

  /** Open a session, which goes on where the one before left off if it believed the same. */
  async connect({ goal, model, controller, delay }, signal) {
    this.machine.delay(delay);
    const believed = JSON.stringify(model);
    if (believed !== this.believed) this.carry = null;
    this.believed = believed;
    this.goal = goal;
    this.isWaiting = false;
    const start = {
      target_state: [goal, 0], system: model, controller,
      pending_controls: this.machine.queue, include: ["estimate", "carry"],
      ...(this.carry && { resume: this.carry }),
    };
    this.session = await Session.open(start, signal);
  }

  /** Let the machine go on for a step under what it was told. */
  advance(plant, push) {
    this.machine.advance(plant, push);
    this.energy += this.machine.acting ** 2;
  }

  /** Tell the session what is measured, and where to go if that has changed. Rejects as the session does. */
  async measure(goal, noise, draws) {
    this.isWaiting = true;
    if (goal !== this.goal) {
      await this.session.ask({ type: "target", target_state: [goal, 0] });
      this.goal = goal;
    }
    const begun = performance.now();
    const [position] = this.machine.state;
    const answer = await this.session.ask({ type: "measure", ...this.machine.measure(noise, draws) });
    this.roundTripMs = performance.now() - begun;
    this.observerError = Math.abs(answer.estimate.position - position);
    this.machine.control = answer.control;
    this.carry = answer.carry;
    this.answer = answer;
    this.isWaiting = false;
  }
}
