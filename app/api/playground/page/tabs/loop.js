// Closed loop, live: two controllers, each with a machine that differs from what it believes.

import { get, set } from "../address.js";
import { around, Chart, extent } from "../charts/chart.js";
import { colour } from "../charts/colours.js";
import { band, rule } from "../charts/layers.js";
import { legend } from "../charts/legend.js";
import { easyTarget, limits, machinePart, section, thresholds } from "../controls.js";
import { distance, h, short } from "../dom.js";
import { choiceField, numberField } from "../fields.js";
import { everyPeriod, periodOf } from "../live/clock.js";
import { Estimates } from "../live/estimates.js";
import { Lane } from "../live/lane.js";
import { normal, VELOCITY_NOISE } from "../live/machine.js";
import { Tracks } from "../live/tracks.js";
import { truth, truthPart } from "../live/truth.js";
import { reserve, swatch, table } from "../measures.js";
import { machine, number, system } from "../request.js";
import { underWay } from "../run.js";
import { offerShare } from "../share.js";

export const name = "loop";
export const title = "Closed loop";
export const parts = [task, truthPart, () => machinePart("What the controllers believe")];

const CONTROLLERS = {
  receding_horizon: "Receding horizon", time_optimal_law: "Time-optimal law", pd_feedforward: "PD with friction feedforward", pid: "PID",
};
const RIVAL = "PD";
const SECONDS_SHOWN = 10;
const EVERY_DRAWING = 4;
/** Steps between drawings of the charts. */
const FRAME_MS = 30;
/** Between drawings of the masses: without a graphics card a frame of the screen takes a core for long. */
const LEAST_NOISE = 1e-4;
/** m: what the service takes for a sensor that says nothing of itself. */
const STATES = { moving: "moving", holding: "at rest, off the target", arrived: "arrived", unreachable: "cannot get there" };

function task() {
  const { position_unit: unit } = machine();
  return section("Task",
    numberField({ name: "goal", label: "Go to", pointer: "/target_state", hint: `${unit}; or click on a track` }),
    choiceField({ name: "controller", label: "Controller", pointer: "/controller", choices: Object.entries(CONTROLLERS), hint: "beside it a PD, tuned by search on the paper's plant" }),
    numberField({ name: "noise", label: `Sensor noise, m${unit}`, pointer: "/controller/observer/position_noise", range: [0, 5], step: 0.1, hint: "of positions; the controllers are told" }),
    numberField({ name: "delay", label: "Delay, steps", pointer: "/pending_controls", range: [0, 8], step: 1, hint: "of the actuator; the controllers are told" }));
}

const noise = () => Number(get("noise")) / 1e3;

/** What a controller is, with what it is told of its sensor. */
function controller(kind) {
  const position = Math.max(noise(), LEAST_NOISE);
  return { name: kind, observer: { position_noise: position, velocity_noise: VELOCITY_NOISE * position } };
}

