// A model is made of runs that are there: own ones and imported ones alike.
import { api } from "./api.js";
import { el } from "./dom.js";
import { moduleFields } from "./improve-module.js";
import { usedRuns } from "./improve-roles.js";

const STRUCTURES = [
  ["auto", "let the data choose"],
  ["bounded", "physical by construction"],
  ["full", "the whole method"],
  ["minimal", "state of charge and current only"],
];

/** Fields and a button; `fit(job)` takes the job of a fit that has begun, `place` is where its progress is shown. `draw()` after the runs in use have changed. */
export function fitForm(view, { fit }) {
  const message = el("p", { class: "form-message", role: "alert" });
  const field = (id, title, props, note) => {
    const input = el("input", { id, autocomplete: "off", ...props });
    return [input, el("div", { class: "field" }, el("label", { for: id, text: title }), input, note ? el("span", { class: "about", text: note }) : null)];
  };
  const [name, nameField] = field("fit-name", "Name of the model", { maxlength: 200, value: "model" });
  const [capacity, capacityField] = field("fit-capacity", "Capacity of the cell / Ah", { inputmode: "decimal", required: true });
  const module = moduleFields((whole) => { capacityField.firstChild.textContent = `Capacity of the ${whole ? "module" : "cell"} / Ah`; });
  const [known, knownField] = field("fit-soc-std", "SoC at the start known within / %", { inputmode: "decimal", placeholder: "0" }, "0: exactly");
  const structure = el("select", { id: "fit-structure" }, STRUCTURES.map(([value, text]) => el("option", { value, text: `${value}: ${text}` })));
  const uses = el("p", { class: "about" });
  const button = el("button", { type: "submit", text: "Fit a model" });
  capacity.addEventListener("input", () => { capacity.dataset.said = "1"; });

  const number = (input) => Number(input.value.trim().replace(",", "."));
  const fault = ({ train }) => {
    if (!train.length) return "Set at least one run above to “learn from it”.";
    if (!capacity.value || !(number(capacity) > 0)) return "Give the capacity in Ah, above 0.";
    if (module.fault()) return module.fault();
    if (known.value && !(number(known) >= 0 && number(known) <= 50)) return "Give how well the SoC at the start is known, 0 to 50 %.";
    return name.value.trim() ? "" : "Give the model a name.";
  };
  const submit = async (event) => {
    event.preventDefault();
    const { train, judge } = usedRuns(view);
    message.textContent = fault({ train });
    if (message.textContent) return;
    button.disabled = true;
    try {
      await fit(await api.fit({ name: name.value.trim(), train, validate: judge, capacity_Ah: number(capacity), structure: structure.value, initial_soc_std: number(known) / 100 || 0, module: module.asked() }));
    } catch (error) {
      message.textContent = error.message;
    } finally {
      button.disabled = false;
    }
  };
  const form = el("form", { class: "fit-form", "aria-label": "Fit a model", novalidate: true, on: { submit } },
    el("div", { class: "fields" }, nameField, capacityField, el("div", { class: "field" }, el("label", { for: "fit-structure", text: "Structure" }), structure), knownField),
    module.node, uses, el("div", { class: "form-end" }, button, message));
  form.addEventListener("input", () => { message.textContent = ""; });
  const place = el("div");
  const box = el("details", { class: "more fit" }, el("summary", { text: "Make a model from runs" }), form, place);

  const draw = () => {
    const { train, judge } = usedRuns(view);
    const names = (ids) => ids.map((id) => view.runs.find((run) => run.id === id)?.name ?? id.slice(0, 8)).join(", ") || "none";
    uses.textContent = `Learns from: ${names(train)}. Judged by: ${names(judge)}. Choose in the table above.`;
    module.draw(view.models);
    const first = view.runs.find((run) => train.includes(run.id));
    if (first?.capacity_Ah && !capacity.dataset.said) capacity.value = String(Number(first.capacity_Ah.toPrecision(6)));
    // Before there is any model, making one is the way on.
    button.className = view.models.length ? "" : "primary";
    if (!view.models.length && view.runs.length && !box.dataset.opened) { box.open = true; box.dataset.opened = "1"; }
  };
  return { node: box, place, draw };
}
