// The page of one cell: what it is, what is kept with it, and all that belongs to it.
import { api } from "./api.js";
import { cellCapacity, cellName, entriesField, labelled, numberOf, textInput, typeName } from "./cell-fields.js";
import { chip, el, setText } from "./dom.js";
import { effectTitles } from "./effect-titles.js";
import { MISSING, count, fixed, quantity, startElement, timeElement } from "./format.js";
import { sidePage } from "./side-page.js";
import { State } from "./state.js";
import { wordFor } from "./words.js";

const place = (id) => document.getElementById(id);
const cellId = decodeURIComponent(location.pathname.split("/").pop());
const window_ = (pair, digits, unit) => (pair ? `${fixed(pair[0], digits)} … ${fixed(pair[1], digits)} ${unit}` : MISSING);

function facts(cell) {
  const type = cell.type ?? {};
  const where = cell.retired_utc ? el("span", {}, "retired ", timeElement(cell.retired_utc)) : cell.bench ? el("a", { href: `/?bench=${encodeURIComponent(cell.bench)}`, text: `bench ${cell.bench}` }) : "on no bench";
  const told = [
    ["Where", where], ["Owner", cell.owner ?? MISSING], ["Type", typeName(cell.type) ?? "unknown"], ["Chemistry", type.chemistry ?? MISSING],
    ["Capacity", `${quantity(cellCapacity(cell), 2, "Ah")}${cell.capacity_Ah ? ", measured" : ""}`], ["Voltage limits", window_(type.voltage_V, 2, "V")],
    ["Current limits", type.charge_A ? window_([-type.discharge_A, type.charge_A], 1, "A") : MISSING], ["Temperature limits", window_(type.temperature_degC, 0, "°C")],
    ["Source of the limits", type.source ?? MISSING], ["Taken in", timeElement(cell.created_utc)], ...Object.entries(cell.metadata).map(([name, value]) => [name, String(value)]),
  ];
  place("cell-facts").replaceChildren(
    el("header", { class: "run-head" }, el("h1", { text: cellName(cell) }), cell.retired_utc ? chip("neutral", "retired") : null),
    el("dl", { class: "run-facts" }, told.map(([title, value]) => el("div", {}, el("dt", { text: title }), el("dd", {}, value)))));
  document.title = `Cell ${cellName(cell)} · Bench service`;
}

function changeForm(cell) {
  const message = el("p", { class: "form-message", role: "alert" });
  const answer = el("p", { class: "about", role: "status" });
  const [label, owner] = [textInput("cell-label", cell.label), textInput("cell-owner", cell.owner)];
  const capacity = textInput("cell-capacity", cell.capacity_Ah ?? "", { inputmode: "decimal" });
  const { area, read } = entriesField("cell-metadata", cell.metadata);
  const save = el("button", { class: "primary", type: "submit", text: "Save" });
  const retire = el("button", { type: "button", id: "cell-retire", text: cell.retired_utc ? "Use it again" : "Retire it" });
  const act = (work, done) => async (event) => {
    event.preventDefault();
    setText(message, "");
    setText(answer, "");
    save.disabled = retire.disabled = true;
    try {
      await work();
      await load();
      setText(place("cell-change").querySelector("[role=status]"), done);
    } catch (error) {
      setText(message, error.message);
    }
    save.disabled = retire.disabled = false;
  };
  const written = () => {
    const measured = capacity.value.trim() ? numberOf(capacity) : null;
    if (measured !== null && !(measured > 0)) throw new Error("Measured capacity: a number above 0 is needed.");
    return { label: label.value.trim() || null, owner: owner.value.trim() || null, capacity_Ah: measured, metadata: read() };
  };
  const form = el("form", { class: "notes-form", novalidate: true, "aria-label": "What is kept with the cell", on: { submit: act(async () => api.changeCell(cell.id, written()), "Saved.") } },
    el("div", { class: "fields" }, labelled("Label", label), labelled("Owner", owner), labelled("Measured capacity / Ah", capacity, "else that of its type")),
    el("div", { class: "field" }, el("label", { for: area.id, text: "Whatever else, a line each: name = value" }), area), el("div", { class: "form-end" }, save, retire, answer, message));
  retire.addEventListener("click", act(() => (cell.retired_utc ? api.reuseCell(cell.id) : api.retireCell(cell.id)), cell.retired_utc ? "It is used again." : "It is retired; all that belongs to it stays."));
  place("cell-change").replaceChildren(form);
}

