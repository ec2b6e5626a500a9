// Steps 2 and 3: how far the model is off, and where.
import { api } from "./api.js";
import { chartBox, figure } from "./campaign-result.js";
import { el } from "./dom.js";
import { heatMap } from "./error-charts.js";
import { MISSING, fixed, percent, quantity } from "./format.js";
import { moduleTables } from "./improve-module.js";
import { inText, parameterText } from "./improve-which.js";
import { reportLinks } from "./report-links.js";
import { overlayChart } from "./result-charts.js";

/** `titleOf(effect)`: what it is called; `unitOf(effect, parameter)`: in what a correction's size is given. */
export function compareStep(comparison, runs, { titleOf, unitOf }, keep) {
  const { overall, expected_rmse_mV: expected, overall_fitted_start: fitted, noise_floor_mV: floor, outside_training: outside, outside: guessed, inside_training: known, temperature, band, whiteness, corrections = [] } = comparison.result;
  const times = Number.isFinite(floor) && floor > 0 ? `${(overall.rmse_mV / floor).toFixed(1)} times the noise floor of ${quantity(floor, 1, "mV")}` : "noise floor unknown";
  const names = new Map(runs.map((run) => [run.id, run.name ?? String(run.id).slice(0, 8)]));
  return [
    el("div", { class: "result-figures" },
      figure("Voltage error", quantity(overall.rmse_mV, 2, "mV"), `RMS, from current and temperature alone; ${Number.isFinite(expected) ? `${quantity(expected, 1, "mV")} expected where these runs go; ` : ""}${times}`),
      figure("95 % of the samples below", quantity(overall.p95_mV, 1, "mV"), `largest ${quantity(overall.max_mV, 1, "mV")}`),
      fitted ? figure("With its start fitted too", quantity(fitted.rmse_mV, 2, "mV"), startWords(comparison.result.runs)) : null,
      whiteness ? figure("Cannot be foretold", quantity(whiteness.white_mV, 2, "mV"), whitenessWords(whiteness)) : null,
      figure("Outside what the model knows", percent(outside, 1), guessed && known
        ? `of the samples: there it only guesses, ${quantity(guessed.rmse_mV, 1, "mV")}; inside ${quantity(known.rmse_mV, 1, "mV")}` : "of the samples: there it only guesses"),
      band?.coverage_95_inside !== undefined && band?.coverage_95_inside !== null ? figure("Inside the 95 % band", percent(band.coverage_95_inside, 0), "of the samples that the model knows") : null,
      temperature?.rmse_K !== undefined ? figure("Temperature error", quantity(temperature.rmse_K, 2, "K"), "RMS") : null),
    corrections.length ? el("p", { class: "about", text: `The runs are read as the model was made: ${corrections.map((each) => correctionWords(each, titleOf, unitOf)).join(", ")}.` }) : null,
    moduleTables(comparison.result.module),
    reportLinks("comparisons", comparison.id, "the comparison"),
    overlay(comparison, names, keep),
  ];
}

/** Where the voltage says that the runs begin. */
function startWords(runs) {
  const soc = runs.map(({ initial_soc: { value, std } }) => `${percent(value, 1)}${Number.isFinite(std) ? ` ± ${fixed(100 * std, 1)}` : ""}`);
  return `SoC at the start by all of the voltage: ${soc.join(", ")}`;
}

/** An error that hangs together can be foretold, so a better model would not make it. */
function whitenessWords({ white_share: share, correlation_time_s: time_s }) {
  if (share >= WHITE || !Number.isFinite(time_s)) return "nothing that a model could foretell is left";
  return `${percent(1 - share, 0)} of the squared error hangs together, for about ${roughly(time_s)}`;
}

/** In whole hours, minutes or seconds: it is an estimate. */
function roughly(time_s) {
  const [unit_s, unit] = [[3600, "h"], [60, "min"], [1, "s"]].find(([each]) => time_s >= 1.5 * each) ?? [1, "s"];
  return quantity(time_s / unit_s, 0, unit);
}

function correctionWords({ effect, values }, titleOf, unitOf) {
  return `${inText(titleOf(effect))} (${Object.entries(values).map(([name, value]) => parameterText(name, { value, unit: unitOf(effect, name) })).join(", ")})`;
}

