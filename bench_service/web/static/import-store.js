// The end of an import: name, capacity, state of charge; and the mapping to be remembered.
import { api } from "./api.js";
import { cellCapacity } from "./cell-fields.js";
import { el, offer, setText } from "./dom.js";
import { follow } from "./jobs.js";

/** `stored(runId)` at the end; `began(job)` when it is under way; `choices()` and `upload()` give what is stored; `work(title, place, task)` shows there that it goes on. */
export function importStore(node, { stored, began, choices, upload, work }) {
  const view = { asked: 0, offered: "", unknown: "" };
  let mapping = null;
  const field = (id, title, props) => { const input = el("input", { id, autocomplete: "off", ...props }); return [input, el("div", { class: "field" }, el("label", { for: id, text: title }), input)]; };
  const [name, nameField] = field("import-name", "Name of the run", { maxlength: 200 });
  const [capacity, capacityField] = field("import-capacity", "Capacity of the cell / Ah", { inputmode: "decimal", required: true });
  const [soc, socField] = field("import-soc", "State of charge at its start / %", { inputmode: "decimal", required: true });
  const [title, titleField] = field("import-mapping", "Remember the columns as", { maxlength: 64, placeholder: "our-cycler" });
  const [cell, cellField] = field("import-of-cell", "Cell, where it has a name", { maxlength: 64, placeholder: "C7", value: new URLSearchParams(location.search).get("cell") ?? "" });
  const told = el("p", { class: "hint", role: "status" });
  const progress = el("div", { id: "import-storing" });
  const number = (input) => Number(input.value.trim().replace(",", "."));
  const check = () => {
    const [Q, S] = [number(capacity), number(soc)];
    if (view.unknown) return view.unknown;
    if (!capacity.value || !(Q > 0)) return "Give the cell's capacity in Ah, above 0.";
    if (!soc.value || !(S >= 0 && S <= 100)) return "Give the state of charge at the start, 0 to 100 %.";
    return "";
  };
  const submit = async (event) => {
    event.preventDefault();
    await known();
    const wrong = check();
    setText(told, wrong);
    if (wrong) return;
    const body = { capacity_Ah: number(capacity), initial_soc: number(soc) / 100, name: name.value.trim() || null, cell_id: cell.value.trim() || null, choices: choices() };
    const result = await work("Storing the run", progress, async (update) => {
      if (title.value.trim()) await api.saveMapping({ ...mapping, name: title.value.trim() });
      const job = await api.storeImport(upload().id, body);
      began(job);
      return follow(job, update);
    });
    if (result) stored(result.run);
    else began(null);
  };
  node.replaceChildren(el("form", { class: "campaign-form", novalidate: true, on: { submit } }, el("div", { class: "fields" }, nameField, cellField, capacityField, socField, titleField),
    el("div", { class: "form-end" }, el("button", { id: "import-store-button", class: "primary", text: "Store as a run" }), told), progress));
  /** What is known of the cell need not be typed: its capacity stands there, ready to be typed over, as soon as nobody else's does. */
  const known = async () => {
    const name = cell.value.trim();
    view.asked += 1;
    const asked = view.asked;
    const [found, unknown] = name ? await api.cell(name).then((each) => [each, ""], (error) => [null, error.status === 404 ? `unknown cell ${name}: take it in under Cells first, or leave the field empty.` : ""]) : [null, ""];
    if (asked !== view.asked) return;
    if (view.unknown !== unknown) setText(told, unknown);
    view.unknown = unknown;
    const Q = found ? cellCapacity(found) : NaN;
    if (!Number.isFinite(Q) || (capacity.value && capacity.value !== view.offered)) return;
    view.offered = capacity.value = String(Q);
    if (document.activeElement === capacity) capacity.select();
  };
  cell.addEventListener("change", known);
  known();
  return { show: (seen) => { mapping = seen.mapping; offer(name, seen.file); } };
}
