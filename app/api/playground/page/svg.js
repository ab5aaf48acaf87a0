// Pictures beside the charts: elements, and round marks along a track.

const NS = "http://www.w3.org/2000/svg";

export function svg(tag, attributes, ...children) {
  const element = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** Marks with their numbers below a track on height y; x() says where a position is. */
export function marks([low, high], width, x, y, write) {
  const values = roundValues(low, high, width / 64);
  return [
    ...values.map((value) => svg("path", { d: `M${x(value)} ${y}v6` })),
    ...values.map((value) => svg("text", { x: x(value), y: y + 20 }, write(value))),
  ];
}

/** Some round values between two others. */
function roundValues(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, index) => Number(((first + index) * step).toPrecision(6)));
}
