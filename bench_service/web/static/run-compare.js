// Other things on the same axes: a model of choice, and other runs.
import { api } from "./api.js";
import { el, renderKeyed } from "./dom.js";
import { quantity } from "./format.js";
import { ENDED } from "./run-data.js";
import { RUN_COLOURS } from "./run-plot.js";

const SERIES_POINTS = 5000;

/** Curves of the model for the part that is looked at, as fine as the picture needs. */
export async function loadCompared(shown, { from, to }) {
  const comparison = shown.comparison;
  if (!comparison) return;
  const series = await api.comparisonSeries(comparison, { from_s: from ?? undefined, to_s: to ?? undefined, points: SERIES_POINTS });
  if (shown.comparison !== comparison) return; // another model was chosen meanwhile
  for (const data of shown.runs) data.compared = series.runs.find((run) => run.run_id === data.run.id) ?? data.compared;
}

export function comparePanel(shown, { draw, load, addRun, removeRun }) {
  const message = el("p", { class: "form-message", role: "alert" });
  const answer = el("p", { class: "about", role: "status" });
  const chips = el("ul", { class: "run-chips", "aria-label": "Runs on the plot" });
  const models = el("select", { id: "run-model", on: { change: () => compare(models.value || null) } }, el("option", { value: "", text: "no model" }));
  const others = el("select", { id: "run-other" });
  const add = el("button", { type: "button", id: "run-add", text: "Add to the plot", on: { click: async () => {
    message.textContent = "";
    try { await addRun(others.value); } catch (error) { message.textContent = error.message; }
  } } });

  async function compare(modelId) {
    message.textContent = "";
    shown.model = modelId;
    shown.comparison = null;
    for (const data of shown.runs) data.compared = null;
    if (modelId) {
      answer.textContent = "The model is simulated over the run …";
      try {
        await simulate(shown, modelId, load, (text) => { answer.textContent = text; });
      } catch (error) {
        answer.textContent = "";
        message.textContent = error.message;
      }
      if (shown.model !== modelId) return; // another one was chosen meanwhile
      if (shown.runs[0].compared) showResidual(shown);
    } else {
      answer.textContent = "";
    }
    draw();
  }

  fill();
  async function fill() {
    const [found, runs] = await Promise.all([api.models().catch(() => []), api.runs({ limit: 200 }).catch(() => [])]);
    models.append(...found.map((model) => el("option", { value: model.id, text: `${model.name} (${model.structure}, ${quantity(model.capacity_Ah, 2, "Ah")})`, selected: model.id === shown.model })));
    others.append(...runs.filter((run) => run.id !== shown.runs[0].run.id).map((run) => el("option", { value: run.id, text: `${run.label ?? run.name ?? run.id.slice(0, 8)}, ${run.bench}, ${run.state}` })));
    add.disabled = !others.options.length;
    if (shown.model) compare(shown.model);
  }

  const show = () => renderKeyed(chips, JSON.stringify(shown.runs.map((data) => [data.run.id, data.name])), () => (shown.runs.length < 2 ? [] : shown.runs.map((data, k) => {
    const swatch = el("span", { class: "swatch", data: { colour: RUN_COLOURS[k % RUN_COLOURS.length] } });
    const remove = k ? el("button", { type: "button", class: "small", text: "Remove", "aria-label": `Remove ${data.name}`, on: { click: () => removeRun(data.run.id) } }) : null;
    return el("li", {}, swatch, k ? el("a", { href: `/runs/${data.run.id}`, text: data.name }) : data.name, remove);
  })));
  const node = el("div", { class: "compare-form" },
    el("div", { class: "field" }, el("label", { for: "run-model", text: "Compare with model" }), models),
    el("div", { class: "field" }, el("label", { for: "run-other", text: "Another run on the same plot" }), el("div", { class: "form-end" }, others, add)),
    chips, answer, message);
  return { node, show };
}

/** The free run of a model over each run that has ended: drawn with the measured voltage, its error as a signal. */
async function simulate(shown, modelId, load, tell) {
  const ended = shown.runs.filter((data) => ENDED.includes(data.run.state));
  if (!ended.length) throw new Error("A model is compared with a run that has ended.");
  const comparison = await api.compare({ model_id: modelId, run_ids: ended.map((data) => data.run.id) });
  if (shown.model !== modelId) return;
  shown.comparison = comparison.id;
  await load();
  const { rmse_mV: rmse, max_mV: most } = comparison.result.overall;
  tell(`Model, from current and temperature alone: RMS error ${quantity(rmse, 2, "mV")}, largest ${quantity(most, 1, "mV")}.`);
}

function showResidual({ rows }) {
  if (rows.some((row) => row.left === "residual" || row.right === "residual")) return;
  const free = rows.find((row) => !row.left && !row.right);
  if (free) free.left = "residual";
  else if (rows.length < 4) rows.push({ left: "residual", right: null });
}
