// Fields of the form, each bound to a name of the state, and the errors beside them.

import { get, listen, set } from "./address.js";
import { h } from "./dom.js";

const bound = new Set();

/** Read all fields that are on the page from the state. */
function refresh() {
  for (const field of bound) {
    if (field.element.isConnected) field.show();
    else bound.delete(field);
  }
}
listen(refresh);

/**
 * A labelled field. What it holds is the state's `name`, or where that says nothing, `otherwise()`.
 * Errors of the service about `pointer`, or what lies below, stand under it.
 */
function labelled(name, label, pointer, hint, build) {
  const id = `field-${name}`;
  const error = h("span", { class: "error", id: `${id}-error`, role: "alert" });
  const described = [`${id}-error`];
  if (hint) described.push(`${id}-hint`);
  const inputs = build(id, described.join(" "));
  return h(
    "div",
    { class: "field", "data-pointer": pointer },
    h("label", { for: id }, label),
    inputs,
    hint ? h("span", { class: "hint", id: `${id}-hint` }, hint) : null,
    error,
  );
}

const bind = (element, show) => {
  const field = { element, show };
  bound.add(field);
  show();
  return element;
};

const valueOf = (name, otherwise) => get(name) || String(otherwise?.() ?? "");

/** A number: typed, and with a range slid as well. */
export function numberField({ name, label, pointer, hint, otherwise, range, step = "any" }) {
  return labelled(name, label, pointer, hint, (id, described) => {
    const change = (text) => set({ [name]: text === "" || Number(text) === otherwise?.() ? null : text });
    const typed = h("input", {
      id, type: "number", step: "any", inputmode: "decimal", "aria-describedby": described,
      onchange: () => change(typed.value),
    });
    bind(typed, () => { typed.value = valueOf(name, otherwise); });
    if (!range) return typed;
    const slider = h("input", {
      type: "range", min: range[0], max: range[1], step, "aria-label": `${label}, slider`,
      oninput: () => { typed.value = slider.value; },
      onchange: () => change(slider.value),
    });
    bind(slider, () => { slider.value = valueOf(name, otherwise); });
    return h("div", { class: "both" }, slider, typed);
  });
}

/** One of several values, as pairs of value and text; also() says what else changes with it. */
export function choiceField({ name, label, pointer, hint, choices, otherwise, also }) {
  return labelled(name, label, pointer, hint, (id, described) => {
    const select = h(
      "select",
      {
        id, "aria-describedby": described,
        onchange: () => set({ ...also?.(select.value), [name]: select.value === String(otherwise?.() ?? "") ? null : select.value }),
      },
      choices.map(([value, text]) => h("option", { value }, text)),
    );
    return bind(select, () => { select.value = valueOf(name, otherwise); });
  });
}

/** Yes or no. */
export function tickField({ name, label, pointer, hint, yes = "yes", otherwise = () => false }) {
  return labelled(name, label, pointer, hint, (id, described) => {
    const tick = h("input", {
      id, type: "checkbox", "aria-describedby": described,
      onchange: () => set({ [name]: tick.checked === otherwise() ? null : tick.checked ? yes : "no" }),
    });
    return bind(tick, () => { tick.checked = get(name) ? get(name) === yes : otherwise(); });
  });
}

/** A state: position and velocity, each in a field of its own. */
export function stateField({ label, pointer, read, write, unit }) {
  const part = (index, what, itsUnit) => labelled(`${label}.${index}`.replace(" ", "-"), `${label} ${what}`, `${pointer}/${index}`, itsUnit, (id, described) => {
    const typed = h("input", {
      id, type: "number", step: "any", inputmode: "decimal", "aria-describedby": described,
      onchange: () => {
        const state = [...read()];
        state[index] = typed.value === "" ? 0 : Number(typed.value);
        write(state);
      },
    });
    return bind(typed, () => { typed.value = read()[index] ?? ""; });
  });
  return h("div", { class: "pair" }, part(0, "position", unit), part(1, "velocity", `${unit}/s`));
}

/** Put the service's words beside the field that a pointer is about; false where there is none. */
export function showError(pointer, detail) {
  const places = [...document.querySelectorAll("[data-pointer]")].filter((one) => one.offsetParent !== null || one.closest("details"));
  const fits = (own) => own && (pointer === own || pointer.startsWith(`${own}/`));
  const place = places.filter((one) => fits(one.dataset.pointer)).sort((a, b) => b.dataset.pointer.length - a.dataset.pointer.length)[0];
  if (!place) return false;
  place.closest("details")?.setAttribute("open", "");
  place.querySelector(".error").textContent = detail;
  place.querySelector("input:not([type='range']), select")?.setAttribute("aria-invalid", "true");
  return true;
}

export function clearErrors() {
  for (const error of document.querySelectorAll("[data-pointer] .error")) error.textContent = "";
  for (const field of document.querySelectorAll("[aria-invalid]")) field.removeAttribute("aria-invalid");
}
