// Step 1: which model, which runs, and what one wants to know.
import { api } from "./api.js";
import { el, renderKeyed } from "./dom.js";
import { duration, startElement } from "./format.js";
import { fitForm } from "./improve-fit.js";
import { ROLES, ownRuns, usedRuns } from "./improve-roles.js";

const MODES = [
  ["structure", "What does the model lack?", "It never fitted well enough. An effect is added and the model refitted to the training runs."],
  ["change", "What has changed?", "The model was right. Something in the cell or the rig is new in the runs that are looked at."],
];

/**
 * The form. `view` keeps the choice; `chosen()` starts the comparison, `changed()` when another model or question is taken,
 * `said()` when a run's use is, `fit(job)` when a model is being made.
 * It is built once and `draw()` changes only the lists that are new: news must not wipe a message or what somebody has set.
 */
export function chooseForm(view, { changed, chosen, said, fit }) {
  const making = fitForm(view, { fit });
  const message = el("p", { class: "form-message", role: "alert" });
  const models = el("div", { class: "field" });
  const runs = el("div", { class: "run-list" });
  const compare = el("button", { class: "primary", type: "submit", text: "Compare model and runs" });
  const form = el("form", { class: "improve-form", "aria-label": "Choose model and runs" },
    el("div", { class: "choose-model" }, el("div", {}, models, fileField(view, changed, message)), questions(view, changed)),
    runs, el("div", { class: "form-end" }, compare, message));
  form.addEventListener("change", () => { message.textContent = ""; });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    message.textContent = fault(view);
    if (!message.textContent) chosen();
  });
  const draw = () => {
    renderKeyed(models, JSON.stringify([view.modelId, view.models.map((model) => [model.id, modelText(model)])]), () => modelField(view, changed));
    renderKeyed(runs, JSON.stringify([ownRuns(view), [...view.roles], view.runs.map(({ id, name }) => [id, name])]), () => runTable(view, () => { said(); making.draw(); }));
    // Without a model the way on is to make one.
    compare.className = view.models.length ? "primary" : "";
    making.draw();
  };
  return { node: [form, making.node], place: making.place, draw };
}

function fault(view) {
  if (!view.modelId) return "Choose a model, load one, or make one below.";
  return usedRuns(view).looked.length ? "" : "Choose at least one run to look at.";
}

const modelText = (model) => [model.name, structureText(model), expectedText(model), String(model.id).slice(0, 6)].filter(Boolean).join(" · ");

/** What was asked for and, where that left the choice open, what was taken. */
function structureText({ structure, metrics }) {
  const taken = metrics?.structure;
  return taken && taken !== structure ? `${structure} took ${taken}` : structure;
}

/** Training error and the error that is to be expected on runs that the fit did not see. */
function expectedText({ metrics }) {
  const [own, others] = [metrics?.train?.rmse_mV, metrics?.expected_rmse_mV];
  return Number.isFinite(own) && Number.isFinite(others) ? `${own.toFixed(1)} mV in training, ${others.toFixed(1)} mV expected` : "";
}

function modelField(view, changed) {
  if (!view.models.length) return [el("span", { text: "Model" }), el("p", { class: "empty", text: "No model yet: make one from runs below, run a campaign, or load one." })];
  const select = el("select", { id: "improve-model", on: { change: () => { view.modelId = select.value; changed(); } } },
    view.models.map((model) => el("option", { value: model.id, selected: model.id === view.modelId, text: modelText(model) })));
  return [el("label", { for: "improve-model", text: "Model" }), select, ...usabilityNote(view.models.find((model) => model.id === view.modelId))];
}

/** How far the model can be used, and why: what its own document says; an older one says nothing. */
function usabilityNote(model) {
  const { verdict, reasons } = model?.metrics?.usability ?? {};
  if (!verdict || verdict === "usable") return [];
  return [el("div", { class: "about block usability", role: "note" },
    el("strong", { text: verdict === "unusable" ? "This model cannot be used" : "This model can be used in part" }),
    el("ul", {}, reasons.map((text) => el("li", { text }))))];
}

function fileField(view, changed, message) {
  const file = el("input", { type: "file", id: "improve-file", accept: ".json,application/json", class: "visually-hidden", on: { change: async () => {
    const [chosen] = file.files;
    if (!chosen) return;
    try {
      const record = await api.importModel(JSON.parse(await chosen.text()), chosen.name.replace(/\.json$/i, "").slice(0, 100).trim() || "imported");
      view.models = [record, ...view.models.filter((model) => model.id !== record.id)];
      view.modelId = record.id;
      changed();
    } catch (error) {
      message.textContent = error instanceof SyntaxError ? `${chosen.name} is not JSON: ${error.message}` : error.message;
    } finally {
      file.value = "";
    }
  } } });
  return el("div", { class: "field" }, el("label", { class: "file-button", for: "improve-file" }, "Load a MODEL.json …"), file);
}

function questions(view, changed) {
  return el("fieldset", { class: "questions" }, el("legend", { text: "Question" }), MODES.map(([mode, title, note]) =>
    el("label", { class: "question" }, el("input", { type: "radio", name: "improve-mode", value: mode, checked: mode === view.mode,
      on: { change: () => { view.mode = mode; changed(); } } }),
    el("span", {}, el("strong", { text: title }), el("span", { class: "about block", text: note })))));
}

function runTable(view, said) {
  if (!view.runs.length) return el("p", { class: "empty" }, "No finished run yet. ", el("a", { href: "/import", text: "Import a measured one" }), ", or run a campaign, which makes two.");
  const own = new Set(ownRuns(view));
  const heads = ["Run", "Bench", "Started", "Length", "Use"];
  return el("div", { class: "table-scroll run-choice" }, el("table", { class: "rows named" }, el("caption", { text: "Runs" }),
    el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col", text: head })))),
    el("tbody", {}, view.runs.map((run) => {
      const name = run.name ?? `run ${String(run.id).slice(0, 8)}`;
      const say = () => { view.said.set(run.id, role.value); view.roles.set(run.id, role.value); said(); };
      const role = el("select", { id: `use-of-${run.id}`, "aria-label": `Use of ${name}`, on: { change: say } },
        ROLES.map(([value, text]) => el("option", { value, text, selected: (view.roles.get(run.id) ?? "") === value })));
      const note = own.has(run.id) ? el("span", { class: "about block", text: "the model was made from it" }) : null;
      return el("tr", {}, [el("span", { title: run.id }, name, note), run.bench, startElement(run),
        duration(run.n_samples * run.dt_s), role].map((cell, k) => el("td", { data: { label: heads[k] } }, cell)));
    }))));
}
