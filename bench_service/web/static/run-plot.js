// The plot of a run: stacked rows over one axis, each with a left and a right axis; what is drawn is what was loaded.
import { Chart, band, line, timeTicks } from "./charts.js";
import { el } from "./dom.js";
import { MISSING, clock, fixed } from "./format.js";
import { SIGNALS, chargeAt, signalOf, stretches } from "./run-signals.js";

const [LEFT, RIGHT, TOP, GAP, BOTTOM] = [66, 66, 30, 44, 46];
const ROW_PX = { 1: 420, 2: 230, 3: 180, 4: 150 };
// Of several runs on one plot each has its colour; the first keeps those of its signals where it is alone.
export const RUN_COLOURS = ["voltage", "current", "soc", "residual", "temperature", "neutral"];
const WIDE = 0.06; // of the view: a narrower stretch has no room for its word
const STRETCH = { gap: "bad", paused: "neutral", suspect: "bad" };
/** As many decimals as a tick needs, and no more. */
const short = (value) => fixed(value, Math.abs(value) < 10 ? 4 : Math.abs(value) < 1000 ? 3 : 1).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");

export class RunPlot {
  /** `state` is read at each drawing: runs, rows, over, view, cursors, events. */
  constructor(node, state) {
    Object.assign(this, { node, state });
    this.size();
    this.chart = new Chart(node, (colours) => this.option(colours));
  }

  size() {
    const n = Math.max(1, this.rows.length);
    this.heights = { row: ROW_PX[n], all: TOP + n * ROW_PX[n] + (n - 1) * GAP + BOTTOM };
    this.node.style.height = `${this.heights.all}px`;
  }

  get rows() {
    return this.state.rows.filter((row) => row.left || row.right);
  }

  draw() {
    this.size();
    this.chart.redraw();
  }

  /** The value of the axis under a place in the node, null beside the rows. */
  at(x) {
    const [from, to] = this.chart.plot.getModel().getComponent("xAxis", 0).axis.scale.getExtent();
    const width = this.node.clientWidth - LEFT - RIGHT;
    return from + ((x - LEFT) / width) * (to - from);
  }

  inside(x, y) {
    return x >= LEFT && x <= this.node.clientWidth - RIGHT && y >= TOP && y <= this.heights.all - BOTTOM;
  }

  option(colours) {
    const { rows } = this;
    const { view, over } = this.state;
    const text = { color: colours["ink-2"], fontSize: 12 };
    const axes = rows.map((row, k) => ({ top: TOP + k * (this.heights.row + GAP), row, k }));
    return {
      textStyle: { fontFamily: colours.font },
      grid: axes.map(({ top }) => ({ left: LEFT, right: RIGHT, top, height: this.heights.row })),
      xAxis: axes.map(({ k }) => this.xAxis(colours, text, k, k === rows.length - 1, over === "time" ? view : this.chargeSpan())),
      yAxis: axes.flatMap(({ row, k }) => ["left", "right"].map((side) => yAxis(colours, text, k, row[side], side, this.noteOf(row[side])))),
      axisPointer: { link: [{ xAxisIndex: "all" }] },
      tooltip: { trigger: "axis", className: "chart-tip", confine: true, transitionDuration: 0, axisPointer: { type: "line", animation: false }, formatter: (found) => this.tip(found) },
      series: this.series(colours),
    };
  }

  xAxis(colours, text, k, last, view) {
    const time = this.state.over === "time";
    const ticks = time ? { customValues: timeTicks(view.from, view.to) } : {};
    const shown = time ? { formatter: (value) => clock(value, view.to >= 3600), ...ticks } : { formatter: (value) => short(value) };
    return {
      type: "value", gridIndex: k, min: view.from, max: view.to,
      splitLine: { show: false }, axisLine: { onZero: false, lineStyle: { color: colours.line } }, nameLocation: "middle", nameGap: 24, nameTextStyle: text,
      name: last ? (time ? `test time / ${view.to >= 3600 ? "h:min:s" : "min:s"}` : "charge / Ah") : "",
      axisLabel: { ...text, show: last, hideOverlap: true, ...shown }, axisTick: { show: last, ...ticks }, axisPointer: { label: { show: false } },
    };
  }

  series(colours) {
    const { runs, over } = this.state;
    const several = runs.length > 1;
    const all = this.rows.flatMap((row, k) => [["left", 2 * k], ["right", 2 * k + 1]].flatMap(([side, axis]) => runs.flatMap((data, n) => {
      const signal = signalOf(row[side]);
      if (!signal) return [];
      const found = signal.of(data);
      if (!found.values) return [];
      const colour = colours[several ? RUN_COLOURS[n % RUN_COLOURS.length] : signal.colour];
      const name = several ? `${signal.title} · ${data.name}` : signal.title;
      const x = over === "time" ? found.time_s : chargeAt(data, found.time_s);
      const more = { step: signal.hold ?? false, lineStyle: { width: 1.6, color: colour, type: side === "right" ? [6, 3] : "solid" } };
      const drawn = [place(line(name, colour, k, pairs(x, found.values), more), k, axis)];
      if (found.half && !several && over === "time") drawn.unshift(place(band(`${name} band`, colour, k, edges(x, found)), k, axis));
      if (signal.key === "voltage" && data.compared) drawn.push(place(line(several ? `Model · ${data.name}` : "Model", colours.model, k, pairs(over === "time" ? data.compared.time_s : chargeAt(data, data.compared.time_s), data.compared.model_V), { lineStyle: { width: 1.4, color: colours.model } }), k, axis));
      // What is around the cell belongs beside its temperature where a chamber makes it.
      if (signal.key === "temperature" && !several && data.run.commissioning?.chamber) drawn.push(place(line("Ambient", colours.neutral, k, pairs(x, data.samples.ambient_degC), { lineStyle: { width: 1.4, color: colours.neutral } }), k, axis));
      return drawn;
    })));
    const marked = new Set();
    for (const each of all) {
      if (each.type !== "line" || marked.has(each.xAxisIndex) || over !== "time") continue;
      marked.add(each.xAxisIndex);
      Object.assign(each, marks(colours, this.state, each.xAxisIndex === 0));
    }
    return all;
  }

