// What each cycle and each step of a protocol has moved, and how the capacity goes from cycle to cycle.
import { api } from "./api.js";
import { Chart, line } from "./charts.js";
import { el, renderKeyed } from "./dom.js";
import { MISSING, duration, fixed, percent } from "./format.js";

const CYCLE_HEADS = ["Cycle", "Charge / Ah", "Discharge / Ah", "Charge / Wh", "Discharge / Wh", "Mean charge / V", "Mean discharge / V", "Coulombic", "Energy", "Time"];
const STEP_HEADS = ["Step", "Cycle", "Ended at", "Time", "Charge / Ah", "Discharge / Ah", "Charge / Wh", "Discharge / Wh", "Mean / V", "End / V", "End / A", "Ended by"];
const MOST_STEPS = 200;
const LOOK_MS = 5000;

/** Fills itself for a run of a protocol; the section stays hidden for others. */
export function cyclesPanel(data, section) {
  const plot = el("div", { class: "plot cycles-plot", role: "img", "aria-label": "Capacity of each cycle, charge and discharge", hidden: true });
  const cycles = el("div");
  const steps = el("div");
  const node = el("div", { class: "cycles" }, plot, cycles, el("details", { class: "more" }, el("summary", { text: "Each step" }), steps));
  section.hidden = !data.run.protocol_id;
  let [chart, rows, last, seenEnd] = [null, [], 0, false];
  const look = async () => {
    const [found, each] = await Promise.all([api.runCycles(data.run.id), api.runSteps(data.run.id)]).catch(() => [[], []]);
    rows = found;
    renderKeyed(cycles, JSON.stringify(found), () => table("Cycles", CYCLE_HEADS, found.map(cycleRow)));
    renderKeyed(steps, JSON.stringify(each), () => table(each.length > MOST_STEPS ? `The last ${MOST_STEPS} of ${each.length} steps` : "Steps", STEP_HEADS, each.slice(-MOST_STEPS).map(stepRow)));
    plot.hidden = rows.filter((row) => !row.cut_off).length < 2;
    if (plot.hidden) return;
    if (chart) chart.redraw();
    else chart = new Chart(plot, (colours) => option(colours, rows));
  };
  const show = () => {
    // While it goes on now and then, and once more when it has ended.
    if (!data.run.protocol_id || (data.goesOn ? Date.now() - last < LOOK_MS : seenEnd)) return;
    last = Date.now();
    seenEnd = !data.goesOn;
    look();
  };
  return { node, show };
}

const n = (value, digits) => (Number.isFinite(value) ? fixed(value, digits) : MISSING);
const share = (value) => (Number.isFinite(value) ? percent(value, 2) : MISSING);

function cycleRow(row) {
  return [`${row.cycle_count}${row.cut_off ? ", not complete" : ""}${row.begun_part_charged ? ", begun part charged" : ""}`, n(row.charged_Ah, 4), n(row.discharged_Ah, 4), n(row.charged_Wh, 3), n(row.discharged_Wh, 3),
    n(row.mean_charge_voltage_V, 3), n(row.mean_discharge_voltage_V, 3), share(row.coulombic_efficiency), share(row.energy_efficiency), duration(row.duration_s)];
}

function stepRow(row) {
  return [row.step_count, row.cycle_count, duration(row.end_time_s), duration(row.duration_s), n(row.charged_Ah, 4), n(row.discharged_Ah, 4), n(row.charged_Wh, 3), n(row.discharged_Wh, 3),
    n(row.mean_voltage_V, 4), n(row.end_voltage_V, 4), n(row.end_current_A, 3), String(row.ended_by).replaceAll("_", " ")];
}

function table(caption, heads, rows) {
  if (!rows.length) return el("p", { class: "empty", text: "No step has ended yet." });
  return el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": caption }, el("table", {}, el("caption", { text: caption }),
    el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col", text: head })))),
    el("tbody", {}, rows.map((row) => el("tr", {}, row.map((cell) => el("td", {}, String(cell))))))));
}

function option(colours, rows) {
  const text = { color: colours["ink-2"], fontSize: 12 };
  const whole = rows.filter((row) => !row.cut_off);
  const series = [["charge", "charged_Ah", colours.voltage], ["discharge", "discharged_Ah", colours.current]].map(([name, key, colour]) =>
    ({ ...line(name, colour, 0, whole.map((row) => [row.cycle_count, row[key]])), showSymbol: true, symbolSize: 5 }));
  return {
    textStyle: { fontFamily: colours.font }, grid: { left: 64, right: 20, top: 40, bottom: 44 }, series, legend: { top: 0, right: 10, textStyle: { color: colours.ink }, itemHeight: 8 },
    xAxis: { type: "value", minInterval: 1, min: "dataMin", max: "dataMax", name: "cycle", nameLocation: "middle", nameGap: 26, nameTextStyle: text, axisLabel: text, axisLine: { onZero: false, lineStyle: { color: colours.line } }, splitLine: { show: false } },
    yAxis: { type: "value", scale: true, name: "Capacity / Ah", nameTextStyle: { color: colours.ink, fontSize: 12, align: "left", padding: [0, 0, 0, -56] }, axisLabel: text, axisLine: { onZero: false, lineStyle: { color: colours.line } }, splitLine: { lineStyle: { color: colours.line, opacity: 0.5 } } },
  };
}
