// What lines and areas of the charts above it mean.

import { h } from "../dom.js";

/** @param entries [kind, text]: kinds of keys are in the style sheet */
export const legend = (entries) => h("ul", { class: "legend" }, entries.map(([kind, text]) => h("li", {}, h("span", { class: `key ${kind}` }), text)));
