// A simulated machine, which no controller knows: its friction, its sensor's noise, its actuator's delay.

import { takeStep } from "../plant.js";

export class Machine {
  constructor() {
    this.state = [0, 0];
    this.before = [0, 0];
    this.control = 0;
    this.acting = 0;
    this.queue = [];
  }

  /** Have controls act so many steps later; those that are on their way stay. */
  delay(steps) {
    while (this.queue.length < steps) this.queue.unshift(0);
    this.queue.splice(0, this.queue.length - steps);
  }

  /** Go on for a step of a plant, under the last control and a push, m/s². */
  advance(plant, push) {
    this.queue.push(this.control);
    this.acting = this.queue.shift();
    this.before = this.state;
    this.state = takeStep(plant, this.state, this.acting + push / plant.control_gain);
  }

  /** Return what a sensor says; draws are two of a normal distribution, noise is that of positions. */
  measure(noise, draws) {
    return { position: this.state[0] + noise * draws[0], velocity: this.state[1] + VELOCITY_NOISE * noise * draws[1] };
  }
}

export const VELOCITY_NOISE = 10;
/** Of velocities, as a multiple of that of positions: a velocity is told to ten times as much a second. */

/** Draw two numbers of a normal distribution (Box and Muller). */
export function normal() {
  const radius = Math.sqrt(-2 * Math.log(1 - Math.random()));
  const angle = 2 * Math.PI * Math.random();
  return [radius * Math.cos(angle), radius * Math.sin(angle)];
}
