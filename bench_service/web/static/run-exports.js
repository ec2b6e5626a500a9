// A run's data to take away, in each format that there is.
import { api } from "./api.js";
import { el } from "./dom.js";
import { MISSING } from "./format.js";

/** Those for people: names of an older version are for programs. */
export const currentFormats = async () => (await api.formats()).filter((format) => !/-0\.1\.0$/.test(format.name));

export function exportLinks(run, formats) {
  if (!run.n_samples) return el("span", { text: MISSING });
  const name = run.damage ? `what is left of ${run.name ?? run.id}` : run.name ?? run.id;
  return el("span", { class: "links" }, formats.map((format) =>
    el("a", { href: api.exportUrl(run.id, format.name, run.damage), download: "", title: format.title, "aria-label": `${format.name.toUpperCase()} of ${name}` }, format.name.toUpperCase())));
}
