// A protocol as the editor has it: the document itself, its ends as lists, and what can be done with its steps.

export const KINDS = new Map([
  ["cc_cv", "CC-CV"], ["constant_current", "Constant current"], ["constant_voltage", "Constant voltage"], ["rest", "Rest"],
  ["power", "Power"], ["resistance", "Resistance"], ["pulse", "Pulses"], ["profile", "Profile"],
  ["chamber", "Chamber"], ["soak", "Soak"], ["loop", "Loop"], ["group", "Group"], ["goto", "Go to"], ["mark", "Mark"], ["design", "Designed"],
]);
/** Quantity of an end -> title, unit as shown, and by how much that is larger than in the document. */
export const QUANTITIES = new Map([
  ["voltage_V", ["Voltage", "V", 1]], ["current_A", ["Current", "A", 1]], ["rate_C", ["C-rate", "C", 1]], ["time_s", ["Time", "s", 1]],
  ["charge_Ah", ["Charge", "Ah", 1]], ["charge_share", ["Charge", "% of capacity", 100]], ["soc", ["SoC", "%", 100]],
  ["temperature_degC", ["Temperature", "°C", 1]], ["dV_dt_V_per_s", ["Voltage slope", "V/s", 1]], ["cycle", ["Cycle", "", 1]],
]);
const CONDITIONS = ["voltage_V", "soc", "temperature_degC", "charge_Ah", "charge_share", "cycle"];
const LASTS_S = [[/^([\d.]+)\s*min$/, 60], [/^([\d.]+)\s*h$/, 3600], [/^([\d.]+)\s*d$/, 86400]];

export const holdsSteps = (step) => step.step === "loop" || step.step === "group";
export const between = (step) => holdsSteps(step) || step.step === "goto";
/** What a step of this kind may end by. */
export const endsOf = (step) => (between(step) ? CONDITIONS : [...QUANTITIES.keys()].filter((name) => name !== "cycle"));
/** Where its ends stand; some have none. */
export const endsKey = (step) => (["mark", "design", "chamber", "soak"].includes(step.step) ? null : step.step === "goto" ? "if" : "until");

/** What was typed, as a document has it; what is no number stays text, and the service says what is wrong with it. */
export function typed(text, scale = 1) {
  const plain = text.trim().replace(",", ".");
  if (!plain) return undefined;
  const lasts = LASTS_S.find(([pattern]) => pattern.test(plain));
  const value = lasts ? Number(plain.match(lasts[0])[1]) * lasts[1] : Number(plain);
  return Number.isFinite(value) ? Number((value / scale).toPrecision(12)) : plain;
}

export const shown = (value, scale = 1) => (typeof value === "number" ? String(Number((value * scale).toPrecision(9))) : value ?? "");

/** A step as a person most likely wants it on a bench. */
export function freshStep(kind, bench) {
  const [low_V, high_V] = bench?.limits?.voltage_V ?? [3, 4.2];
  const round = (value) => Number(value.toPrecision(4));
  const [top_V, bottom_V] = [round(high_V - Math.max(0.02, 0.004 * high_V)), round(low_V + 0.12 * (high_V - low_V))];
  const capacity_Ah = bench?.capacity_Ah ?? 1;
  const end = (quantity, value, side = "") => [{ quantity, side, value }];
  const own = {
    cc_cv: { rate_C: 0.5, voltage_V: top_V, until: end("rate_C", 0.05) },
    constant_current: { rate_C: -0.5, until: end("voltage_V", bottom_V) },
    constant_voltage: { voltage_V: top_V, until: end("rate_C", 0.05) },
    rest: { until: end("time_s", 600) },
    power: { power_W: -round(0.5 * capacity_Ah * (low_V + high_V) / 2), until: end("voltage_V", bottom_V) },
    resistance: { resistance_Ohm: round((low_V + high_V) / capacity_Ah), until: end("voltage_V", bottom_V) },
    pulse: { rate_C: -0.5, on_s: 10, off_s: 60, count: 1, until: end("voltage_V", bottom_V) },
    profile: { time_s: [0, 60, 120], rate_C: [0.2, -0.2, 0], until: [] },
    chamber: { temperature_degC: 25 }, soak: { temperature_degC: 25, within_K: 1, hold_s: 600, limit_s: 14400, at_limit: "stop" },
    loop: { count: 2, until: [], steps: [] }, group: { until: [], steps: [] },
    goto: { to: "", most: 1, if: end("soc", 0.5, "below") }, mark: { label: "" },
  };
  return { step: kind, ...own[kind] };
}