export function open(view) {
  const { position_unit: unit, control_unit: controlUnit } = machine();
  const force = `${unit}/s²`;
  const lanes = [new Lane(CONTROLLERS[get("controller")] ?? get("controller")), new Lane(RIVAL)];
  const colours = ["best", "series-2"];
  const lines = lanes.map((_, index) => ({ label: "", colour: colours[index], width: 2 }));
  const results = reserve(lanes.length);
  const tracks = new Tracks(["", RIVAL], unit, (position) => set({ goal: position }));
  const halt = h("button", { type: "button", class: "play", onclick: () => set({ halt: get("halt") ? null : "yes" }) });
  const counts = h("span", { class: "counts", title: "Late: the answer came after the next step was due, and both machines waited." });
  const position = new Chart({ label: "Position", height: "low", x: { label: "time, s" }, y: { label: unit }, lines });
  const control = new Chart({ label: "Control", height: "low", x: { label: "time, s" }, y: { label: controlUnit }, lines: lines.map((line) => ({ ...line, stepped: true })) });
  const estimates = new Estimates(force, controlUnit);
  view.replaceChildren(
    h("p", { class: "verdict" }, "No plan made beforehand arrives on a machine that differs from its model. Here two controllers believe the same wrong model, and measure and decide anew in every step, each for a machine of its own. Pull a mass, or hold Push: both machines get the same push, of which no controller is told; a long one it takes for a change of the machine. Change the machine while it runs, and see what the controller learns."),
    h("div", { class: "trackbox" }, tracks.picture, h("div", { class: "pushes" }, halt, tracks.buttons(),
      h("button", { type: "button", onclick: () => set({ goal: -Number(get("goal")) }) }, "To the other side"), counts)),
    results,
    h("div", { class: "split even" }, position.element, control.element), legend(keys(lanes)),
    h("h2", {}, "What the controller has learned of its machine"),
    h("div", { class: "smalls" }, estimates.element), legend(BAND_KEYS));

  let history = [];
  let span = null;
  let stepped = 0;
  let shared = "";
  let steps = 0;
  let late = 0;

  return async (signal) => {
    const model = system();
    const kinds = [get("controller"), "pd"];
    lanes[0].title = CONTROLLERS[get("controller")] ?? get("controller");
    tracks.rename(lanes.map(({ title: one }) => one));
    halt.textContent = get("halt") ? "Go on" : "Halt";
    draw();
    if (get("halt")) {
      underWay("Halted.");
      await abortion(signal);
    }
    for (;;) {
      await seen(signal);
      const [end, hidden] = [new AbortController(), hiding()];
      const until = AbortSignal.any([signal, hidden, end.signal]);
      const setting = { goal: number("goal"), model, delay: number("delay") };
      try {
        await Promise.all(lanes.map((lane, index) => lane.connect({ ...setting, controller: controller(kinds[index]) }, until)));
        const period = periodOf(model.time_step);
        const slowed = period / (1e3 * model.time_step);
        underWay(`Runs at ${short(1e3 / period)} steps a second${slowed > 1.001 ? `, ${short(slowed, 2)} times slower than the machine is` : ""}.`);
        keepMoving(period, until);
        await everyPeriod(period, until, (missed) => step(missed, (error) => end.abort(error)));
      } catch (error) {
        if (signal.aborted || !hidden.aborted) throw error;
      } finally {
        end.abort();
      }
    }
  };

  /** Move the masses as time goes by. */
  function keepMoving(period, signal, moved = -Infinity) {
    if (signal.aborted) return;
    const now = performance.now();
    const isDue = now - moved >= FRAME_MS;
    if (isDue) move(period);
    requestAnimationFrame(() => keepMoving(period, signal, isDue ? now : moved));
  }

  /** One step of both machines, and what their sensors say; both wait for an answer that is late. */
  function step(missed, fail) {
    late += missed;
    if (lanes.some((lane) => lane.isWaiting)) {
      late += 1;
      return;
    }
    const plant = truth();
    const [, high] = limits(plant);
    const push = tracks.push * high * plant.control_gain;
    const draws = normal();
    stepped = performance.now();
    steps += 1;
    for (const lane of lanes) {
      lane.advance(plant, push);
      lane.measure(number("goal"), noise(), draws).catch(fail);
    }
    history.push({
      time: steps * plant.time_step, push,
      positions: lanes.map((lane) => lane.machine.state[0]), controls: lanes.map((lane) => lane.machine.acting),
      learned: Estimates.of(plant, lanes[0].answer?.estimate),
    });
    history = history.slice(-Math.ceil(SECONDS_SHOWN / plant.time_step) - 1);
    if (steps % EVERY_DRAWING === 0) draw();
  }

  /** Show the masses between the last two steps, as time goes by. */
  function move(period) {
    const plant = truth();
    const { forward, backward } = thresholds(plant);
    const [low, high] = limits(plant);
    const share = Math.min(1, (performance.now() - stepped) / period);
    place();
    tracks.show(lanes.map(({ machine: one, answer }) => ({
      position: one.before[0] + share * (one.state[0] - one.before[0]),
      share: one.acting / Math.max(high, -low),
      stuck: one.state[1] === 0 && one.acting <= forward && one.acting >= -backward && answer?.status !== "arrived",
    })));
  }

  /** Have the tracks show the target and both masses; they widen only where they have to. */
  function place() {
    const goal = number("goal") || 0;
    const least = easyTarget(system());
    const [low, high] = extent([goal, -goal, least, -least, ...lanes.map((lane) => lane.machine.state[0])]);
    const isOut = !span || low < span[0] || high > span[1];
    if (!isOut && tracks.target === goal) return;
    if (isOut) span = around(Math.min(low, span?.[0] ?? 0), Math.max(high, span?.[1] ?? 0), 0.25);
    tracks.place(span, goal);
  }

  function draw() {
    const plant = truth();
    place();
    move(1);
    counts.textContent = `${steps} steps, ${late} late`;
    results.replaceChildren(table("How they do", ["Controller", "State", "Error", "Its observer off by", "Energy", "Round trip"], lanes.map((lane, index) => [
      swatch(index + 1, lane.title), STATES[lane.answer?.status] ?? "–", distance(Math.abs(lane.machine.state[0] - number("goal")), unit),
      lane.answer ? distance(lane.observerError, unit) : "–", short(lane.energy), lane.roundTripMs === null ? "–" : `${lane.roundTripMs.toFixed(1)} ms`,
    ])));
    share(plant);
    if (!history.length) return;
    const times = history.map(({ time }) => time);
    const x = [Math.max(0, times.at(-1) - SECONDS_SHOWN), Math.max(SECONDS_SHOWN, times.at(-1))];
    const goal = number("goal") || 0;
    const column = (key, index) => history.map((each) => each[key][index]);
    position.show({
      x, y: around(...extent([goal, ...history.flatMap(({ positions }) => positions)]), 0.1),
      data: [times, column("positions", 0), column("positions", 1)], under: [pushes(history, plant.time_step), rule(goal, "target")],
    });
    const { forward, backward } = thresholds(plant);
    const [low, high] = limits(plant);
    control.show({
      x, y: around(low, high, 0.1), data: [times, column("controls", 0), column("controls", 1)],
      under: [band(Math.max(-backward, low), Math.min(forward, high), "band"), rule(low, "limit"), rule(high, "limit")],
    });
    estimates.show(times, x, history.map(({ learned }) => learned));
  }

  /** Offer a run of the same, without the pushes. */
  function share(plant) {
    const body = {
      initial_state: [0, 0], target_state: [number("goal"), 0], system: plant, nominal_system: system(),
      controller: controller(get("controller")), sensor: { position_noise: noise(), velocity_noise: VELOCITY_NOISE * noise() },
      delay_steps: number("delay"), steps: 200, seed: 7, include: ["states"],
    };
    if (JSON.stringify(body) === shared) return;
    shared = JSON.stringify(body);
    offerShare([{ path: "simulate", body }]);
  }
}

