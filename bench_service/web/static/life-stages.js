// dQ/dV and dV/dQ over a cell's life: measured, and by the model of the cell as it was, on the same axes.
import { Chart, line } from "./charts.js";
import { el } from "./dom.js";
import { fixed } from "./format.js";

const KINDS = [
  { key: "dQ_dV_Ah_per_V", x: "voltage_V", title: "dQ/dV", unit: "Ah/V", over: "voltage / V", width: (each) => `${(1e3 * each.width_V).toFixed(0)} mV` },
  { key: "dV_dQ_V_per_Ah", x: "charge_Ah", title: "dV/dQ", unit: "V/Ah", over: "charge since the start / Ah", width: (each) => `${fixed(each.width_Ah, 3)} Ah` },
];
const WAYS = ["charge", "discharge"];
const COLOURS = ["voltage", "soc", "current", "residual"]; // of the runs, the oldest first
const STEEP = 5; // over the median: a held voltage, or the ends of a curve, would flatten all that lies between

/** Headings and plots of a life, and what draws them once they are on the page. */
export function stagePlots(life, nameOf) {
  const shown = WAYS.flatMap((way) => {
    const runs = (life.stages ?? []).filter((each) => each.way === way);
    return runs.length ? KINDS.map((kind) => ({ way, kind, runs })) : [];
  });
  const plots = shown.map(({ way, kind, runs }) => ({
    title: el("h3", { text: `${kind.title} of a ${way} over ${kind.over}, smoothed over ${kind.width(runs[0])}` }),
    plot: el("div", { class: "plot life-stages", role: "img", "aria-label": `${kind.title} of ${runs.length} ${way}s over the life, measured and by the model of the cell as it was` }),
  }));
  const about = shown.length ? [el("p", { class: "life-words", text: "Peaks are stages of the electrodes. Lines are measured; dashed is what the model of the cell as it was makes of the same current." })] : [];
  return {
    nodes: [...about, ...plots.flatMap(({ title, plot }) => [title, plot])],
    draw: () => shown.forEach(({ kind, runs }, k) => new Chart(plots[k].plot, (colours) => option(colours, kind, runs, nameOf))),
  };
}

function option(colours, kind, runs, nameOf) {
  const text = { color: colours["ink-2"], fontSize: 12 };
  const points = (each, source) => each[kind.x].map((at, k) => [at, each[source][kind.key][k]]);
  const known = runs.flatMap((each) => each.measured[kind.key]).filter((value) => value > 0).sort((a, b) => a - b);
  const most = STEEP * (known[Math.floor(known.length / 2)] ?? 1);
  const label = { ...text, hideOverlap: true, formatter: (value) => String(Math.round(value * 1e4) / 1e4) };
  const axis = (name, more) => ({ type: "value", name, nameTextStyle: text, axisLabel: label, axisLine: { onZero: false, lineStyle: { color: colours.line } }, ...more });
  const series = runs.flatMap((each, k) => {
    const colour = colours[COLOURS[k % COLOURS.length]];
    const name = nameOf(each.run);
    const drawn = (source, type) => ({ ...line(name, colour, 0, points(each, source)), connectNulls: false, lineStyle: { width: 1.5, color: colour, type } });
    return [drawn("measured", "solid"), { ...drawn("model", [4, 3]), name: `${name}, model` }];
  });
  return {
    textStyle: { fontFamily: colours.font }, grid: { left: 64, right: 20, top: 58, bottom: 44 }, series,
    legend: { type: "scroll", top: 0, right: 10, left: 10, data: runs.map((each) => nameOf(each.run)), textStyle: { color: colours.ink }, itemHeight: 8 },
    xAxis: axis(kind.over, { scale: true, nameLocation: "middle", nameGap: 26, splitLine: { show: false } }),
    yAxis: axis(`${kind.title} / ${kind.unit}`, { min: 0, max: Number(most.toPrecision(2)), axisLabel: { ...label, showMaxLabel: false }, nameTextStyle: { ...text, color: colours.ink, align: "left", padding: [0, 0, 0, -56] }, splitLine: { lineStyle: { color: colours.line, opacity: 0.5 } } }),
  };
}
