// The fields of a step: each knows its place in the document, so that an objection finds it.
import { el } from "./dom.js";
import { QUANTITIES, between, endsKey, endsOf, shown, typed } from "./protocol-model.js";

const WINDOWS = ["voltage_V", "current_A", "temperature_degC", "soc"];
const SIDES = [["", "–"], ["above", "≥"], ["below", "≤"]];

/** `row`: {id, number, capacity_Ah, typed(), rebuilt()}; the first is called after each key, the second where the row looks other. */
export function fieldsOf(step, row) {
  const field = (key, title, value, take, unit = "") => {
    const input = el("input", { id: `${row.id}-${key}`, value, autocomplete: "off", inputmode: "decimal", data: { path: key }, "aria-label": `Step ${row.number}, ${title}${unit ? ` in ${unit}` : ""}` });
    input.addEventListener("input", () => { take(input.value); row.typed(); });
    return el("label", { class: "step-field" }, el("span", { text: unit ? `${title} / ${unit}` : title }), input);
  };
  const number = (key, title, unit = "") => field(key, title, shown(step[key]), (text) => { step[key] = typed(text); }, unit);
  const text = (key, title) => {
    const node = field(key, title, step[key] ?? "", (value) => { step[key] = value.trim() || undefined; });
    node.querySelector("input").removeAttribute("inputmode");
    return node;
  };
  const choice = (key, title, options, value, take) => {
    const select = el("select", { id: `${row.id}-${key}`, data: { path: key }, "aria-label": `Step ${row.number}, ${title}` }, options.map(([name, words]) => el("option", { value: name, text: words, selected: name === value })));
    select.addEventListener("change", () => { take(select.value); row.rebuilt(); });
    return select;
  };
  return { field, number, text, choice, rate: (title = "Current") => rate(step, row, { number, choice }, title) };
}

/** A current in A or as a C-rate; changing the unit keeps the current. */
function rate(step, row, { number, choice }, title) {
  const key = step.current_A !== undefined ? "current_A" : "rate_C";
  const take = (unit) => {
    if (unit === key) return;
    const factor = unit === "current_A" ? row.capacity_Ah : 1 / row.capacity_Ah;
    step[unit] = typeof step[key] === "number" ? Number((step[key] * factor).toPrecision(6)) : step[key] ?? 0;
    delete step[key];
  };
  return el("div", { class: "step-pair" }, number(key, title, key === "rate_C" ? "C" : "A"), choice(`${key}-unit`, "unit of the current", [["rate_C", "C"], ["current_A", "A"]], key, take));
}

/** What a step gives, by its kind. */
export function levelFields(step, row) {
  const { number, text, choice, rate: current } = fieldsOf(step, row);
  const made = {
    constant_current: () => [current()],
    cc_cv: () => [current(), number("voltage_V", "Hold at", "V")],
    constant_voltage: () => [number("voltage_V", "Hold at", "V"), current("At most")],
    power: () => [number("power_W", "Power", "W")],
    resistance: () => [number("resistance_Ohm", "Load", "Ohm")],
    pulse: () => [current(), number("on_s", "On", "s"), number("off_s", "Off", "s"), number("count", "Times")],
    profile: () => [points(step, row), number("count", "Times")],
    chamber: () => [number("temperature_degC", "Set to", "°C")],
    soak: () => [number("temperature_degC", "At", "°C"), number("within_K", "Cell within", "K"), number("hold_s", "For", "s"), number("limit_s", "At most", "s"),
      choice("at_limit", "what happens after the longest wait", [["stop", "then stop"], ["go_on", "then go on"]], step.at_limit ?? "stop", (to) => { step.at_limit = to; })],
    loop: () => [number("count", "Times")],
    goto: () => [text("to", "Label"), number("most", "At most times")],
    mark: () => [text("label", "Label")],
    design: () => [el("p", { class: "about", text: "A designed profile, made when the protocol is stored." })],
  };
  return made[step.step]?.() ?? [];
}

/** Rows of a profile as text, as long as a person could read them. */
function points(step, row) {
  const key = ["current_A", "rate_C", "power_W"].find((name) => step[name] !== undefined) ?? "rate_C";
  const unit = { current_A: "A", rate_C: "C", power_W: "W" }[key];
  const times = Array.isArray(step.time_s) ? step.time_s : [];
  if (times.length > 200) return el("p", { class: "about", text: `${times.length} rows, ${times.at(-1)} s` });
  const area = el("textarea", { id: `${row.id}-points`, rows: Math.min(6, times.length + 1), data: { path: key }, "aria-label": `Step ${row.number}, rows of time in s and value in ${unit}` });
  area.value = times.map((time, k) => `${time}, ${step[key][k]}`).join("\n");
  area.addEventListener("input", () => {
    const rows = area.value.split("\n").filter((line) => line.trim()).map((line) => line.split(/[,;\t ]+/).filter(Boolean).map(Number));
    step.time_s = rows.map(([time]) => time);
    step[key] = rows.map(([, value]) => (Number.isFinite(value) ? value : "?"));
    row.typed();
  });
  return el("label", { class: "step-field wide" }, el("span", { text: `time / s, value / ${unit}` }), area);
}

