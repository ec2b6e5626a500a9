// Two cursors: what each signal is at them, and what lies between.
import { el, renderKeyed } from "./dom.js";
import { MISSING, duration, quantity } from "./format.js";
import { signalOf } from "./run-signals.js";

const HEADS = ["", "at A", "at B", "B − A"];

export function cursorTable(shown, changed) {
  const field = (which) => {
    const input = el("input", { type: "number", step: "any", class: "time-field", id: `cursor-${which}`, "aria-label": `Cursor ${which.toUpperCase()}, seconds of test time`, on: { change: () => {
      shown.cursors[which] = Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null;
      changed();
    } } });
    return input;
  };
  const inputs = { a: field("a"), b: field("b") };
  const body = el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": "Values at the cursors" });
  const clear = el("button", { type: "button", class: "small", id: "cursors-clear", text: "Remove cursors", on: { click: () => { shown.cursors = { a: null, b: null }; changed(); } } });
  const node = el("div", { class: "cursors" },
    el("div", { class: "zoom-tools", role: "group", "aria-label": "Cursors" }, el("label", { class: "inline" }, "Cursor A ", inputs.a, " s"), el("label", { class: "inline" }, "B ", inputs.b, " s"), clear), body);
  const show = () => {
    for (const which of ["a", "b"]) {
      if (document.activeElement !== inputs[which]) inputs[which].value = Number.isFinite(shown.cursors[which]) ? String(Math.round(shown.cursors[which] * 1000) / 1000) : "";
    }
    clear.disabled = !Number.isFinite(shown.cursors.a) && !Number.isFinite(shown.cursors.b);
    const rows = lines(shown);
    renderKeyed(body, JSON.stringify(rows), () => (rows.length ? el("table", { class: "cursor-table" }, el("caption", { class: "visually-hidden", text: "Values at the cursors" }),
      el("thead", {}, el("tr", {}, HEADS.map((head) => (head ? el("th", { scope: "col", text: head }) : el("td", {}))))),
      el("tbody", {}, rows.map(([title, ...cells]) => el("tr", {}, el("th", { scope: "row", text: title }), cells.map((text) => el("td", { data: { kind: "number" }, text })))))) : []));
  };
  return { node, show };
}

function lines(shown) {
  const { a, b } = shown.cursors;
  if (!Number.isFinite(a) && !Number.isFinite(b)) return [];
  const keys = [...new Set([...shown.rows.flatMap((row) => [row.left, row.right]), "charge", "energy"].filter(Boolean))];
  const rows = shown.runs.flatMap((data) => keys.map(signalOf).filter(Boolean).map((signal) => {
    const [at, to] = [value(signal, data, a), value(signal, data, b)];
    const name = shown.runs.length > 1 ? `${signal.title} · ${data.name}` : signal.title;
    return [name, ...[at, to, to - at].map((number) => quantity(number, signal.digits, signal.unit))];
  }));
  return [["Test time", time(a), time(b), Number.isFinite(a) && Number.isFinite(b) ? duration(Math.abs(b - a)) : MISSING], ...rows];
}

const time = (at) => (Number.isFinite(at) ? quantity(at, 1, "s") : MISSING);

/** The sample that is nearest; none far beyond the ends. */
function value(signal, data, at) {
  const { time_s: times, values } = signal.of(data);
  if (!Number.isFinite(at) || !values?.length || at < times[0] - 1 || at > times.at(-1) + 1) return NaN;
  let [low, high] = [0, times.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= at) low = middle;
    else high = middle;
  }
  return values[at - times[low] <= times[high] - at ? low : high] ?? NaN;
}