function overlay(comparison, names, keep) {
  const series = api.comparisonSeries(comparison.id);
  const box = el("div", { class: "overlays" });
  const show = (index) => box.replaceChildren(chartBox(`Measured and model: ${names.get(comparison.run_ids[index]) ?? MISSING}`,
    [["voltage", "measured"], ["model", "model, from current and temperature alone"], ["residual", "residual = measured − model"]],
    "Measured and modelled voltage over test time, residual below", async () => {
      const run = (await series)?.runs?.[index];
      if (!run?.time_s?.length) throw new Error("the comparison has no series.");
      return (node) => overlayChart(node, run);
    }, keep));
  show(0);
  if (comparison.run_ids.length === 1) return box;
  const choose = el("select", { "aria-label": "Run shown", on: { change: () => show(Number(choose.value)) } },
    comparison.run_ids.map((id, k) => el("option", { value: k, text: names.get(id) ?? id })));
  return el("div", {}, el("label", { class: "inline" }, "Run", choose), box);
}

const WHITE = 0.9;
const AXES = { current_A: "current", temperature_degC: "temperature" };
const KINDS = [["rmse_mV", "size of the error"], ["bias_mV", "mean error with its sign"]];

/** `result`: of the comparison, which says how much of the error the regions are of. */
export function whereStep(where, result, keep) {
  return el("div", { class: "where" }, regionList(where, result), maps(where.maps, keep));
}

/** The service's words in the units of the page. */
function spoken(text) {
  const percent = (number) => fixed(100 * Number(number), 0);
  return text.replaceAll(" degC", " °C").replace(/SoC (above |below |)(\d\.\d+)(?: to (\d\.\d+))?/g, (_, side, low, high) => `SoC ${side}${percent(low)}${high ? ` to ${percent(high)}` : ""} %`);
}

/** Share of the squared error that lies outside of what the model was trained on. */
function shareOutside({ overall, outside }) {
  return outside ? (outside.n_samples * outside.rmse_mV ** 2) / (overall.n_samples * overall.rmse_mV ** 2) : 0;
}

function regionList({ regions, outside_training: outside }, result) {
  const apart = outside > 0.001 ? el("p", { class: "outside", text: `${percent(shareOutside(result), 0)} of the squared error lies outside what the model was trained on, in ${percent(outside, 1)} of the samples. What follows is of the rest.` }) : null;
  if (!regions.length) return el("div", {}, apart, el("p", { text: "No region stands out: the error is spread evenly." }));
  return el("div", {}, apart, el("ol", { class: "regions", "aria-label": "Where the error is" }, regions.map((region) => {
    const bar = el("span", { class: "share-bar" });
    bar.style.width = `${100 * region.share_of_squared_error}%`;
    const [share, place] = spoken(region.text).split(/: (.*)/s);
    return el("li", {}, el("strong", { text: place }), el("span", { class: "share-track" }, bar), el("span", { class: "about", text: `${share}, ${quantity(region.rmse_mV, 1, "mV")} there` }));
  })));
}

function maps(all, keep) {
  let chart = null;
  const plot = el("div", { class: "plot tall heat", role: "img", "aria-label": "Map of the error over state of charge and a second variable" });
  const [over, kind] = [el("select", { "aria-label": "Second variable" }, all.map((map, k) => el("option", { value: k, text: `SoC and ${AXES[map.y.variable] ?? map.y.variable}`, selected: k === all.length - 1 }))),
    el("select", { "aria-label": "What the map shows" }, KINDS.map(([value, text]) => el("option", { value, text })))];
  const draw = () => {
    chart?.dispose();
    chart = heatMap(plot, all[Number(over.value)], kind.value);
  };
  over.addEventListener("change", draw);
  kind.addEventListener("change", draw);
  requestAnimationFrame(() => { if (plot.isConnected) draw(); });
  keep({ dispose: () => chart?.dispose() });
  return el("div", { class: "map-box" }, el("div", { class: "tools" }, el("label", { class: "inline" }, "Over", over), el("label", { class: "inline" }, "Show", kind)), plot);
}
