// The form that starts a campaign: sensible defaults, the bench's own limits, the service's verdict beside the field.
import { api } from "./api.js";
import { el } from "./dom.js";
import { duration } from "./format.js";

/** `started(campaign)` after the service took it. */
export function campaignForm(state, started) {
  const message = el("p", { class: "form-message", role: "alert" });
  const submit = el("button", { class: "primary", type: "submit", text: "Start campaign" });
  const length = el("p", { class: "hint", id: "campaign-length", "aria-live": "polite" });
  const bench = select("bench", [...state.benches.keys()], state.selected);
  const form = el("form", { class: "campaign-form", novalidate: true, "aria-label": "Start a campaign" },
    el("p", { class: "hint", text: "Designs a current profile, plays it, fits a model, observes a second run live and compares. All within the bench's limits." }),
    el("div", { class: "fields" },
      field("Bench", bench), field("Name", input("name", "text", defaultName(), { required: true, maxlength: 80 })),
      field("Duration per run", input("duration_s", "number", 15000, { min: 60, step: 60, required: true }), "s"),
      field("Sample period", input("dt_s", "number", 1, { min: 0.01, step: "any", required: true }), "s"),
      field("Seed", input("seed", "number", 1, { min: 0, step: 1, required: true }))),
    el("details", { class: "more" }, el("summary", { text: "Cell and ranges" }), el("div", { class: "fields" }, rangeFields())),
    length, el("div", { class: "form-end" }, submit, message));
  const prefill = () => fillFromBench(form, state.benches.get(bench.value));
  bench.addEventListener("change", prefill);
  prefill();
  form.addEventListener("change", () => tellLength(form, length));
  tellLength(form, length);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    await send(form, submit, message, started);
  });
  return form;
}

/** Hours of real time, said before anything starts; what the service would refuse says nothing until it is sent. */
async function tellLength(form, node) {
  const asked = (node.dataset.asked = String(Number(node.dataset.asked ?? 0) + 1));
  const told = await api.estimateCampaign(body(form)).catch(() => null);
  if (node.dataset.asked !== asked) return;
  if (!told || told.refused) node.textContent = "";
  else if (told.hours === null) node.textContent = `${told.runs} runs, ${duration(told.test_s)} of test time, ${told.basis}.`;
  else node.textContent = `${told.runs} runs take about ${duration(told.real_s)} of real time, the fits not counted.`;
}

function defaultName() {
  const now = new Date();
  const two = (n) => String(n).padStart(2, "0");
  return `test ${now.getFullYear()}-${two(now.getMonth() + 1)}-${two(now.getDate())} ${two(now.getHours())}:${two(now.getMinutes())}`;
}

function input(name, type, value, more = {}) {
  return el("input", { id: `campaign-${name}`, name, type, value, autocomplete: "off", ...more });
}

function select(name, options, chosen) {
  return el("select", { id: `campaign-${name}`, name }, options.map((text) => el("option", { value: text, text, selected: text === chosen })));
}

function field(title, control, unit = "") {
  const error = el("span", { class: "field-error", id: `${control.id}-error` });
  control.setAttribute("aria-describedby", error.id);
  return el("div", { class: "field" }, el("label", { for: control.id, text: unit ? `${title} / ${unit}` : title }), control, error);
}

function rangeFields() {
  const any = { step: "any" };
  return [
    field("Capacity", input("capacity_Ah", "number", "", any), "Ah"),
    field("Lowest current", input("current_A.0", "number", "", any), "A"),
    field("Highest current", input("current_A.1", "number", "", any), "A"),
    field("Lowest SoC", input("soc.0", "number", "", { ...any, min: 0, max: 100 }), "%"),
    field("Highest SoC", input("soc.1", "number", "", { ...any, min: 0, max: 100 }), "%"),
    field("SoC at the start", input("initial_soc", "number", "", { ...any, min: 0, max: 100, placeholder: "as configured" }), "%"),
    field("After a crash or power cut", select("on_interruption", ["stop", "resume"], "stop")),
    field("Model structure", select("structure", ["auto", "bounded", "full", "minimal"], "auto")),
    field("Effects left out of the model", input("without", "text", "", { placeholder: "none; or hysteresis, relaxation" })),
  ];
}

function fillFromBench(form, bench) {
  // Left empty, the service chooses within the bench's limits; those are shown, and the capacity with them.
  const show = (name, value) => { form.elements[name].placeholder = Number.isFinite(value) ? `auto, limit ${value}` : "auto"; };
  form.elements.capacity_Ah.value = Number.isFinite(bench?.capacity_Ah) ? String(bench.capacity_Ah) : "";
  for (const end of [0, 1]) {
    show(`current_A.${end}`, bench?.limits?.current_A?.[end]);
    show(`soc.${end}`, Math.round(1000 * bench?.limits?.soc?.[end]) / 10);
  }
}

function range(form, name, scale) {
  const ends = [0, 1].map((end) => form.elements[`${name}.${end}`].valueAsNumber / scale);
  return ends.every(Number.isFinite) ? ends : undefined;
}

/** The empty end of a range whose other end is given. */
function halfRange(form) {
  const empty = (name) => !form.elements[name].value;
  return ["current_A", "soc"].flatMap((name) => [[`${name}.0`, `${name}.1`], [`${name}.1`, `${name}.0`]])
    .find(([one, other]) => empty(one) && !empty(other))?.[0];
}

const names = (text) => { const found = text.split(/[\s,]+/).filter(Boolean); return found.length ? found : undefined; };

/** The request; what is left empty is left out, so that the service's own default holds. */
function body(form) {
  const number = (name, scale = 1) => { const value = form.elements[name].valueAsNumber / scale; return Number.isFinite(value) ? value : undefined; };
  return {
    bench: form.elements.bench.value, name: form.elements.name.value.trim(), seed: number("seed"), dt_s: number("dt_s"),
    duration_s: number("duration_s"), capacity_Ah: number("capacity_Ah"), current_A: range(form, "current_A", 1),
    soc: range(form, "soc", 100), initial_soc: number("initial_soc", 100), structure: form.elements.structure.value,
    on_interruption: form.elements.on_interruption.value, without: names(form.elements.without.value),
  };
}

async function send(form, submit, message, started) {
  for (const node of form.querySelectorAll(".field-error")) node.textContent = "";
  message.textContent = "";
  const wrong = [...form.elements].find((control) => control.willValidate && !control.checkValidity());
  if (wrong) return complain(form, message, wrong.validationMessage, [wrong.name]);
  const half = halfRange(form);
  if (half) return complain(form, message, "Give both ends of the range, or neither.", [half]);
  submit.disabled = true;
  try {
    started(await api.startCampaign(body(form)));
  } catch (error) {
    complain(form, message, error.message, error.where);
  } finally {
    submit.disabled = false;
  }
  return undefined;
}

/** Put the message at the field that `where` names, else under the form. */
function complain(form, message, text, where) {
  const path = where.map(String);
  const control = [path.join("."), ...path, `${path.at(-1)}.0`, `${path.at(-2)}.${path.at(-1)}`]
    .map((name) => form.elements.namedItem(name)).find(Boolean);
  if (!control) {
    message.textContent = text;
    return;
  }
  control.closest("details")?.setAttribute("open", "");
  document.getElementById(`${control.id}-error`).textContent = text;
  control.focus();
}
