// The service, over HTTP, like any other client. The key is kept here, in memory alone.

const base = new URL(document.documentElement.dataset.base || "./", location.href.split("#")[0]);
let key = "";

export const setKey = (text) => { key = text.trim(); };
export const hasKey = () => key !== "";
export const address = (path) => new URL(path, base).href;

/** What the service says is wrong, as problem+json has it. */
export class Problem extends Error {
  constructor(status, body, retryAfter) {
    super(body.detail || body.title || `HTTP ${status}`);
    this.status = status;
    this.title = body.title;
    this.errors = body.errors ?? [];
    this.retryAfter = retryAfter;
  }
}

/** Nobody answers there. */
export class Unreachable extends Error {}

async function send(path, options) {
  const headers = { ...options.headers };
  if (key) headers.Authorization = `Bearer ${key}`;
  let response;
  try {
    response = await fetch(address(path), { ...options, headers, cache: "no-store" });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Unreachable("the service cannot be reached");
  }
  if (response.ok) return response;
  const body = await response.json().catch(() => ({ title: response.statusText }));
  throw new Problem(response.status, body, Number(response.headers.get("Retry-After")) || 1);
}

/** Open a WebSocket; a key goes as the name of a protocol, the one thing that a page may send with it. */
export function socket(path) {
  const url = new URL(path, base);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  const bytes = String.fromCharCode(...new TextEncoder().encode(key));
  const text = btoa(bytes).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
  return new WebSocket(url, ["breakaway.control", ...(text ? [`breakaway.key.${text}`] : [])]);
}

const post = (body, signal, accept) => ({
  method: "POST",
  body: JSON.stringify(body),
  headers: { "Content-Type": "application/json", Accept: accept },
  signal,
});

async function whole(response) {
  try {
    return await response.json();
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Unreachable("the answer broke off");
  }
}

export const read = async (path, signal) => whole(await send(path, { signal }));
export const ask = async (path, body, signal) => whole(await send(path, post(body, signal, "application/json")));

/** Yield the events of a stream as { kind, data }. */
export async function* events(path, body, signal) {
  const response = await send(path, post(body, signal, "text/event-stream"));
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    let part;
    try {
      part = await reader.read();
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new Unreachable("the answer broke off");
    }
    if (part.done) return;
    text += part.value;
    const found = text.split("\n\n");
    text = found.pop();
    for (const event of found) {
      const [kind, data] = event.split("\n").map((line) => line.slice(line.indexOf(": ") + 2));
      const value = JSON.parse(data);
      if (kind === "problem") throw new Problem(value.status, value, 1);
      yield { kind, data: value };
    }
  }
}
