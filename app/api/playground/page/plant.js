// The friction law, as the service has it: what a step does to a mass. A test compares the two.

import { backwardOf, forwardOf } from "./request.js";

/**
 * Return the state after a time step.
 * @param system the plant: fields of `system`
 * @param state [position, velocity]
 * @param control units of control
 */
export function takeStep(system, [position, velocity], control) {
  const { time_step: step, stribeck_velocity: stribeck, bias = 0 } = system;
  const accelerated = system.control_gain * control + bias;
  const rests = Math.abs(velocity) < system.velocity_threshold;
  const way = Math.sign(rests ? accelerated : velocity);
  const of = way > 0 ? forwardOf : backwardOf;
  const [hold, drag] = [of(system.static_friction), of(system.coulomb_friction)];
  let next;
  if (rests) {
    const breaksAway = Math.abs(accelerated) > hold;
    next = breaksAway ? velocity + step * (accelerated - way * (stribeck ? hold : drag)) : 0;
  } else {
    const excess = stribeck ? (hold - drag) * Math.exp(-((velocity / stribeck) ** 2)) : 0;
    next = velocity + step * (accelerated - way * (drag + excess) - of(system.viscous_damping) * velocity);
    if (next * way <= 0) next = 0; // friction stops a mass, it does not reverse it
  }
  return [position + step * next, next];
}

/** Return what a sliding mass loses to friction at a speed in a direction, m/s². */
export function frictionAt(system, speed, way) {
  const of = way > 0 ? forwardOf : backwardOf;
  const [hold, drag] = [of(system.static_friction), of(system.coulomb_friction)];
  const excess = system.stribeck_velocity ? (hold - drag) * Math.exp(-((speed / system.stribeck_velocity) ** 2)) : 0;
  return drag + excess + of(system.viscous_damping) * speed;
}