/** A document that may be edited: ends as lists; where it came from is no more true of it. */
export function editable(document) {
  const copy = structuredClone(document);
  if (copy.meta) delete copy.meta.standard_test;
  copy.record ??= {};
  const open = (step) => {
    for (const key of ["until", "if"]) if (step[key] !== undefined || key === endsKey(step)) step[key] = listed(step[key]);
    step.steps?.forEach(open);
  };
  copy.steps.forEach(open);
  return copy;
}

function listed(ends) {
  return [ends ?? {}].flat().flatMap((each) => Object.entries(each)).map(([quantity, value]) => {
    if (value === null || typeof value !== "object") return { quantity, side: "", value };
    const side = value.above !== undefined && value.above !== null ? "above" : "below";
    return { quantity, side, value: value[side], over_s: value.over_s };
  });
}

/** The document that the service takes. */
export function written(document) {
  const close = (step) => {
    const copy = { ...step };
    for (const key of ["until", "if"]) if (Array.isArray(copy[key])) copy[key] = collapsed(copy[key]);
    if (copy.steps) copy.steps = copy.steps.map(close);
    return copy;
  };
  return pruned({ ...document, steps: document.steps.map(close) });
}

function collapsed(ends) {
  const one = ({ quantity, side, value, over_s }) => ({ [quantity]: side || over_s ? { [side || "below"]: value, over_s } : value });
  const names = new Set(ends.map((end) => end.quantity));
  return names.size === ends.length ? Object.assign({}, ...ends.map(one)) : ends.map(one);
}

/** Without what says nothing; windows keep their open ends as null. */
function pruned(node) {
  if (Array.isArray(node)) return node.map((each) => (each === undefined ? null : pruned(each)));
  if (node === null || typeof node !== "object") return node;
  const kept = Object.entries(node).map(([key, value]) => [key, pruned(value)]).filter(([, value]) => !empty(value));
  return Object.fromEntries(kept);
}

function empty(value) {
  if (value === undefined || value === null) return true;
  if (Array.isArray(value)) return value.length > 0 && value.every((each) => each === null);
  return typeof value === "object" && Object.keys(value).length === 0;
}

/** Where a step stands: the list, its place in it, and the place of the loop or group around it. */
export function placeOf(steps, step, above = null) {
  for (const [at, each] of steps.entries()) {
    if (each === step) return { list: steps, at, above };
    const inside = each.steps && placeOf(each.steps, step, { list: steps, at, above });
    if (inside) return inside;
  }
  return null;
}

/** Move one place up or down: into a loop or group that stands there, out of it at its ends. False at the end of all. */
export function move(steps, step, by) {
  const { list, at, above } = placeOf(steps, step);
  const beside = list[at + by];
  if (!beside && !above) return false;
  list.splice(at, 1);
  if (!beside) above.list.splice(above.at + (by > 0 ? 1 : 0), 0, step);
  else if (holdsSteps(beside)) beside.steps.splice(by > 0 ? 0 : beside.steps.length, 0, step);
  else list.splice(at + by, 0, step);
  return true;
}

/** Every step with its path in the document, its number as "2.1", and how deep it stands. */
export function flat(steps, path = ["steps"], number = "") {
  return steps.flatMap((step, at) => {
    const [here, name] = [[...path, at], `${number}${at + 1}`];
    return [{ step, path: here, number: name, depth: name.split(".").length - 1 }, ...(step.steps ? flat(step.steps, [...here, "steps"], `${name}.`) : [])];
  });
}
