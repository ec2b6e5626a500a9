// ECharts in the page's colours, without inline styles, alive through resizes and a change of the colour scheme.
import { el } from "./dom.js";
import { MISSING, clock, fixed } from "./format.js";

const SCHEME = matchMedia("(prefers-color-scheme: dark)");
const charts = new Set();
SCHEME.addEventListener("change", () => charts.forEach((chart) => chart.redraw()));

/** The page's colours by name, read from its style sheet. */
export function palette() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "ink-2", "line", "surface", "voltage", "current", "soc", "model", "residual", "temperature", "good", "bad", "neutral", "heat-none", "heat-high", "heat-low"];
  const colours = names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]);
  return { ...Object.fromEntries(colours), font: getComputedStyle(document.body).fontFamily };
}

/** A chart whose whole option comes from `option(palette)`; `redraw()` after the data changed. */
export class Chart {
  constructor(node, option) {
    this.node = node;
    this.option = option;
    this.plot = window.echarts.init(node, null, { renderer: "canvas" });
    this.watch = new ResizeObserver(() => this.plot.resize());
    this.watch.observe(node);
    charts.add(this);
    this.redraw();
  }

  redraw() {
    this.plot.setOption({ animation: false, ...this.option(palette()) }, { notMerge: true, lazyUpdate: true });
  }

  /** New data in the same form, or a part of the option: keeps zoom, pointer and tooltip where they are. */
  update(change = this.option(palette())) {
    this.plot.setOption(change, { lazyUpdate: true });
  }

  dispose() {
    charts.delete(this);
    this.watch.disconnect();
    this.plot.dispose();
  }
}

const LEFT = 64;
const RIGHT = 16;
const STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400];

/** Ticks between two test times, at times that a clock has too; the distance is whole days beyond the table. */
export function timeTicks(from, to) {
  const step = STEPS_S.find((each) => (to - from) / each <= 8) ?? 86400 * Math.ceil((to - from) / 86400 / 8);
  const first = Math.ceil(from / step);
  return Array.from({ length: Math.max(0, Math.floor(to / step) - first + 1) }, (_, k) => step * (first + k));
}

/** Stacked grids over the time axis [from, to] in s: rows of {name, unit, top, height} in percent. */
export function timeGrids(colours, rows, [from, to]) {
  const text = { color: colours["ink-2"], fontSize: 12 };
  const customValues = timeTicks(from, to);
  const common = { type: "value", axisLabel: text, axisLine: { lineStyle: { color: colours.line } } };
  return {
    textStyle: { fontFamily: colours.font },
    grid: rows.map((row) => ({ left: LEFT, right: RIGHT, top: row.top, height: row.height })),
    xAxis: rows.map((_, index) => ({
      ...common, gridIndex: index, splitLine: { show: false }, axisLine: { ...common.axisLine, onZero: index < rows.length - 1 }, min: from, max: to,
      name: index === rows.length - 1 ? `test time / ${to >= 3600 ? "h:min:s" : "min:s"}` : "", nameLocation: "middle", nameGap: 22,
      nameTextStyle: text,
      axisLabel: { ...text, show: index === rows.length - 1, customValues, formatter: (value) => clock(value, to >= 3600), hideOverlap: true },
      axisTick: { show: index === rows.length - 1, customValues }, axisPointer: { label: { show: false } },
    })),
    yAxis: rows.map((row, index) => ({
      ...common, gridIndex: index, scale: true, splitNumber: 3, name: `${row.name} / ${row.unit}`,
      nameTextStyle: { color: colours.ink, align: "left", padding: [0, 0, 0, 8 - LEFT], fontSize: 12 }, nameGap: 10,
      splitLine: { lineStyle: { color: colours.line, opacity: 0.5 } }, min: row.min, max: row.max, interval: row.interval, minInterval: row.minInterval,
      axisLabel: { ...text, formatter: row.label ?? ((value) => fixed(value, row.axisDigits ?? decimals(value))) },
    })),
    axisPointer: { link: [{ xAxisIndex: "all" }] },
  };
}

/** Axis range and tick distance in percent around fractions of charge. */
export function socRange(lowest, highest) {
  const [low, high] = [Math.max(0, 100 * lowest), Math.min(100, 100 * highest)];
  const interval = [5, 10, 25, 50].find((step) => (high - low) / step <= 3) ?? 50;
  const min = Math.min(100 - interval, interval * Math.floor(low / interval));
  return { min, max: Math.max(min + interval, interval * Math.ceil(high / interval)), interval };
}

function decimals(value) {
  const text = String(Math.round(value * 1e6) / 1e6);
  return text.includes(".") ? Math.min(3, text.split(".")[1].length) : 0;
}

export function line(name, colour, index, data, more = {}) {
  return {
    name, type: "line", xAxisIndex: index, yAxisIndex: index, data, showSymbol: false, animation: false,
    lineStyle: { width: 1.6, color: colour }, itemStyle: { color: colour }, ...more,
  };
}

/** A band between columns 1 and 2 of `data` over column 0, as one polygon. */
export function band(name, colour, index, data) {
  return {
    name, type: "custom", xAxisIndex: index, yAxisIndex: index, data, silent: true, clip: true, progressive: 0,
    encode: { x: 0, y: [1, 2], tooltip: [] }, itemStyle: { color: colour, opacity: 0.2 }, tooltip: { show: false },
    renderItem(params, api) {
      if (params.dataIndexInside !== 0) return null;
      const upper = data.map((row) => api.coord([row[0], row[2]]));
      const lower = data.map((row) => api.coord([row[0], row[1]])).reverse();
      return { type: "polygon", shape: { points: [...upper, ...lower] }, style: { fill: colour, opacity: 0.2 }, silent: true };
    },
  };
}

/** A tooltip made of elements: the page's policy refuses ECharts' own, which carries inline styles. */
export function tooltip(rows) {
  const units = new Map(rows.map((row) => [row.series, row]));
  return {
    trigger: "axis", className: "chart-tip", confine: true, transitionDuration: 0, axisPointer: { type: "line", animation: false },
    formatter(params) {
      // Halfway between two points ECharts names both: one row per series is enough.
      const shown = params.filter((item, k) => units.has(item.seriesName) && params.findIndex((one) => one.seriesName === item.seriesName) === k);
      if (!shown.length) return "";
      return el("div", {}, el("div", { class: "tip-time", text: `${clock(shown[0].value[0])} of test time` }),
        shown.map((item) => tipRow(item, units.get(item.seriesName))));
    },
  };
}

function tipRow(item, row) {
  const value = item.value[1];
  const extra = row.extra ? row.extra(item.value) : "";
  return el("div", { class: "tip-row" }, el("span", { class: "swatch", data: { colour: row.colour } }), el("span", { text: item.seriesName }),
    el("strong", { text: Number.isFinite(value) ? `${fixed(value, row.digits)} ${row.unit}${extra}` : MISSING }));
}

/** A legend in the page's own text, with the same swatches as the tooltip. */
export function legend(entries) {
  return el("ul", { class: "legend" }, entries.map(([colour, text]) =>
    el("li", {}, el("span", { class: "swatch", data: { colour } }), text)));
}
