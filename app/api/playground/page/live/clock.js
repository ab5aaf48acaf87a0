// Even time in a browser: a step when it is due, and how many could not be done when they were.

const LEAST_MS = 20;
/** Shorter steps than this no page keeps up: such a machine is shown in slow motion. */

export const periodOf = (timeStep) => Math.max(1e3 * timeStep, LEAST_MS);

/**
 * Call tick(missed) every period until a signal says so; missed are those before it that were not called.
 * Rejects with what the signal says, or what a tick throws.
 */
export function everyPeriod(period, signal, tick) {
  return new Promise((_, reject) => {
    let due = performance.now() + period;
    let timer = null;
    const next = () => {
      const now = performance.now();
      const missed = Math.max(0, Math.floor((now - due) / period));
      due += (missed + 1) * period;
      try { tick(missed); } catch (error) { reject(error); return; }
      timer = setTimeout(next, due - performance.now());
    };
    timer = setTimeout(next, period);
    signal.addEventListener("abort", () => { clearTimeout(timer); reject(signal.reason); }, { once: true });
  });
}
