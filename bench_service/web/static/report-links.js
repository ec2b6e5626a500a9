// Where the report of something is, as a page and on paper.
import { api } from "./api.js";
import { el } from "./dom.js";

/** `kind`: as in the address of the REST interface, such as "runs"; `what` tells those who cannot see what it is beside. */
export const reportLinks = (kind, name, what) => el("span", { class: "links" },
  [["html", "Report"], ["pdf", "Report as PDF"]].map(([format, text]) =>
    el("a", { href: api.reportUrl(kind, name, format), target: "_blank", rel: "noopener", text, "aria-label": `${text} of ${what}` })));
