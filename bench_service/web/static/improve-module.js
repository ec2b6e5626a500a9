// Runs of a module: what a fit has to know of it, and what only its comparison has: S1 to S4 side by side, and its groups.
import { table } from "./campaign-result.js";
import { el } from "./dom.js";
import { fixed, quantity } from "./format.js";

const MOST = 10000;
const BESIDE = { S1: "the cells alone", S2: "a resistance beside them", S3: "a resistance and an offset", S4: "the same, apart for charge and discharge" };

/** Fields of a layout. `asked()` gives what a fit takes as `module`, null for a cell; `fault()` says what is wrong; `draw(models)` offers models of cells. */
export function moduleFields(changed) {
  const field = (id, title, input, note) => [input, el("div", { class: "field" }, el("label", { for: id, text: title }), input, el("span", { class: "about", text: note }))];
  const count = (id, props) => el("input", { id, inputmode: "numeric", autocomplete: "off", ...props });
  const [series, seriesField] = field("fit-series", "Cells in series", count("fit-series", { placeholder: "as measured" }), "empty: as many as the runs have voltages of");
  const [parallel, parallelField] = field("fit-parallel", "Cells in parallel", count("fit-parallel", { value: "1" }), "in each group");
  const [cell, cellField] = field("fit-cell-model", "Model of one cell", el("select", { id: "fit-cell-model" }), "from tests of cells, where there is one");
  const more = el("div", { class: "fields", hidden: true }, seriesField, parallelField, cellField);
  const of = el("input", { type: "checkbox", id: "fit-module", on: { change: () => { more.hidden = !of.checked; changed(of.checked); } } });
  const whole = (input) => /^\d+$/.test(input.value.trim()) && Number(input.value) >= 1 && Number(input.value) <= MOST;
  const fault = () => {
    if (!of.checked) return "";
    if (series.value.trim() && !whole(series)) return "Give the cells in series as a whole number, or leave it empty.";
    return whole(parallel) ? "" : "Give the cells in parallel as a whole number, 1 or more.";
  };
  const asked = () => (of.checked ? { in_series: series.value.trim() ? Number(series.value) : null, parallel: Number(parallel.value), cell_model_id: cell.value || null } : null);
  const draw = (models) => {
    const kept = cell.value;
    cell.replaceChildren(el("option", { value: "", text: "none: from these runs" }), ...models.filter((model) => !isModule(model)).map((model) => el("option", { value: model.id, text: `${model.name} · ${String(model.id).slice(0, 6)}` })));
    cell.value = [...cell.options].some((option) => option.value === kept) ? kept : "";
  };
  return { node: el("div", {}, el("label", { class: "inline" }, of, "The runs are of a module"), more), asked, fault, draw };
}

const isModule = (model) => Boolean(model.metrics?.module);

/** The `module` object of a comparison; null where the model is of a cell. */
export function moduleTables(module) {
  if (!module) return null;
  const { chosen, models, groups, weak_group: weak } = module;
  return el("div", { class: "module" },
    groups.length ? el("p", { class: "weak-group" }, weak ? el("strong", { text: `Weak: ${spoken(weak.text)}` }) : "No group is weaker than the others for sure.")
      : el("p", { class: "about", text: "The voltages of its groups were not measured: which one is weak cannot be said." }),
    table("Module models", ["Model", "Beside the cells", "RMSE"], models.map(({ kind, overall }) => [kind === chosen ? `${kind} (taken)` : kind, BESIDE[kind] ?? "", quantity(overall.rmse_mV, 1, "mV")])),
    table("Groups in series", ["Group", "Capacity", "SoC from the mean when full", "R from the mean", "Empty after", "Lowest voltage"], groups.map((group) => [String(group.group),
      pair(group.capacity_Ah, 1, 2, "Ah"), pair(group.soc_offset, 100, 1, "%"), pair(group.resistance_Ohm, 1000, 3, "mΩ"), pair(group.until_empty_Ah, 1, 2, "Ah"), quantity(group.lowest_V, 3, "V")])));
}

/** The service's words as the page writes units. */
const spoken = (text) => text.replaceAll("+-", "±").replaceAll("mOhm", "mΩ");

const pair = ({ value, std }, factor, digits, unit) => `${fixed(factor * value, digits)} ± ${quantity(factor * std, digits, unit)}`;
