// What a run is and what people have written about it.
import { api } from "./api.js";
import { cellHref } from "./cell-fields.js";
import { chip, el, renderKeyed } from "./dom.js";
import { IMPORTED, MISSING, count, duration, fixed, percent, quantity, startElement } from "./format.js";
import { currentFormats, exportLinks } from "./run-exports.js";
import { reportLinks } from "./report-links.js";
import { wordFor } from "./words.js";

export function factsPanel(of) {
  const node = el("div");
  let formats = [];
  const show = () => {
    const { run, samples, end_s: end, damage, name } = of();
    const totals = ["charge_Ah", "energy_Wh"].map((key) => samples[key]?.at(-1));
    renderKeyed(node, JSON.stringify([run, end, damage, totals, formats]), () => [
      el("header", { class: "run-head" }, el("h1", { text: name }), chip(...wordFor("run", run.state)),
        damage ? chip("bad", "damaged") : null, run.bench === IMPORTED ? el("span", { class: "about", text: "brought in from a file" }) : el("a", { href: `/?bench=${encodeURIComponent(run.bench)}`, text: `Bench ${run.bench}` })),
      run.reason ? el("p", { class: "about", text: run.reason }) : null,
      damage ? el("p", { class: "form-message", text: `What is left of it is shown: ${damage}` }) : null,
      el("dl", { class: "run-facts" }, rows({ ...run, damage }, end, formats).map(([title, value]) => el("div", {}, el("dt", { text: title }), el("dd", {}, value)))),
    ]);
  };
  currentFormats().then((found) => { formats = found; show(); }, () => {}); // Without them the run is shown all the same.
  return { node, show };
}

// What an imported run was limited to nobody knows.
function rows(run, end, formats) {
  const stored = run.n_samples ?? null;
  return [
    ["Started", startElement(run)], ["Test time", end ? duration(end) : MISSING],
    ["Samples", stored === null ? "being recorded" : count(stored)], ...(run.bench === IMPORTED ? [] : [["Missed ticks", count(run.missed_ticks)]]),
    ["Sample period", quantity(run.dt_s, run.dt_s < 1 ? 3 : 0, "s")], ["SoC at the start", percent(run.initial_soc)],
    ["Capacity", quantity(run.capacity_Ah, run.capacity_Ah < 0.1 ? 5 : 2, "Ah")],
    ...(run.bench === IMPORTED ? [] : [["Current limits", limits(run.limits?.current_A, 1, "A")], ["Voltage limits", limits(run.limits?.voltage_V, 2, "V")]]),
    ["To share", stored ? reportLinks("runs", run.id, "the run") : MISSING], ["Data", exportLinks(run, formats)],
    ["Go on", stored && run.ended_utc ? el("a", { href: "/improve", text: "Improve a model with it" }) : MISSING],
    ["Operator", run.operator ?? MISSING], ["Cell", run.cell_id ? el("a", { href: cellHref(run.cell_id), text: run.cell_id }) : MISSING],
  ];
}

const limits = (pair, digits, unit) => (pair ? `${fixed(pair[0], digits)} … ${fixed(pair[1], digits)} ${unit}` : MISSING);

/** Label, operator, cell and notes; what is changed is stored, and each change is an event. */
export function notesPanel(data, stored) {
  const message = el("p", { class: "form-message", role: "alert" });
  const answer = el("p", { class: "about", role: "status" });
  const field = (name, title, node) => el("div", { class: "field" }, el("label", { for: `run-${name}`, text: title }), node);
  const label = el("input", { id: "run-label", name: "label", maxlength: 200, autocomplete: "off", value: data.run.label ?? "" });
  const operator = el("input", { id: "run-operator", name: "operator", maxlength: 200, autocomplete: "off", value: data.run.operator ?? "" });
  const cell = el("input", { id: "run-cell", name: "cell_id", maxlength: 64, autocomplete: "off", placeholder: "C7", value: data.run.cell_id ?? "" });
  const notes = el("textarea", { id: "run-notes-text", name: "notes", maxlength: 20000, rows: 4 }, data.run.notes ?? "");
  const save = el("button", { class: "primary", type: "submit", text: "Save" });
  return el("form", { class: "notes-form", "aria-label": "Label, operator, cell and notes", on: { submit: async (event) => {
    event.preventDefault();
    message.textContent = answer.textContent = "";
    const written = { label: label.value.trim() || null, operator: operator.value.trim() || null, cell_id: cell.value.trim() || null, notes: notes.value.trim() || null };
    const changed = Object.fromEntries(Object.entries(written).filter(([name, value]) => value !== (data.run[name] ?? null)));
    if (!Object.keys(changed).length) { answer.textContent = "Nothing has changed."; return; }
    save.disabled = true;
    try {
      data.run = await api.describeRun(data.run.id, changed);
      cell.value = data.run.cell_id ?? "";
      answer.textContent = "Saved.";
      stored();
    } catch (error) {
      message.textContent = error.message;
    } finally {
      save.disabled = false;
    }
  } } }, el("div", { class: "fields" }, field("label", "Label", label), field("operator", "Operator", operator), field("cell", "Cell", cell)), field("notes-text", "Notes", notes), el("div", { class: "form-end" }, save, answer, message));
}
