// One piece of work at a time: says that it runs, lets it be cancelled, comes back when the service
// is busy or away, and puts the service's words beside the field that they are about.

import { Problem, Unreachable } from "./api.js";
import { clearErrors, showError } from "./fields.js";

const QUIET_MS = 150;
const LONGEST_WAIT_S = 5;
const BUSY = [429, 503];

const status = document.getElementById("status");
const cancel = document.getElementById("cancel");
const problem = document.getElementById("problem");
let current = null;

export function say(text) {
  status.textContent = text;
}

/** Say of work that goes on until something else is done that it is under way: nothing is waited for. */
export function underWay(text) {
  current.settle();
  say(text);
}

export const isUnderWay = () => current?.isUnderWay ?? false;

/**
 * Run work(signal), which is text of what came of it; whatever was under way is given up.
 * Returns whether it came to its end.
 */
export async function run(what, work) {
  current?.abort();
  const own = new AbortController();
  let attempt = 0;
  current = own;
  clearErrors();
  problem.textContent = "";
  const begun = performance.now();
  const tick = () => {
    const seconds = (performance.now() - begun) / 1e3;
    say(`${what}… ${seconds < 1 ? "" : `${seconds.toFixed(0)} s`}`);
    cancel.classList.remove("hidden");
  };
  let timer = setTimeout(() => { tick(); timer = setInterval(tick, 1000); }, QUIET_MS);
  document.body.classList.add("busy");
  const stopTicking = () => { clearTimeout(timer); clearInterval(timer); };
  const rest = () => {
    stopTicking();
    cancel.classList.add("hidden");
    document.body.classList.remove("busy");
  };
  own.settle = () => { attempt = 0; own.isUnderWay = true; rest(); };
  try {
    for (;;) {
      try {
        const text = await work(own.signal);
        if (current !== own) return false;
        say(text);
        return true;
      } catch (error) {
        own.isUnderWay = false;
        if (!comesBack(error)) throw error;
        stopTicking();
        await wait(Math.min(LONGEST_WAIT_S, error.retryAfter ?? 0.5 * 2 ** attempt), error, own.signal);
        attempt += 1;
        say(`${what}…`);
      }
    }
  } catch (error) {
    if (current !== own) return false;
    if (own.signal.aborted) say("Cancelled; what is shown is from before.");
    else tell(error);
    return false;
  } finally {
    if (current === own) rest();
    else stopTicking();
  }
}

const comesBack = (error) => error instanceof Unreachable || (error instanceof Problem && BUSY.includes(error.status));

/** Say what is the matter until it is time to ask again. */
async function wait(seconds, error, signal) {
  const what = error instanceof Problem ? `${error.title}: ${error.message}` : error.message;
  cancel.classList.remove("hidden");
  say(`${what}. Asking again in ${seconds} s.`);
  await new Promise((resolve, reject) => {
    const timer = setTimeout(resolve, seconds * 1e3);
    signal.addEventListener("abort", () => { clearTimeout(timer); reject(signal.reason); }, { once: true });
  });
}

function tell(error) {
  if (!(error instanceof Problem)) throw error;
  say("There is no new plan; what is shown is from before.");
  const left = error.errors.filter(({ pointer, detail }) => !showError(pointer, detail));
  if (error.status === 401) showError("/key", error.message);
  else if (!error.errors.length) problem.textContent = `${error.title}: ${error.message}`;
  else problem.textContent = left.map(({ pointer, detail }) => `${pointer.slice(1) || "the request"}: ${detail}`).join("; ");
}

cancel.addEventListener("click", () => current?.abort());
