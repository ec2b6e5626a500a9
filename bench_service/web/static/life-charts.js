// Pictures of a cell's life over its runs: capacity with its forecast, what took it, resistance, what explains the error.
import { Chart, band, line } from "./charts.js";
import { el } from "./dom.js";
import { BAND, fixed } from "./format.js";
import { stagePlots } from "./life-stages.js";

const EXPLAINED = ["voltage", "current", "residual", "soc"]; // colours of what explains the error, by name in order
const plain = (effect) => effect.replaceAll("_", " ");

const SHARE = "share_lost"; // name of a parameter that is a share, before what it is of

/** A resistance with its place, a loss with its share and electrode, anything else by its name. */
function findingInWords({ effect, evidence, parameters }) {
  if (evidence?.where) return `resistance ${evidence.where}`;
  const name = Object.keys(parameters ?? {}).find((each) => each.startsWith(SHARE));
  if (name === undefined) return plain(effect);
  return `${plain(effect)}${name.slice(SHARE.length)} (${(100 * parameters[name].value).toFixed(0)} %)`;
}

/** What is new in a run, in words. */
export function inWords(run) {
  if (run.verdict === "nothing_missing") return "nothing";
  if (run.verdict === "unknown_effect") return "something that no known effect explains";
  const names = run.findings.map(findingInWords);
  if (run.verdict !== "ambiguous") return names.join(", then ");
  const rivals = run.findings.flatMap((finding) => finding.confounded_with.map(plain));
  return [...new Set([...names, ...rivals])].join(" or ");
}

/** Since when something is there, and between which runs it began where that is not sure. */
function changeInWords({ effect, run, between }, nameOf) {
  const [first, last] = between.map(nameOf);
  const began = first === last ? "" : `; it began between ${first} and ${last}`;
  return `New since ${nameOf(run)}: ${plain(effect)}${began}.`;
}

/** Draw a life into a node; `nameOf` gives a run's name. */
export function drawLife(node, life, nameOf) {
  const unit = life.unit ?? "run";
  const shown = [
    ["Capacity, shaded: 95 % band", `Capacity over the ${unit}s with its 95 % band and its forecast`, (colours) => capacityOption(colours, life, unit)],
    ["What the capacity was lost by", `Capacity lost over the ${unit}s, by what took it`, (colours) => lostOption(colours, life, unit)],
    ["Resistance of the first moment, shaded: 95 % bands, cut at zero", `Resistance over the ${unit}s with 95 % bands, cut at zero`, (colours) => resistanceOption(colours, life, unit)],
    ["What explains the error", `Error of the model over the ${unit}s, stacked by what explains it`, (colours) => explainedOption(colours, life, unit)],
    ["Error before and after", `Error of the model over the ${unit}s before and after what was found`, (colours) => errorOption(colours, life, unit)],
  ];
  const plots = shown.map(([, label]) => el("div", { class: "plot life-plot", role: "img", "aria-label": label }));
  const stages = stagePlots(life, nameOf);
  node.replaceChildren(
    el("p", { class: "life-words", text: life.forecast ? `${life.forecast.explanation}.` : "When the end is reached is not told: too few runs." }),
    el("ul", { class: "life-words" }, life.change_points.map((point) => el("li", { text: changeInWords(point, nameOf) }))),
    life.next_experiment ? el("p", { class: "life-words", text: `Next experiment: a profile of ${(life.next_experiment.duration_s / 3600).toFixed(0)} h that tells ${life.next_experiment.rivals.map(plain).join(" from ")}.` }) : "",
    ...shown.flatMap(([title], k) => [el("h3", { text: title }), plots[k]]), ...stages.nodes, table(life, nameOf));
  shown.forEach(([, , option], k) => new Chart(plots[k], option));
  stages.draw();
}

function table(life, nameOf) {
  const heads = [life.unit === "cycle" ? "Cycle" : "No.", "Run", "What is new", "Capacity / Ah", "Std / Ah", "Error before / mV", "After / mV"];
  const rows = life.runs.map((run) => [String(Math.round(10 * run.at) / 10), nameOf(run.run), inWords(run), fixed(run.capacity_Ah.value, 3), fixed(run.capacity_Ah.std, 3), fixed(run.error_mV, 1), fixed(run.unexplained_mV, 1)]);
  return el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": "Runs" }, el("table", {},
    el("thead", {}, el("tr", {}, heads.map((head) => el("th", { scope: "col", text: head })))),
    el("tbody", {}, rows.map((row) => el("tr", {}, row.map((cell) => el("td", { text: cell })))))));
}

const withBand = (run, { value, std }, least = -Infinity) => [run.at, Math.max(value - BAND * std, least), value + BAND * std];

function capacityOption(colours, life, unit) {
  const points = life.runs.map((run) => [run.at, run.capacity_Ah.value]);
  const series = [
    band("band", colours.voltage, 0, life.runs.map((run) => withBand(run, run.capacity_Ah))),
    { ...line("capacity", colours.voltage, 0, points), showSymbol: true, symbolSize: 6 },
  ];
  const ahead = life.forecast?.curve ?? [];
  if (ahead.length) {
    series.push(band("forecast band", colours.neutral, 0, ahead.map(({ at, low_Ah, high_Ah }) => [at, low_Ah, high_Ah])));
    series.push(line("goes on as it did", colours.neutral, 0, ahead.map(({ at, capacity_Ah }) => [at, capacity_Ah]), { lineStyle: { width: 1.4, type: "dashed", color: colours.neutral } }));
    series.push(line("end of life", colours.bad, 0, [ahead[0], ahead.at(-1)].map(({ at }) => [at, life.forecast.end_Ah])));
  }
  return axes(colours, unit, "Capacity / Ah", series);
}