/** What ends a step, or when a jump is taken. */
export function endFields(step, row) {
  const key = endsKey(step);
  if (!key) return [];
  const { field, choice } = fieldsOf(step, row);
  const ends = step[key];
  const offered = endsOf(step);
  const one = (end, k) => {
    const [title, unit, scale] = QUANTITIES.get(end.quantity) ?? [end.quantity, "", 1];
    const named = `${title}${unit ? ` / ${unit}` : ""}`;
    const value = field(`${key}.${end.quantity}`, `end ${k + 1}, ${title}`, shown(end.value, scale), (words) => { end.value = typed(words, scale); }, unit);
    value.querySelector("input").id = `${row.id}-end-${k}`;
    value.querySelector("span").textContent = named;
    return el("div", { class: "step-end", role: "group", "aria-label": `Step ${row.number}, end ${k + 1}` },
      choice(`end-${k}-what`, `end ${k + 1}, quantity`, [...new Set([...offered, end.quantity])].map((name) => [name, QUANTITIES.get(name)?.[0] + (name === "charge_share" ? " share" : "")]), end.quantity, (name) => Object.assign(end, { quantity: name, value: undefined, over_s: undefined })),
      choice(`end-${k}-side`, `end ${k + 1}, direction`, between(step) ? SIDES.slice(1) : SIDES, end.side, (side) => { end.side = side; }),
      value, el("button", { type: "button", class: "small", id: `${row.id}-end-${k}-remove`, "aria-label": `Remove end ${k + 1} of step ${row.number}`, text: "×", on: { click: () => { ends.splice(k, 1); row.rebuilt(); } } }));
  };
  const add = () => { const free = offered.find((name) => !ends.some((end) => end.quantity === name)) ?? offered[0]; ends.push({ quantity: free, side: between(step) ? "above" : "", value: undefined }); row.rebuilt(`${row.id}-end-${ends.length - 1}-what`); };
  const full = key === "if" && ends.length > 0;
  return [...ends.map(one), full ? null : el("button", { type: "button", class: "small", id: `${row.id}-end-add`, text: between(step) ? "+ condition" : "+ end", "aria-label": `Add an end to step ${row.number}`, on: { click: add } })];
}

/** Label, record rate and limits: seldom needed, so folded. */
export function moreFields(step, row) {
  if (["mark", "goto", "chamber"].includes(step.step)) return [];
  const { field, text } = fieldsOf(step, row);
  const at = (part, key, k = null) => (k === null ? step[part]?.[key] : step[part]?.[key]?.[k]);
  const put = (part, key, value, k = null) => {
    step[part] ??= {};
    if (k === null) step[part][key] = value;
    else (step[part][key] ??= [null, null])[k] = value ?? null;
  };
  const record = ["time_s", "voltage_V", "current_A"].map((key) => field(`record.${key}`, key === "time_s" ? "Sample each" : `or a change of ${QUANTITIES.get(key)[0].toLowerCase()}`, shown(at("record", key)), (value) => put("record", key, typed(value)), QUANTITIES.get(key)[1]));
  const windows = WINDOWS.flatMap((key) => [0, 1].map((k) => {
    const [title, unit, scale] = QUANTITIES.get(key);
    const node = field(`limits.${key}`, `${title} ${k ? "at most" : "at least"}`, shown(at("limits", key, k) ?? undefined, scale), (value) => put("limits", key, typed(value, scale), k), unit);
    node.querySelector("input").id = `${row.id}-limits-${key}-${k}`;
    return node;
  }));
  const used = [step.label && `label ${step.label}`, step.record?.time_s && `each ${step.record.time_s} s`, ...WINDOWS.filter((key) => step.limits?.[key]).map((key) => `limits of ${QUANTITIES.get(key)[0].toLowerCase()}`)].filter(Boolean);
  return [el("details", { class: "step-more", open: row.unfolded(), on: { toggle: (event) => row.fold(event.target.open) } }, el("summary", { text: used.length ? `Record and limits: ${used.join(", ")}` : "Record and limits" }),
    el("p", { class: "about", text: "Limits end the run where they are left." }), el("div", { class: "step-fields" }, text("label", "Label for a jump"), ...record, ...windows))];
}
