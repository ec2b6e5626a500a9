// dQ/dV over voltage and dV/dQ over charge of the part that is looked at: where an electrode's stages show.
import { api } from "./api.js";
import { Chart, line } from "./charts.js";
import { el } from "./dom.js";
import { duration, fixed } from "./format.js";

const KINDS = [
  { key: "dQ_dV_Ah_per_V", x: "voltage_V", title: "dQ/dV", unit: "Ah/V", over: "voltage / V", digits: 3 },
  { key: "dV_dQ_V_per_Ah", x: "charge_Ah", title: "dV/dQ", unit: "V/Ah", over: "charge / Ah", digits: 3 },
];
const WAYS = [["charge", "voltage"], ["discharge", "current"]];

export function incrementalPanel(shown) {
  const message = el("p", { class: "about", role: "status" });
  const box = el("div", { class: "incremental" });
  let plots = [];
  const step = el("input", { id: "incremental-step", type: "number", min: 0.1, max: 1000, step: "any", value: 5, class: "time-field" });
  const button = el("button", { type: "button", id: "incremental-show", text: "Show for the part above", on: { click: async () => {
    const { from, to } = shown.wanted;
    message.textContent = "Counting …";
    try {
      const part = { from_s: from ?? undefined, to_s: to ?? undefined, step_mV: step.valueAsNumber };
      const found = await Promise.all(shown.runs.map((data) => api.incremental(data.run.id, part)));
      for (const plot of plots) plot.dispose();
      plots = drawBoth(box, found);
      const { view } = shown;
      message.textContent = found.some((each) => Object.keys(each).length) ? `From every sample of ${duration(view.from)} to ${duration(view.to)} of test time.` : "No charge was moved here.";
    } catch (error) {
      message.textContent = `Cannot be shown: ${error.message}`;
    }
  } } });
  const node = el("div", {}, el("div", { class: "zoom-tools" }, button, el("label", { class: "inline" }, "steps of ", step, " mV"), message), box);
  return { node };
}

function drawBoth(box, found) {
  const nodes = KINDS.map(({ title, over }) => el("div", { class: "plot small", role: "img", "aria-label": `${title} over ${over}` }));
  box.replaceChildren(...nodes);
  return KINDS.map((kind, k) => new Chart(nodes[k], (colours) => {
    const text = { color: colours["ink-2"], fontSize: 12 };
    const axis = (name, more) => ({ type: "value", scale: true, name, nameTextStyle: text, axisLabel: { ...text, formatter: (value) => String(Math.round(value * 1e4) / 1e4) }, axisLine: { onZero: false, lineStyle: { color: colours.line } }, splitLine: { lineStyle: { color: colours.line, opacity: 0.5 } }, ...more });
    const series = found.flatMap((each, n) => WAYS.filter(([way]) => each[way]).map(([way, colour]) => {
      const { [kind.x]: x, [kind.key]: y } = each[way];
      const name = found.length > 1 ? `${way}, run ${n + 1}` : way;
      return { ...line(name, colours[colour], 0, x.map((at, i) => [at, y[i]])), lineStyle: { width: 1.6, color: colours[colour], type: n ? [4, 3] : "solid" } };
    }));
    return {
      textStyle: { fontFamily: colours.font }, grid: { left: 64, right: 20, top: 46, bottom: 44 }, series, legend: { top: 0, right: 10, textStyle: { color: colours.ink }, itemHeight: 8 },
      xAxis: axis(kind.over, { nameLocation: "middle", nameGap: 26, splitLine: { show: false } }), yAxis: axis(`${kind.title} / ${kind.unit}`, { nameTextStyle: { ...text, align: "left", padding: [0, 0, 0, -56] } }),
      tooltip: { trigger: "axis", className: "chart-tip", confine: true, transitionDuration: 0, axisPointer: { type: "line", animation: false }, formatter: (items) => el("div", {}, items.map((item) => el("div", { class: "tip-row" }, el("span", { text: item.seriesName }), el("strong", { text: `${fixed(item.value[1], kind.digits)} ${kind.unit} at ${fixed(item.value[0], 3)}` })))) },
    };
  }));
}