/** At the lowest, a middle and the highest place that is told. */
function resistanceOption(colours, life, unit) {
  const places = [...new Set(life.runs.flatMap((run) => run.resistance.map(({ soc }) => soc)))].sort((a, b) => a - b);
  const chosen = [...new Set([places[0], places[Math.floor(places.length / 2)], places.at(-1)])].filter(Number.isFinite);
  const series = chosen.flatMap((soc, k) => {
    const colour = [colours.voltage, colours.soc, colours.model][k];
    const told = life.runs.map((run) => ({ run, each: run.resistance.find((one) => Math.abs(one.soc - soc) < 0.01) })).filter(({ each }) => each);
    const milli = ({ value_Ohm, std_Ohm }) => ({ value: 1e3 * value_Ohm, std: 1e3 * std_Ohm });
    return [
      band(`band ${soc}`, colour, 0, told.map(({ run, each }) => withBand(run, milli(each), 0))),
      { ...line(`SoC ${fixed(soc, 1)}`, colour, 0, told.map(({ run, each }) => [run.at, milli(each).value])), showSymbol: true, symbolSize: 5 },
    ];
  });
  return axes(colours, unit, "Resistance / mΩ", series);
}

/** The error, cut into what each change takes off it and what is left. */
function explainedOption(colours, life, unit) {
  const names = [...new Set(life.runs.flatMap((run) => run.findings.map(({ effect }) => effect)))].sort();
  const part = (run, name) => {
    let top = run.error_mV;
    for (const { effect, error_after_mV } of run.findings) {
      if (effect === name) return Math.max(0, top - error_after_mV);
      top = error_after_mV;
    }
    return 0;
  };
  const pieces = [["left", colours.neutral, (run) => Math.min(run.unexplained_mV, run.error_mV)],
    ...names.map((name, k) => [plain(name), colours[EXPLAINED[k % EXPLAINED.length]], (run) => part(run, name)])];
  return stacked(colours, life, unit, "Error / mV", pieces);
}

/** The capacity that is lost, in the colour of what took it. */
function lostOption(colours, life, unit) {
  const NOT_TOLD = "not told from none";
  const tookIt = (run) => { const found = run.findings.find(({ evidence }) => evidence?.takes_capacity); return found ? findingInWords(found).split(" (")[0] : NOT_TOLD; };
  const lost = (run) => Math.max(0, life.fresh_capacity_Ah - run.capacity_Ah.value);
  const names = [...new Set(life.runs.map(tookIt))].sort((a, b) => (a === NOT_TOLD ? -1 : b === NOT_TOLD ? 1 : a < b ? -1 : 1));
  const known = names.filter((name) => name !== NOT_TOLD);
  const colour = (name) => (name === NOT_TOLD ? colours.neutral : colours[EXPLAINED[known.indexOf(name) % EXPLAINED.length]]);
  return stacked(colours, life, unit, "Lost / Ah", names.map((name) => [name, colour(name), (run) => (tookIt(run) === name ? lost(run) : 0)]));
}

/** One bar a run, cut into pieces of a name, a colour and a value of the run. */
function stacked(colours, life, unit, axis, pieces) {
  const series = pieces.map(([name, color, values]) => ({ name, type: "bar", stack: "all", data: life.runs.map((run, k) => [k, values(run)]), itemStyle: { color }, barMaxWidth: 28 }));
  const option = axes(colours, unit, axis, series);
  const labels = life.runs.map((run) => String(Math.round(10 * run.at) / 10));
  return { ...option, xAxis: { ...option.xAxis, type: "category", data: labels }, yAxis: { ...option.yAxis, scale: false } };
}

function errorOption(colours, life, unit) {
  const shown = (name, key, colour) => ({ ...line(name, colour, 0, life.runs.map((run) => [run.at, run[key]])), showSymbol: true, symbolSize: 5 });
  return axes(colours, unit, "Error / mV", [shown("before", "error_mV", colours.model), shown("after", "unexplained_mV", colours.voltage)]);
}

function axes(colours, unit, name, series) {
  const text = { color: colours["ink-2"], fontSize: 12 };
  const common = { axisLabel: { ...text, hideOverlap: true }, axisLine: { onZero: false, lineStyle: { color: colours.line } } };
  const named = series.map((each) => each.name).filter((each) => !each.includes("band"));
  return {
    textStyle: { fontFamily: colours.font }, grid: { left: 64, right: 20, top: 58, bottom: 44 }, series, legend: { type: "scroll", top: 0, right: 10, left: 10, data: named, textStyle: { color: colours.ink }, itemHeight: 8 },
    xAxis: { type: "value", min: "dataMin", max: "dataMax", name: unit, nameLocation: "middle", nameGap: 26, nameTextStyle: text, splitLine: { show: false }, ...common },
    yAxis: { type: "value", scale: true, name, nameTextStyle: { color: colours.ink, fontSize: 12, align: "left", padding: [0, 0, 0, -56] }, splitLine: { lineStyle: { color: colours.line, opacity: 0.5 } }, ...common },
  };
}
