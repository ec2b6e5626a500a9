// Pictures of an error: a map over two variables, what each finding would leave, and how it fell from version to version.
import { Chart } from "./charts.js";
import { el } from "./dom.js";
import { fixed } from "./format.js";

const NAMES = { soc: "SoC / %", current_A: "Current / A", temperature_degC: "Cell temperature / °C" };
const SCALE = { soc: 100 };

function axis(colours, { variable, edges }, extra) {
  const scale = SCALE[variable] ?? 1;
  const end = (edge) => fixed(edge * scale, Number.isInteger(Math.round(edge * scale * 100) / 100) ? 0 : 1);
  const labels = edges.slice(0, -1).map((edge, k) => `${end(edge)}…${end(edges[k + 1])}`);
  return {
    type: "category", data: labels, name: NAMES[variable] ?? variable, splitArea: { show: false }, axisTick: { show: false },
    axisLine: { lineStyle: { color: colours.line } }, axisLabel: { color: colours["ink-2"], fontSize: 12, hideOverlap: true },
    nameTextStyle: { color: colours.ink, fontSize: 12 }, ...extra,
  };
}

function tip(rows) {
  return el("div", {}, rows.map(([name, value], k) => el("div", { class: k ? "tip-row" : "tip-time" }, el("span", { text: name }), value ? el("strong", { text: value }) : null)));
}

const tipStyle = { className: "chart-tip", confine: true, transitionDuration: 0 };

/** `what` is "rmse_mV" (size) or "bias_mV" (measured minus model, with its sign). */
export function heatMap(node, map, what) {
  const cells = map[what].flatMap((row, y) => row.map((value, x) => [x, y, value])).filter((cell) => Number.isFinite(cell[2]));
  const most = Math.max(...cells.map((cell) => Math.abs(cell[2])), 0.1);
  return new Chart(node, (colours) => {
    const range = what === "bias_mV" ? [colours["heat-low"], colours["heat-none"], colours["heat-high"]] : [colours["heat-none"], colours["heat-high"]];
    const x = axis(colours, map.x, { nameLocation: "middle", nameGap: 26 });
    const y = axis(colours, map.y, { nameLocation: "end", nameTextStyle: { color: colours.ink, fontSize: 12, align: "left", padding: [0, 0, 0, -70] } });
    return {
      textStyle: { fontFamily: colours.font }, grid: { left: 92, right: 84, top: 28, bottom: 44 }, xAxis: x, yAxis: y,
      visualMap: { min: what === "bias_mV" ? -most : 0, max: most, inRange: { color: range }, calculable: false, orient: "vertical", right: 4, top: "middle",
        itemHeight: 130, itemWidth: 12, text: [`${fixed(most, 0)} mV`, what === "bias_mV" ? `${fixed(-most, 0)}` : "0"], textStyle: { color: colours["ink-2"] } },
      tooltip: { ...tipStyle, formatter: ({ data: [col, row, value] }) => tip([[`${x.name} ${x.data[col]}, ${y.name} ${y.data[row]}`],
        [what === "bias_mV" ? "mean of measured − model" : "RMS error", `${fixed(value, 1)} mV`],
        ["share of the time", `${fixed(100 * map.share_of_time[row][col], 1)} %`]]) },
      series: [{ type: "heatmap", data: cells, label: { show: true, color: colours.ink, fontSize: 11, formatter: ({ data }) => fixed(data[2], 0) },
        itemStyle: { borderColor: colours.surface, borderWidth: 1 }, emphasis: { itemStyle: { borderColor: colours.ink } } }],
    };
  });
}

function floorLine(colours, floor) {
  if (!Number.isFinite(floor)) return undefined;
  return { silent: true, symbol: "none", data: [{ yAxis: floor }], lineStyle: { color: colours["ink-2"], type: "dashed" },
    label: { formatter: `noise\n${fixed(floor, 1)} mV`, color: colours["ink-2"], position: "end", fontSize: 12, lineHeight: 15 } };
}

function valueAxis(colours) {
  return { type: "value", min: 0, name: "Held-out error / mV", nameTextStyle: { color: colours.ink, align: "left", padding: [0, 0, 0, -40], fontSize: 12 },
    axisLabel: { color: colours["ink-2"] }, splitLine: { lineStyle: { color: colours.line, opacity: 0.5 } } };
}

const categories = (colours, data, room) => ({ type: "category", data, axisTick: { show: false }, axisLine: { lineStyle: { color: colours.line } },
  axisLabel: { color: colours["ink-2"], interval: 0, width: Math.max(64, Math.min(140, room / data.length - 8)), overflow: "break", fontSize: 12, lineHeight: 15 } });
const barGrid = { left: 56, right: 58, top: 30, bottom: 66 };

function bar(colours, { before, after, kept, now }) {
  const fell = after <= before;
  const colour = now ? colours.voltage : !Number.isFinite(before) ? colours.neutral : fell ? colours.good : colours.bad;
  return {
    value: Number.isFinite(before) ? Math.abs(before - after) : after,
    itemStyle: kept ? { color: colour } : { color: "transparent", borderColor: colour, borderWidth: 1.5, borderType: "dashed" },
    // At the end where the error has gone to.
    label: { show: true, position: Number.isFinite(before) && fell ? "bottom" : "top", color: colours.ink, fontWeight: kept ? 600 : 400, formatter: `${fixed(after, 2)} mV` },
  };
}

