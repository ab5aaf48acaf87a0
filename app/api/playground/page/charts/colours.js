// Colours of the charts, from the style sheet: light and dark are settled there alone.

const style = getComputedStyle(document.documentElement);

/** Return a colour by its name in the style sheet. */
export const colour = (name) => style.getPropertyValue(`--${name}`).trim();

const parsed = (name) => colour(name).match(/[0-9a-f]{2}/gi).map((part) => parseInt(part, 16));

/** Return the colour of a rank, 0 the best and 1 the worst. */
export function rankColour(share) {
  const [best, worst] = [parsed("rank-best"), parsed("rank-worst")];
  const mixed = best.map((part, index) => Math.round(part + (worst[index] - part) * Math.sqrt(share)));
  return `rgb(${mixed.join(" ")})`;
}

/** Colours that are told apart, for methods and the like. */
export const series = (index) => colour(`series-${1 + (index % 6)}`);

export const themes = matchMedia("(prefers-color-scheme: dark)");
