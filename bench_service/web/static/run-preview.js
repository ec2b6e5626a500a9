// What a run will do, as far as that is known before: drawn, and in words.
import { Chart, line, timeTicks } from "./charts.js";
import { clock, duration, fixed, localMoment } from "./format.js";

const MOST_POINTS = 4000;
const DAY_S = 86400;

/** Draws {time_s, current_A, and voltage_V of a nominal cell or soc in percent}; null hides it. */
export function previewChart(node) {
  let [chart, shown] = [null, null];
  return (series) => {
    node.hidden = !series?.time_s.length;
    if (node.hidden) return;
    shown = series;
    if (chart) chart.redraw();
    else chart = new Chart(node, (colours) => option(colours, shown));
  };
}

/** Hours and finish; a bench in lock-step has none. */
export function lengthWords(bench, length_s, about = "") {
  if (!Number.isFinite(length_s)) return "Takes longer than was looked at.";
  if (bench.lock_step) return `Takes ${about}${duration(length_s)} of test time (${fixed(length_s / 3600, 2)} h), in lock-step as fast as the machine can.`;
  const done = localMoment(new Date(Date.now() + 1000 * length_s));
  const hours = length_s > DAY_S ? `${duration(length_s)}, ${fixed(length_s / 3600, 1)} h` : `${fixed(length_s / 3600, 2)} h (${duration(length_s)})`;
  return `Takes ${about}${hours} of real time: started now, it is done at ${done}.`;
}

function option(colours, { time_s, current_A, voltage_V, soc }) {
  const text = { color: colours["ink-2"], fontSize: 12 };
  const end = Math.max(time_s.at(-1), 1);
  const customValues = timeTicks(0, end);
  const second = voltage_V ? ["Voltage / V", colours.voltage, voltage_V] : ["SoC / %", colours.soc, soc];
  const known = second[2]?.every(Number.isFinite);
  const axis = (name, position) => ({ type: "value", scale: true, splitNumber: 3, position, name, nameTextStyle: { color: colours.ink, fontSize: 12, align: position }, axisLabel: text, axisLine: { lineStyle: { color: colours.line } }, splitLine: { show: position === "left", lineStyle: { color: colours.line, opacity: 0.5 } } });
  const rows = (values) => thinned(time_s.map((t, k) => [t, values[k]]));
  return {
    textStyle: { fontFamily: colours.font }, grid: { left: 56, right: 56, top: 28, bottom: 42 },
    xAxis: { type: "value", min: 0, max: end, name: `test time / ${end >= 3600 ? "h:min:s" : "min:s"}`, nameLocation: "middle", nameGap: 22, nameTextStyle: text, splitLine: { show: false }, axisLine: { onZero: false, lineStyle: { color: colours.line } }, axisTick: { customValues }, axisLabel: { ...text, customValues, formatter: (value) => clock(value, end >= 3600), hideOverlap: true } },
    yAxis: [axis("Current / A", "left"), { ...axis(second[0], "right"), show: Boolean(known) }],
    series: [
      { ...line("Current", colours.current, 0, rows(current_A)), step: "end", yAxisIndex: 0 },
      { ...line("second", second[1], 0, known ? rows(second[2]) : []), yAxisIndex: 1, lineStyle: { width: 1.6, color: second[1], type: [6, 3] } },
    ],
  };
}

/** A long profile is drawn of each so-many-th row and the row before it: a sketch, not data. */
function thinned(rows) {
  const every = Math.ceil((2 * rows.length) / MOST_POINTS);
  return every < 2 ? rows : rows.filter((_, k) => k % every === 0 || k % every === every - 1 || k === rows.length - 1);
}
