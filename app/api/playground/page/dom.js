// Small things to build and write a page with.

/** Return an element: attributes by name, listeners as on..., then its children. */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "value" || name === "checked" || name === "disabled") element[name] = value;
    else if (value !== undefined && value !== false) element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return element;
}

const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/** Write a number with some significant digits; powers of ten only where it would be long. */
export function short(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size < 1e-9) return "0";
  if (size >= 1e-3 && size < 1e5) return String(Number(value.toPrecision(digits))).replace("-", "−");
  const [mantissa, power] = value.toExponential(1).split("e");
  return `${mantissa.replace("-", "−")}·${tenTo(power)}`;
}

/** Write a power of ten. */
export const tenTo = (power) => `10${[...String(power)].map((sign) => RAISED[sign] ?? (sign === "-" ? "⁻" : "")).join("")}`;

/** Write a distance with a unit that suits it. */
export function distance(value, unit = "m") {
  if (unit !== "m") return `${short(value)} ${unit}`;
  const size = Math.abs(value);
  if (size < 1e-7) return "0 mm";
  if (size < 1e-4) return `${short(value * 1e6, 2)} µm`;
  if (size < 1) return `${short(value * 1e3)} mm`;
  return `${short(value)} m`;
}

export const words = (name) => name.replaceAll("_", " ");
