// Starts a run: what it will do, how long it takes and what speaks against it is said before.
import { api } from "./api.js";
import { cellChoice } from "./cell-choice.js";
import { el, offer, setText } from "./dom.js";
import { MANUAL_ABOUT, manualFields } from "./manual-setpoint.js";
import { protocolEditor } from "./protocol-editor.js";
import { previewChart } from "./run-preview.js";
import { fillSources, lookAtProfile, lookAtProtocol, parameterFields, stepTable } from "./run-sources.js";

const TYPED_MS = 300;
const AGAIN_MS = 2000; // after a question that the service was too busy for

/** `started(run)` after the service took it. */
export function runStart(state, root, started) {
  const view = { tests: new Map(), fields: null, asked: 0, timer: 0, saved: null, chosen: null, bench: null, unseen: false, atOnce: false };
  const message = el("p", { class: "form-message", role: "alert" });
  const told = el("p", { class: "hint", id: "start-told", role: "status" });
  const about = el("p", { class: "about", id: "start-about" });
  const wrong = el("ul", { class: "form-message", id: "start-wrong" });
  const source = el("select", { id: "start-source", name: "source" });
  const file = el("input", { id: "start-file", type: "file", accept: ".csv,.json,text/csv,application/json", class: "visually-hidden" });
  const dt = input("dt_s", "number", 1, { min: 0.001, max: 3600, step: "any", required: true });
  const soc = input("initial_soc", "number", "", { min: 0, max: 100, step: "any", required: true });
  const name = input("name", "text", "", { maxlength: 200 });
  const operator = input("operator", "text", "", { maxlength: 200 });
  const model = el("select", { id: "start-model", name: "model_id" }, el("option", { value: "", text: "none, charge is counted" }));
  const parameters = el("div", { class: "fields", id: "start-parameters" });
  const steps = el("div", { id: "start-steps" });
  const submit = el("button", { class: "primary", type: "submit", id: "start-submit", text: "Start run", disabled: true });
  const editIt = el("button", { type: "button", id: "start-edit", text: "Edit the steps" });
  const fresh = el("button", { type: "button", id: "start-fresh", text: "Begin anew" });
  const save = el("button", { type: "button", id: "start-save", text: "Save protocol" });
  const editor = protocolEditor(() => state.bench, () => lookSoon());
  const plot = el("div", { class: "plot run-preview", role: "img", "aria-label": "Current over test time, and voltage of a nominal cell or counted state of charge", hidden: true });
  // Another cell stands elsewhere, and has other limits.
  const cell = cellChoice(state, () => { soc.value = ""; believe(state.bench, soc).then(source.value === "manual:" ? choose : look); });
  const form = el("form", { novalidate: true, "aria-label": "Start a run" },
    el("div", { class: "fields" }, cell.node, field("Test, protocol or profile", source), el("div", { class: "field" }, el("span", { class: "about", text: "or a file: a protocol as JSON, or CSV with time_s,current_A" }), file, el("label", { class: "file-button", for: "start-file", text: "Upload a file" })),
      field("Sample period / s", dt), field("SoC now / %", soc), field("Live observer", model), field("Run name", name), field("Operator", operator)),
    about, parameters, el("div", { class: "form-end" }, editIt, fresh), editor.node, plot, told, wrong, steps, el("div", { class: "form-end" }, submit, save, message));
  const details = el("details", { class: "run-start", id: "start-details" }, el("summary", { text: "Start a test" }), form);
  root.replaceChildren(details);
  const draw = previewChart(plot);

  const what = () => {
    const [kind, id] = source.value.split(/:(.*)/s);
    if (kind === "manual") return { kind, body: { document: view.fields.document() } };
    if (kind === "edit") return { kind, body: { document: editor.document() } };
    if (kind === "test") return { kind, body: { standard_test: id, parameters: view.fields?.values() ?? {} } };
    return { kind, id, body: { protocol_id: id } };
  };
  // A run that nobody has named bears the name of what it plays.
  const title = () => (["edit:", "manual:"].includes(source.value) ? what().body.document?.name : source.selectedOptions[0]?.textContent.split(", ")[0].trim()) || undefined;
  const allow = () => {
    const idle = state.bench?.state === "idle";
    submit.disabled = !source.value || !idle || view.atOnce;
    submit.title = state.bench && !idle ? `${state.bench.name} is ${state.bench.state}` : view.atOnce ? "It would be stopped at once" : "";
  };
  const look = async () => {
    const bench = state.bench;
    allow();
    view.unseen = !bench;
    if (!bench || !source.value) return;
    view.asked += 1;
    const asked = view.asked;
    const { kind, id, body } = what();
    const typed = view.fields?.wrong() ?? [];
    const initial = soc.valueAsNumber / 100;
    const seen = typed.length ? { told: "", against: typed, series: null, steps: [] }
      : await (kind === "profile" ? lookAtProfile(id, bench, initial) : lookAtProtocol(body, bench, initial, dt.valueAsNumber)).catch((error) => ({ told: "", against: [error.message], unanswered: error.unanswered, series: null, steps: [] }));
    if (asked !== view.asked) return; // something else was typed meanwhile
    view.atOnce = Boolean(seen.atOnce);
    allow();
    if (seen.unanswered) lookSoon(AGAIN_MS);
    const atStep = kind === "edit" && editor.object(seen.where ?? [], seen.against[0] ?? "");
    setText(told, atStep ? "It cannot be played like this: see the step." : seen.told);
    wrong.replaceChildren(...(atStep ? [] : seen.against).map((text) => el("li", { text })));
    steps.replaceChildren(...(kind === "edit" ? [] : stepTable(seen.steps)));
    draw(seen.series);
  };
  const lookSoon = (in_ms = TYPED_MS) => {
    clearTimeout(view.timer);
    view.timer = setTimeout(look, in_ms);
  };
  const choose = () => {
    const [kind, id] = source.value.split(/:(.*)/s);
    view.chosen = source.value;
    const test = kind === "test" ? view.tests.get(id) : null;
    view.fields = test ? parameterFields(test) : kind === "manual" ? manualFields(state.bench) : null;
    setText(about, test?.sentence ?? (kind === "manual" ? MANUAL_ABOUT : ""));
    parameters.replaceChildren(...(view.fields?.nodes ?? []));
    editIt.hidden = kind !== "test" && kind !== "protocol";
    editor.node.hidden = fresh.hidden = save.hidden = kind !== "edit";
    if (kind === "edit" && !editor.document() && !editor.draft()) editor.begin();
    return look();
  };
  const list = async (chosen) => {
    const asked = api.models().catch(() => []);
    // What can be chosen can be played: nothing is waited for in between.
    await fillSources(source, chosen, (tests) => { view.tests = tests; });
    const models = await asked;
    model.replaceChildren(model.firstElementChild, ...models.map((each) => el("option", { value: each.id, text: `${each.name} (${each.structure})` })));
    // What was typed for the same source stays.
    await (source.value === view.chosen ? look() : choose());
  };
  details.addEventListener("toggle", () => {
    if (!details.open) return;
    view.bench = state.bench?.name;
    believe(state.bench, soc).then(look);
    cell.list();
    list();
  });
  source.addEventListener("change", choose);
  form.addEventListener("input", (event) => {
    if (event.target === source || event.target === file || event.target.id === "start-cell") return;
    lookSoon();
  });
  const edit = async () => {
    const { kind, id, body } = what();
    const { document } = await (kind === "protocol" ? api.protocol(id) : api.previewProtocol({ ...body, bench: state.bench.name }));
    editor.open(kind === "test" ? { ...document, name: `${document.name}, edited` } : document);
    source.value = "edit:";
    await choose();
    editor.focus();
  };
  /** Store what the editor has; once, as long as it stays the same. */
  const stored = async (body) => {
    const text = JSON.stringify([body, state.bench.name]);
    if (view.saved?.text !== text) view.saved = { text, id: (await api.addProtocol({ ...body, bench: state.bench.name })).id };
    return view.saved.id;
  };
  const tell = (work) => async () => {
    message.textContent = "";
    try { await work(); } catch (error) { message.textContent = error.message; }
  };
  editIt.addEventListener("click", tell(edit));
  fresh.addEventListener("click", () => { editor.begin(); editor.focus(); look(); });
  save.addEventListener("click", tell(async () => {
    const { body } = what();
    await stored(body);
    await list("edit:");
    setText(told, `Saved as ${body.document.name}. ${told.textContent}`);
  }));
  file.addEventListener("change", () => upload(file, state, list, (text) => { message.textContent = text; }));
  state.on("benches", () => {
    if (!view.unseen || !state.bench) return allow();
    // Opened before any bench was known: now it can be asked where its cell stands.
    view.unseen = false;
    view.bench = state.bench.name;
    believe(state.bench, soc).then(source.value === "manual:" ? choose : look);
  });
  state.on("select", () => {
    if (!details.open) return;
    // Another cell stands elsewhere; but what was typed before the first bench was known is of that one.
    if (view.bench && view.bench !== state.bench?.name) soc.value = "";
    view.bench = state.bench?.name;
    believe(state.bench, soc).then(source.value === "manual:" ? choose : look);
  });
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    message.textContent = "";
    const missing = [dt, soc].find((control) => !control.checkValidity());
    if (missing) { message.textContent = `${missing === dt ? "Sample period" : "SoC now"}: ${missing.validationMessage}`; missing.focus(); return; }
    submit.disabled = true;
    try {
      const { kind, id, body } = what();
      const played = kind === "profile" ? { profile_id: id } : { protocol_id: kind === "protocol" ? id : await stored(body) };
      const order = { bench: state.bench.name, ...played, dt_s: dt.valueAsNumber, initial_soc: soc.valueAsNumber / 100, name: name.value.trim() || title(), model_id: model.value || undefined };
      const run = await api.startRun(order);
      if (operator.value.trim()) await api.describeRun(run.id, { operator: operator.value.trim() });
      details.open = false;
      started(run);
    } catch (error) {
      message.textContent = error.message;
    }
    allow();
  });
}

function input(name, type, value, more) {
  return el("input", { id: `start-${name}`, name, type, value, autocomplete: "off", ...more });
}

function field(title, control) {
  return el("div", { class: "field" }, el("label", { for: control.id, text: title }), control);
}

/** A profile as CSV, or a protocol as JSON: stored, and chosen. */
async function upload(file, state, list, say) {
  const [chosen] = file.files;
  file.value = "";
  if (!chosen) return;
  say("");
  try {
    const text = await chosen.text();
    if (/\.json$/i.test(chosen.name)) await list(`protocol:${(await api.addProtocol({ document: JSON.parse(text), bench: state.bench?.name })).id}`);
    else await list(`profile:${(await api.addProfile(text, chosen.name.replace(/\.csv$/i, "") || "profile")).id}`);
  } catch (error) {
    say(error instanceof SyntaxError ? `${chosen.name} is not JSON: ${error.message}` : error.message);
  }
}

/** Where the cell stands, as far as that is known. */
async function believe(bench, soc) {
  if (!bench || soc.value) return;
  const known = await api.standing(bench.name).catch(() => null);
  if (known) offer(soc, String(Math.round(1000 * known.soc) / 10));
}