/** Never comes to its end; rejects as the signal says. */
const abortion = (signal) => new Promise((_, reject) => { signal.addEventListener("abort", () => reject(signal.reason), { once: true }); });

/** Wait until somebody looks: a browser lets hidden pages do no more than a step a second. */
async function seen(signal) {
  if (!document.hidden) return;
  underWay("Waits until the page is seen.");
  await Promise.race([abortion(signal), new Promise((resolve) => { document.addEventListener("visibilitychange", resolve, { once: true }); })]);
}

/** A signal for when nobody looks any more. */
function hiding() {
  const controller = new AbortController();
  document.addEventListener("visibilitychange", () => controller.abort(), { once: true });
  return controller.signal;
}

/** Where masses were pushed. */
const pushes = (history, step) => (ctx, u) => {
  const width = u.valToPos(step, "x", true) - u.valToPos(0, "x", true);
  ctx.fillStyle = colour("pushed");
  for (const { time, push } of history) {
    if (push) ctx.fillRect(u.valToPos(time, "x", true) - width, u.bbox.top, width, u.bbox.height);
  }
};

const keys = (lanes) => [
  ["best", "the controller"], ["rival", lanes[1].title], ["target", "target"], ["pushed", "a push"], ["band", "too weak to start the mass"], ["limit", "control limits"],
];

const BAND_KEYS = [
  ["best", "estimate"], ["set", "95 % interval (static friction: all that it may be)"], ["target", "the machine itself"],
];