const table = (name, heads, rows) => el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": name }, el("table", { class: "rows named" },
  el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col", text: head })))),
  el("tbody", {}, rows.map((row) => el("tr", {}, row.map((each, k) => el("td", { data: { label: heads[k] } }, each)))))));
const none = (text) => el("p", { class: "empty", text });
const nameOf = (run) => run.label ?? run.name ?? `run ${run.id.slice(0, 8)}`;

function runs(cell, found) {
  const rows = found.map((run) => [el("a", { href: `/runs/${encodeURIComponent(run.id)}`, text: nameOf(run) }), chip(...wordFor("run", run.state)), run.bench, startElement(run), count(run.n_samples)]);
  place("cell-runs").replaceChildren(rows.length ? table("Runs of the cell", ["Run", "State", "Bench", "Started", "Samples"], rows)
    : none("No run yet. Put the cell on a bench, where a test is started; or say on the page of an older run that it is of this cell."));
  place("cell-tools").replaceChildren(rows.length ? el("a", { href: `/life?cell=${encodeURIComponent(cell.id)}`, text: "Its life" }) : "", el("a", { href: `/import?cell=${encodeURIComponent(cell.id)}`, text: "Import a file of it" }));
}

function results(models, diagnoses, titleOf) {
  const named = new Map(models.map((model) => [model.id, model.name]));
  const parts = [];
  if (models.length) parts.push(table("Models of the cell", ["Model", "Structure", "Capacity", "Made", "Data"], models.map((model) => [model.name, model.structure, quantity(model.capacity_Ah, 2, "Ah"), timeElement(model.created_utc),
    el("a", { href: api.modelUrl(model.id), download: `${model.name}.json`, "aria-label": `MODEL.json of ${model.name}`, text: "MODEL.json" })])));
  if (diagnoses.length) parts.push(table("Diagnoses of the cell", ["Verdict", "Effects", "Model", "Made"], diagnoses.map((each) => [each.result.verdict.replaceAll("_", " "), each.result.findings.map((finding) => titleOf(finding.effect)).join(", ") || MISSING, named.get(each.model_id) ?? each.model_id.slice(0, 8), timeElement(each.created_utc)])));
  place("cell-models").replaceChildren(...(parts.length ? parts : [none("None yet. A model that is fitted to runs of the cell stands here, as do diagnoses of its runs.")]));
}

function events(found) {
  place("cell-events").replaceChildren(el("ul", { class: "events" }, found.map((event) => el("li", {}, timeElement(event.created_utc), chip(...wordFor("severity", event.severity)), el("span", { class: "event-text", text: event.text })))));
}

async function load() {
  const cell = await api.cell(cellId);
  facts(cell);
  changeForm(cell);
  for (const section of document.querySelectorAll(".of-a-cell")) section.hidden = false;
  await below(cell);
}

async function below(cell) {
  const [ran, models, diagnoses, happened] = await Promise.all([api.runs({ cell_id: cell.id, limit: 200 }), api.modelsOf(cell.id), api.diagnosesOf(cell.id), api.cellEvents(cell.id)]);
  runs(cell, ran);
  results(models, diagnoses, diagnoses.length ? await effectTitles() : String);
  events(happened);
}

// What is typed stays while something else happens to the cell.
const again = async () => { const cell = await api.cell(cellId); facts(cell); await below(cell); };
sidePage(new State(), { onEvent: (event) => { if (event.cell_id?.toLowerCase() === cellId.toLowerCase()) again().catch(() => {}); } });
load().catch((error) => place("cell-facts").replaceChildren(el("h1", { text: `Cell ${cellId}` }), el("p", { class: "form-message", text: error.message })));