/** Floating bars of versions `{id, label, before, after, kept, now}`; one without `before` stands on the ground. `choose(id)` on a click. */
export function waterfall(node, versions, floor, choose) {
  const chart = new Chart(node, (colours) => ({
    textStyle: { fontFamily: colours.font }, grid: barGrid, xAxis: categories(colours, versions.map((each) => each.label), node.clientWidth - 120),
    yAxis: valueAxis(colours),
    tooltip: { ...tipStyle, formatter: ({ dataIndex: k }) => tip([[versions[k].label], ["held-out error", `${fixed(versions[k].after, 2)} mV`],
      ...(Number.isFinite(versions[k].before) ? [["its parent's, same runs", `${fixed(versions[k].before, 2)} mV`]] : []),
      ...(versions[k].kept ? [] : [["tried, not in this chain", ""]])]) },
    series: [
      { type: "bar", stack: "error", silent: true, itemStyle: { color: "transparent" }, barMaxWidth: 90,
        data: versions.map(({ before, after }) => (Number.isFinite(before) ? Math.min(before, after) : 0)) },
      { type: "bar", stack: "error", barMaxWidth: 90, barMinHeight: 3, markLine: floorLine(colours, floor),
        data: versions.map((each) => bar(colours, each)) },
    ],
  }));
  chart.plot.on("click", ({ dataIndex }) => choose(versions[dataIndex].id));
  return chart;
}

/** Bars of the error that would be left with each finding, below the present one. */
export function errorLeft(node, before, findings, floor) {
  return new Chart(node, (colours) => {
    const line = floorLine(colours, floor);
    if (line) Object.assign(line, { data: [{ xAxis: floor }], label: { ...line.label, position: "start", formatter: `noise ${fixed(floor, 1)} mV` } });
    return {
      textStyle: { fontFamily: colours.font }, grid: { left: 138, right: 62, top: 26, bottom: 40 },
      yAxis: { ...categories(colours, ["as it is", ...findings.map((each) => each.label)], Infinity), inverse: true },
      xAxis: { ...valueAxis(colours), name: "Error / mV", nameLocation: "middle", nameGap: 24, nameTextStyle: { color: colours.ink, fontSize: 12 } },
      series: [{ type: "bar", barMaxWidth: 34, markLine: line, data: [before, ...findings.map((each) => each.after)].map((value, k) => ({
        value, itemStyle: { color: k ? colours.good : colours.neutral },
        label: { show: true, position: "right", color: colours.ink, fontWeight: 600, formatter: `${fixed(value, 2)} mV` },
      })) }],
    };
  });
}

const PROFILE = {
  soc: ["SoC / %", 100], soc_at_rest: ["SoC / %, at rest", 100], since_step_s: ["time since the last current step / s", 1], current_A: ["current / A", 1],
  time_h: ["test time / h", 1], throughput_Ah: ["charge moved / Ah", 1], temperature_degC: ["cell temperature / °C", 1],
};

/** What a variable is called in a sentence. */
export const variableName = (name) => PROFILE[name]?.[0].replace(/ \/ [^,]*/, "") ?? name.replaceAll("_", " ");

// With the page's own minus sign.
const plain = (value) => String(value).replace("-", "\u2212");

/** Mean error over one variable, apart for the direction of the last current. */
export function profileChart(node, profile) {
  const [name, scale] = PROFILE[profile.variable] ?? [profile.variable, 1];
  const logarithmic = profile.variable === "since_step_s";
  const points = (values) => profile.at.map((at, k) => [at * scale, values[k]]);
  const unit = profile.quantity === "resistance_mOhm" ? "mΩ" : "mV";
  return new Chart(node, (colours) => {
    const text = { color: colours["ink-2"], fontSize: 12 };
    const line = (title, colour, values) => ({ name: title, type: "line", data: points(values), showSymbol: true, symbolSize: 5, connectNulls: true, lineStyle: { width: 2, color: colour }, itemStyle: { color: colour } });
    return {
      textStyle: { fontFamily: colours.font }, grid: { left: 48, right: 16, top: 26, bottom: 40 },
      xAxis: { type: logarithmic ? "log" : "value", scale: true, name, nameLocation: "middle", nameGap: 24, nameTextStyle: { color: colours.ink, fontSize: 12 }, axisLabel: { ...text, formatter: plain },
        axisLine: { lineStyle: { color: colours.line }, onZero: false }, splitLine: { show: false } },
      yAxis: { type: "value", name: `${unit === "mV" ? "Measured − model" : "Missing resistance"} / ${unit}`, nameTextStyle: { color: colours.ink, align: "left", padding: [0, 0, 0, -36], fontSize: 12 }, axisLabel: { ...text, formatter: plain },
        splitLine: { lineStyle: { color: colours.line, opacity: 0.5 } } },
      tooltip: { ...tipStyle, trigger: "axis", axisPointer: { type: "line", animation: false },
        formatter: (items) => tip([[`${name.split(" / ")[0]} ${fixed(items[0].value[0], 1)}`], ...items.map((item) => [item.seriesName, Number.isFinite(item.value[1]) ? `${fixed(item.value[1], 1)} ${unit}` : "–"])]) },
      series: [line("after charge", colours.voltage, profile.after_charge), line("after discharge", colours.current, profile.after_discharge)],
    };
  });
}
