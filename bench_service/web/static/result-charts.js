// The two pictures of a campaign's result: voltage with its residual, SoC with its difference.
import { Chart, band, line, socRange, timeGrids, timeTicks, tooltip } from "./charts.js";
import { BAND } from "./format.js";

const ROWS = { upper: { top: "7%", height: "46%" }, lower: { top: "62%", height: "18%" } };
const number = (value, scale = 1) => (Number.isFinite(value) ? value * scale : null);
const pairs = (time_s, values, scale) => time_s.map((t, k) => [t, number(values?.[k], scale)]);

function zoom(colours) {
  const axes = { xAxisIndex: [0, 1], filterMode: "none" };
  return [
    // The plain wheel scrolls the page; Ctrl and the wheel zoom.
    { type: "inside", ...axes, zoomOnMouseWheel: "ctrl", moveOnMouseWheel: false, preventDefaultMouseMove: false },
    { type: "slider", ...axes, height: 18, bottom: 4, left: 64, right: 16, showDetail: false, brushSelect: false, borderColor: colours.line,
      fillerColor: `${colours.voltage}33`, handleStyle: { color: colours.surface, borderColor: colours["ink-2"] },
      dataBackground: { lineStyle: { color: colours.line }, areaStyle: { color: colours.line } } },
  ];
}

/** A chart over the times of `time_s` whose ticks follow the zoom. */
function zoomedChart(node, time_s, option) {
  const span = [time_s[0], time_s.at(-1)];
  const chart = new Chart(node, (colours) => option(colours, span));
  chart.plot.on("datazoom", () => {
    const { start, end } = chart.plot.getOption().dataZoom[0];
    const [from, to] = [start, end].map((percent) => span[0] + ((span[1] - span[0]) * percent) / 100);
    const ticks = { axisLabel: { customValues: timeTicks(from, to) }, axisTick: { customValues: timeTicks(from, to) } };
    chart.update({ xAxis: [ticks, ticks] });
  });
  return chart;
}

export function overlayChart(node, run) {
  return zoomedChart(node, run.time_s, (colours, span) => ({
    ...timeGrids(colours, [{ name: "Voltage", unit: "V", ...ROWS.upper }, { name: "Residual", unit: "mV", ...ROWS.lower }], span),
    dataZoom: zoom(colours),
    tooltip: tooltip([
      { series: "measured", colour: "voltage", digits: 4, unit: "V" }, { series: "model", colour: "model", digits: 4, unit: "V" },
      { series: "residual", colour: "residual", digits: 2, unit: "mV" },
    ]),
    series: [
      line("measured", colours.voltage, 0, pairs(run.time_s, run.measured_V), { lineStyle: { width: 4, opacity: 0.45, color: colours.voltage } }),
      line("model", colours.model, 0, pairs(run.time_s, run.model_V), { lineStyle: { width: 1.4, color: colours.model } }),
      line("residual", colours.residual, 1, pairs(run.time_s, run.residual_mV), { lineStyle: { width: 1, color: colours.residual } }),
    ],
  }));
}

function at(times, values, wanted) {
  let k = 0;
  return wanted.map((t) => {
    while (k + 1 < times.length && times[k + 1] <= t) k += 1;
    return values[k];
  });
}

export function socChart(node, run, samples, observer) {
  const counted = samples.charge_Ah.map((charge_Ah) => run.initial_soc + charge_Ah / run.capacity_Ah);
  const reference = at(samples.time_s, counted, observer.time_s);
  const difference = observer.soc.map((soc, k) => (Number.isFinite(soc) ? soc - reference[k] : null));
  const bands = observer.time_s.map((t, k) => [t, observer.soc[k], observer.soc_std?.[k]]).filter((row) => row.every(Number.isFinite))
    .map(([t, soc, std]) => [t, 100 * Math.max(0, soc - BAND * std), 100 * Math.min(1, soc + BAND * std)]);
  return zoomedChart(node, observer.time_s, (colours, span) => ({
    ...timeGrids(colours, [{ name: "SoC", unit: "%", ...socRange(0, 1), ...ROWS.upper }, { name: "Difference", unit: "points of %", ...ROWS.lower }], span),
    dataZoom: zoom(colours),
    tooltip: tooltip([
      { series: "observer", colour: "soc", digits: 2, unit: "%" }, { series: "coulomb counter", colour: "ink", digits: 2, unit: "%" },
      { series: "difference", colour: "residual", digits: 2, unit: "points" },
    ]),
    series: [
      band("band", colours.soc, 0, bands),
      line("observer", colours.soc, 0, pairs(observer.time_s, observer.soc, 100), { lineStyle: { width: 2.2, color: colours.soc } }),
      line("coulomb counter", colours.ink, 0, pairs(observer.time_s, reference, 100), { lineStyle: { width: 1.2, type: [5, 3], color: colours.ink } }),
      line("difference", colours.residual, 1, pairs(observer.time_s, difference, 100), { lineStyle: { width: 1.2, color: colours.residual } }),
    ],
  }));
}
