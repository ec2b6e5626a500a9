// What a campaign came to: figures first, then the two pictures behind them. Missing keys are left out.
import { api } from "./api.js";
import { legend } from "./charts.js";
import { el, renderKeyed } from "./dom.js";
import { count, duration, percent, quantity } from "./format.js";
import { reportLinks } from "./report-links.js";
import { overlayChart, socChart } from "./result-charts.js";
import { GLOSSARY } from "./words.js";

/** Returns `show(campaign)`; null, or a campaign without a result, empties the place. */
export function campaignResult(state, root) {
  let plots = [];
  return (campaign) => {
    const result = campaign?.result;
    const key = result ? `${campaign.id} ${JSON.stringify(result)}` : "none";
    if (root.dataset.key === key) return;
    for (const plot of plots) plot.dispose();
    plots = [];
    renderKeyed(root, key, () => (result ? build(campaign, (plot) => plots.push(plot)) : []));
  };
}

function build({ id, result }, keep) {
  const validate = (result.runs ?? []).filter((run) => run.role === "validate");
  return [
    el("div", { class: "result-figures" }, figures(result)),
    reportLinks("campaigns", id, "the campaign"),
    result.comparison_id ? overlay(result.comparison_id, keep) : null,
    validate.length ? soc(validate.at(-1).run_id, keep) : null,
    tables(result),
  ];
}

function figures(result) {
  const { validation = {}, soc = {} } = result;
  const missed = (result.runs ?? []).reduce((sum, run) => sum + (run.missed_ticks ?? 0), 0);
  const noise = result.sensor_noise_mV;
  const against = Number.isFinite(noise) ? `noise floor ${quantity(noise, 1, "mV")}` : "on data that the fit never saw";
  return [
    figure("Held-out voltage error", quantity(validation.rmse_mV, 2, "mV"), `RMS, ${against}`),
    figure("SoC error of the live observer", percent(soc.rmse ?? NaN, 2), Number.isFinite(soc.converged_after_s)
      ? `RMSE after convergence at ${duration(soc.converged_after_s)}` : "RMSE over the whole run, not converged"),
    figure("Samples stored", count(result.samples), `${(result.runs ?? []).length} runs, ${missed} missed ticks`),
    figure("Time taken", duration(result.seconds), "from design to report"),
  ];
}

export function figure(title, value, note) {
  return el("div", { class: "figure" }, GLOSSARY[title] ? el("abbr", { class: "figure-title", title: GLOSSARY[title], text: title }) : el("span", { class: "figure-title", text: title }), el("strong", { text: value }), el("span", { class: "about", text: note }));
}

function tables({ runs = [], validation = {}, soc = {}, model_chain: chain = [], model_id }) {
  const errors = [["RMSE", validation.rmse_mV], ["mean absolute", validation.mae_mV], ["95th percentile", validation.p95_mV],
    ["largest", validation.max_mV], ["bias", validation.bias_mV]].filter(([, value]) => Number.isFinite(value))
    .map(([name, value]) => [`Voltage error, ${name}`, quantity(value, 2, "mV")]);
  if (Number.isFinite(soc.rmse)) errors.push(["SoC error, RMSE", percent(soc.rmse, 2)]);
  if (Number.isFinite(soc.max_error)) errors.push(["SoC error, largest", percent(soc.max_error, 2)]);
  if (Number.isFinite(soc.converged_after_s)) errors.push(["Observer within 3 % after", duration(soc.converged_after_s)]);
  return el("div", { class: "result-tables" },
    table("Errors on the held-out run", ["Figure", "Value"], errors),
    table("Runs of the campaign", ["Run", "Used as", "Samples", "Missed ticks"], runs.map((run) => [
      el("code", { text: String(run.run_id).slice(0, 8), title: run.run_id }), { train: "training", validate: "held out" }[run.role] ?? run.role,
      count(run.n_samples), count(run.missed_ticks)])),
    chain.length > 1 || model_id ? table("Models", ["Model", "Effect added", "Held-out RMSE"], modelRows(chain, model_id, validation)) : null);
}

function modelRows(chain, modelId, validation) {
  const rows = chain.length ? chain : [{ model: modelId, effect: null, validation_rmse_mV: validation.rmse_mV }];
  return rows.map((row) => [el("a", { href: `/api/v1/models/${encodeURIComponent(row.model)}`, title: row.model }, String(row.model).slice(0, 8)),
    row.effect ?? "none, first model", quantity(row.validation_rmse_mV, 2, "mV")]);
}

export function table(caption, heads, rows) {
  if (!rows.length) return null;
  return el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": caption }, el("table", {}, el("caption", { text: caption }),
    el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col", text: head })))),
    el("tbody", {}, rows.map((row) => el("tr", {}, row.map((cell, index) => el("td", { data: { label: heads[index] } }, cell)))))));
}

/** A place for a chart that fills itself, and says so when it cannot. */
export function chartBox(title, entries, label, load, keep) {
  const note = el("p", { class: "empty", text: "Loading …" });
  const plot = el("div", { class: "plot tall", role: "img", "aria-label": label, hidden: true });
  const box = el("div", { class: "result-chart" }, el("h3", { class: "chart-title", text: title }), legend(entries), note, plot);
  load().then((draw) => {
    if (!box.isConnected) return;
    note.remove();
    plot.hidden = false;
    keep(draw(plot));
  }).catch((error) => { note.textContent = `Cannot be shown: ${error.message}`; });
  return box;
}

function overlay(comparisonId, keep) {
  return chartBox("Held-out run: measured and model", [["voltage", "measured"], ["model", "model, from current and temperature alone"], ["residual", "residual = measured − model"]],
    "Measured and modelled voltage over test time, residual below", async () => {
      const run = (await api.comparisonSeries(comparisonId))?.runs?.at(-1);
      if (!run?.time_s?.length) throw new Error("the comparison has no series.");
      return (node) => overlayChart(node, run);
    }, keep);
}

function soc(runId, keep) {
  return chartBox("Live observer against the coulomb counter", [["soc", "observer, band 95 %"], ["ink", "coulomb counter"], ["residual", "difference"]],
    "State of charge of the observer and of the coulomb counter over test time, their difference below", async () => {
      const [run, samples, observer] = await Promise.all([api.run(runId), api.samples(runId, { points: 4000, columns: "time_s,charge_Ah" }), api.observer(runId, { points: 2000 })]);
      if (!observer?.columns?.time_s?.length) throw new Error("no observer ran in this run.");
      return (node) => socChart(node, run, samples.columns, observer.columns);
    }, keep);
}

