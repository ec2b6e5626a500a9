// Voltage, current and SoC of the run in progress, or of the last one.
import { Chart, band, legend, line, socRange, timeGrids, tooltip } from "./charts.js";
import { el, setText } from "./dom.js";
import { BAND, duration, fixed } from "./format.js";
import { wordFor } from "./words.js";

const WINDOWS = [["2 min", 120], ["10 min", 600], ["1 h", 3600], ["whole run", Infinity]];
const REDRAW_MS = 250;
const ROWS = [
  { name: "Voltage", unit: "V", minInterval: 0.001, top: "7%", height: "30%" }, { name: "Current", unit: "A", minInterval: 0.01, top: "46%", height: "18%" },
  { name: "SoC", unit: "%", top: "73%", height: "15%" },
];
const ROWS_WITHOUT_SOC = [{ name: "Voltage", unit: "V", minInterval: 0.001, top: "7%", height: "43%" }, { name: "Current", unit: "A", minInterval: 0.01, top: "59%", height: "29%" }];

/** Build the chart of one bench and keep it up to date; ends by itself when another bench takes its place. */
export function liveChart(state, traces, name) {
  const trace = traces.get(name);
  // In lock-step an hour of test time passes in seconds: a window of minutes would only flicker.
  const view = { window_s: state.benches.get(name).lock_step ? Infinity : 600, dirty: true };
  const title = el("h3", { class: "chart-title", text: name });
  const empty = el("p", { class: "empty over", text: "No run yet. Start a test or a campaign below: voltage, current and state of charge appear here." });
  const whole = el("a", { class: "run-link", hidden: true, text: "Open the run" });
  const plot = el("div", { class: "plot", role: "img", "aria-label": `Voltage, current and state of charge of ${name} over test time` });
  const node = el("div", { class: "bench-chart" },
    el("header", { class: "chart-head" }, title, whole, windowChooser(view, trace)),
    legend([["voltage", "voltage"], ["current", "current"], ["soc", "state of charge with 95 % band, where an observer runs"]]),
    el("div", { class: "plot-box" }, plot, empty));
  let chart = null;
  const draw = () => {
    if (!node.isConnected) return;
    drawTitle(state, trace, title, name);
    whole.hidden = !trace.runId;
    if (trace.runId) whole.href = `/runs/${encodeURIComponent(trace.runId)}`;
    empty.hidden = trace.points.length > 0;
    if (!view.dirty || document.hidden || !trace.points.length) return;
    view.dirty = false;
    chart ??= new Chart(plot, (colours) => option(colours, trace, view));
    // The number of grids changes with the first known SoC: everything anew, else only the data.
    const form = trace.points.some((point) => Number.isFinite(point.soc));
    if (form === view.form) chart.update();
    else chart.redraw();
    view.form = form;
  };
  const timer = setInterval(() => {
    if (node.isConnected || !node.dataset.seen) return draw();
    clearInterval(timer);
    chart?.dispose();
  }, REDRAW_MS);
  requestAnimationFrame(() => { node.dataset.seen = "yes"; });
  state.on("trace", (changed) => { if (changed === name) view.dirty = true; });
  return node;
}

function windowChooser(view, trace) {
  trace.window_s = view.window_s;
  const select = el("select", { on: { change: () => {
    view.window_s = Number(select.value);
    view.dirty = true;
    trace.show(view.window_s).then(() => { view.dirty = true; }, (error) => console.warn(error.message));
  } } },
    WINDOWS.map(([text, seconds]) => el("option", { value: seconds, text, selected: seconds === view.window_s })));
  return el("label", { class: "inline" }, "Show ", select);
}

function drawTitle(state, trace, node, name) {
  if (!trace.runId) return setText(node, "Live");
  const bench = state.benches.get(name);
  const running = bench?.run_id === trace.runId;
  const run = state.runs?.find((known) => known.id === trace.runId) ?? trace.run;
  const what = run?.name ?? `run ${trace.runId.slice(0, 8)}`;
  const length = trace.points.length ? `, ${duration(trace.points.at(-1).t)} of test time` : "";
  const outcome = run && run.state !== "running" ? `, ${wordFor("run", run.state)[1]}` : "";
  return setText(node, running ? `Live: ${what}${length}` : `Last run: ${what}${outcome}${length}`);
}

function inWindow(points, window_s) {
  const from = points.at(-1).t - window_s;
  return from > points[0].t ? points.slice(points.findIndex((point) => point.t >= from)) : points;
}

const pick = (points, key, scale = 1) => points.map((point) => [point.t, Number.isFinite(point[key]) ? point[key] * scale : null]);

function option(colours, trace, view) {
  const points = inWindow(trace.points, view.window_s);
  const known = points.filter((point) => Number.isFinite(point.soc));
  const end = points.at(-1).t;
  const [voltage, current, soc] = ROWS;
  const rows = known.length ? [voltage, current, { ...soc, ...socSpan(known) }] : ROWS_WITHOUT_SOC;
  return {
    ...timeGrids(colours, rows, [points[0].t, Math.max(end, points[0].t + 1)]),
    tooltip: tooltip([
      { series: "Voltage", colour: "voltage", digits: 4, unit: "V" },
      { series: "Current", colour: "current", digits: 3, unit: "A" },
      { series: "SoC", colour: "soc", digits: 1, unit: "%", extra: (value) => (Number.isFinite(value[2]) ? ` ± ${fixed(value[2], 1)} %` : "") },
    ]),
    series: [
      line("Voltage", colours.voltage, 0, pick(points, "v")),
      line("Current", colours.current, 1, pick(points, "i"), { step: "start", areaStyle: { color: colours.current, opacity: 0.12, origin: 0 } }),
      ...(known.length ? socSeries(colours, known) : []),
    ],
  };
}

function socSpan(known) {
  const values = known.map((point) => point.soc);
  return socRange(values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b)));
}

function socSeries(colours, known) {
  const half = ({ std }) => (Number.isFinite(std) ? 100 * BAND * std : null);
  const edges = known.filter((point) => half(point) !== null)
    .map((point) => [point.t, Math.max(0, 100 * point.soc - half(point)), Math.min(100, 100 * point.soc + half(point))]);
  return [
    band("SoC band", colours.soc, 2, edges),
    line("SoC", colours.soc, 2, known.map((point) => [point.t, 100 * point.soc, half(point)])),
  ];
}