  tip(found) {
    const rows = found.filter((item, k) => !item.seriesName.endsWith(" band") && found.findIndex((one) => one.seriesName === item.seriesName) === k);
    if (!rows.length) return "";
    const at = rows[0].value[0];
    return el("div", {}, el("div", { class: "tip-time", text: this.state.over === "time" ? `${clock(at)} of test time, ${fixed(at, 1)} s` : `${fixed(at, 4)} Ah` }),
      rows.map((item) => {
        const { unit, digits } = this.unitOf(item.seriesName);
        const swatch = el("span", { class: "swatch" });
        swatch.style.setProperty("--swatch", item.color);
        const value = item.value[1];
        return el("div", { class: "tip-row" }, swatch, el("span", { text: item.seriesName }), el("strong", { text: Number.isFinite(value) ? `${fixed(value, digits)} ${unit}` : MISSING }));
      }));
  }

  /** Charge of all runs in the part that is loaded, on round figures. */
  chargeSpan() {
    const all = this.state.runs.flatMap((data) => data.samples.charge_Ah ?? []);
    if (!all.length) return { from: 0, to: 1 };
    const [low, high] = [Math.min, Math.max].map((pick) => all.reduce((a, b) => pick(a, b)));
    const step = 10 ** Math.floor(Math.log10(Math.max(high - low, 1e-6))) / 5;
    return { from: step * Math.floor(low / step), to: step * Math.ceil(high / step + 1e-9) };
  }

  /** What must be said of a signal beside its name, where that is so of every run: a counted SoC is none that was observed. */
  noteOf(key) {
    const notes = this.state.runs.map((data) => signalOf(key)?.of(data).note ?? "");
    return new Set(notes).size === 1 ? notes[0] : "";
  }

  unitOf(name) {
    const title = name.split(" · ")[0];
    const keys = this.rows.flatMap((row) => [row.left, row.right]);
    return [...keys.map(signalOf), ...SIGNALS].find((signal) => signal?.title === title) ?? signalOf("voltage");
  }

  dispose() {
    this.chart.dispose();
  }
}

function yAxis(colours, text, k, key, position, note) {
  const signal = signalOf(key);
  return {
    type: "value", gridIndex: k, position, scale: true, splitNumber: 4, show: Boolean(signal), axisLine: { show: position === "right", onZero: false, lineStyle: { color: colours.line } },
    name: signal ? [[signal.title, note].filter(Boolean).join(", "), signal.unit].filter(Boolean).join(" / ") : "", nameGap: 14, axisTick: { show: position === "right" },
    nameTextStyle: { color: colours.ink, fontSize: 12, align: position, padding: position === "left" ? [0, 0, 0, 8 - LEFT] : [0, 8 - RIGHT, 0, 0] },
    splitLine: { show: position === "left", lineStyle: { color: colours.line, opacity: 0.5 } }, axisLabel: { ...text, formatter: short },
  };
}

const pairs = (x, values) => (x ?? []).map((t, k) => [t, Number.isFinite(values[k]) ? values[k] : null]);
const edges = (x, { values, half }) => x.map((t, k) => [t, Math.max(0, values[k] - half[k]), Math.min(100, values[k] + half[k])]).filter((row) => row.every(Number.isFinite));
const place = (series, xAxisIndex, yAxisIndex) => ({ ...series, xAxisIndex, yAxisIndex });

/** Cursors, events and stretches without good samples, on the first line of a row. */
function marks(colours, { runs: [data], cursors, events, view }, labelled) {
  const wide = (from, to) => to - from > WIDE * (view.to - view.from);
  const upright = (x, name, colour, dash) => ({ xAxis: x, name, lineStyle: { color: colour, type: dash, width: 1.4 }, label: { show: labelled, formatter: name, color: colour, fontSize: 12, distance: 3 } });
  const lines = [
    ...["a", "b"].filter((which) => Number.isFinite(cursors[which])).map((which) => upright(cursors[which], which.toUpperCase(), colours.ink, "solid")),
    ...events.filter((event) => Number.isFinite(event.at)).map((event) => upright(event.at, String(event.number), colours[event.severity === "info" ? "neutral" : "bad"], [2, 4])),
  ];
  const areas = stretches(data).map(({ from, to, kind }) => [
    { xAxis: from, name: kind, itemStyle: { color: colours[STRETCH[kind]], opacity: 0.16 }, label: { show: labelled && wide(from, to), color: colours["ink-2"], fontSize: 12 } }, { xAxis: to },
  ]);
  return {
    markLine: { symbol: "none", silent: true, animation: false, data: lines },
    markArea: { silent: true, animation: false, data: areas },
  };
}
