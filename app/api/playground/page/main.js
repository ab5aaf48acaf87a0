// Boots the page: asks what the service offers, shows the tab that the address names.

import { LIVE, VIEWS, get, listen, set } from "./address.js";
import { read, setKey } from "./api.js";
import { build } from "./controls.js";
import { h } from "./dom.js";
import { offer, ownMachine } from "./request.js";
import { isUnderWay, run } from "./run.js";
import { withdrawShare } from "./share.js";
import * as compare from "./tabs/compare.js";
import * as denoise from "./tabs/denoise.js";
import * as doubt from "./tabs/doubt.js";
import * as identify from "./tabs/identify.js";
import * as loop from "./tabs/loop.js";
import * as plan from "./tabs/plan.js";
import * as sequence from "./tabs/sequence.js";

const TABS = [plan, compare, denoise, doubt, loop, identify, sequence];

const CHANGE_THE_FORM = ["tab", "machine", "directed", "method", "log"];

const list = document.getElementById("tabs");
const panel = document.getElementById("panel");
const view = document.getElementById("view");
const key = document.getElementById("key");
let work = null;

const current = () => TABS.find((tab) => tab.name === get("tab")) ?? plan;

list.append(...TABS.map((tab) => h("button", { type: "button", role: "tab", id: `tab-${tab.name}`, "aria-controls": "panel", onclick: () => set({ tab: tab.name }) }, tab.title)));
list.addEventListener("keydown", (event) => {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!step) return;
  const next = TABS.at((TABS.indexOf(current()) + step) % TABS.length);
  set({ tab: next.name });
  document.getElementById(`tab-${next.name}`).focus();
});

function showTab() {
  const tab = current();
  for (const button of list.children) {
    const isCurrent = button.id === `tab-${tab.name}`;
    button.setAttribute("aria-selected", isCurrent);
    button.tabIndex = isCurrent ? 0 : -1;
    if (isCurrent) button.scrollIntoView({ block: "nearest", inline: "nearest" });
  }
  panel.setAttribute("aria-labelledby", `tab-${tab.name}`);
  document.title = `${tab.title} – Breakaway playground`;
}

/** Ask for what the address says, on a tab that fits. */
function update(changed) {
  showTab();
  const isTakenIn = (name) => VIEWS.includes(name) || (LIVE.includes(name) && isUnderWay());
  if (!offer.machines.length || (changed.length && changed.every(isTakenIn))) return;
  const tab = current();
  if (changed.some((name) => CHANGE_THE_FORM.includes(name))) build(tab);
  if (changed.includes("tab") || changed.includes("machine")) {
    withdrawShare();
    work = tab.open(view);
  }
  run(tab.title, work);
}

async function boot() {
  showTab();
  const asked = ["machines", "methods"];
  const isThere = await run("Asking the service what it offers", async (signal) => {
    const answers = await Promise.all(asked.map((path) => read(path, signal)));
    asked.forEach((path, index) => { offer[path] = answers[index]; });
    return "";
  });
  if (!isThere) return;
  offer.machines.push(ownMachine(offer.machines[0]));
  update(["tab"]);
}

listen(update);
document.getElementById("to-form").addEventListener("click", () => document.getElementById("controls").scrollIntoView());
key.addEventListener("submit", (event) => event.preventDefault());
document.getElementById("api-key").addEventListener("change", (event) => {
  setKey(event.target.value);
  if (offer.machines.length) update([]);
  else boot();
});
boot();
