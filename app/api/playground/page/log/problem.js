// What is wrong with a log before the service sees it: as the service would say it, by field.

import { Problem } from "../api.js";

const POINTERS = { file: "/log", time: "/time_step", control: "/controls", position: "/positions", velocity: "/velocities" };

export class LogProblem extends Problem {
  /** @param part the file, or the role of the column at fault */
  constructor(part, detail) {
    super(422, { title: "The log cannot be read", detail, errors: [{ pointer: POINTERS[part], detail }] });
  }
}
