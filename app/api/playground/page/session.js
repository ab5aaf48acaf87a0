// A control session over a WebSocket: an answer for each message, in order.

import { Problem, Unreachable, socket } from "./api.js";

export class Session {
  /**
   * Open a session and start it.
   * @param start the message that starts it
   * @param signal aborted, it closes the session
   */
  static async open(start, signal) {
    signal.throwIfAborted();
    const session = new Session(socket("control"), signal);
    await session.opened;
    await session.ask({ type: "start", ...start });
    return session;
  }

  constructor(connection, signal) {
    this.connection = connection;
    this.waiting = [];
    this.reason = new Unreachable("the service cannot be reached");
    this.opened = new Promise((resolve, reject) => {
      connection.onopen = () => {
        this.reason = new Unreachable("the connection broke off");
        resolve();
      };
      connection.onclose = () => {
        reject(this.reason);
        for (const one of this.waiting.splice(0)) one.reject(this.reason);
      };
    });
    connection.onmessage = ({ data }) => this.hear(JSON.parse(data));
    signal.addEventListener("abort", () => this.close(signal.reason), { once: true });
  }

  hear(told) {
    if (told.type === "ended") {
      this.reason = new Unreachable(`the service ended the session (${told.reason})`);
      return;
    }
    const one = this.waiting.shift();
    if (told.type !== "error") one?.resolve(told);
    else {
      this.reason = new Problem(told.status, told, 1);
      one?.reject(this.reason);
    }
  }

  /** Send a message; return its answer. Rejects with what the service says is wrong, or that it is gone. */
  ask(message) {
    return new Promise((resolve, reject) => {
      if (this.connection.readyState !== WebSocket.OPEN) { reject(this.reason); return; }
      this.waiting.push({ resolve, reject });
      this.connection.send(JSON.stringify(message));
    });
  }

  close(reason) {
    this.reason = reason;
    if (this.connection.readyState === WebSocket.CONNECTING) {
      // Browsers complain of a connection that is closed before it is there.
      this.connection.onopen = () => this.connection.close();
      this.connection.onclose();
    } else this.connection.close();
  }
}
