// What a run can be made of: a standard test with its parameters, a stored protocol, a stored profile.
import { api } from "./api.js";
import { el } from "./dom.js";
import { duration, fixed, quantity, rounded } from "./format.js";
import { QUANTITIES } from "./protocol-model.js";
import { lengthWords } from "./run-preview.js";

// What is proposed is short and runs on any bench.
const PROPOSED = "test:pulse_resistance";

// A run that is over with the first look of a preview, which takes up to a minute, is not worth starting.
const AT_ONCE_S = 60;

/** Fill the chooser; a value is "test:NAME", "protocol:ID", "profile:ID", "edit:" or "manual:". `known` is given the standard tests by name. */
export async function fillSources(select, chosen, known) {
  const [tests, protocols, profiles] = await Promise.all([api.standardTests().catch(() => []), api.protocols().catch(() => []), api.profiles().catch(() => [])]);
  // What somebody has chosen while this was loading stays chosen.
  const kept = chosen ?? (select.value || PROPOSED);
  const group = (label, options) => (options.length ? el("optgroup", { label }, options) : null);
  const option = (value, text) => el("option", { value, text, selected: value === kept });
  const groups = [
    group("Standard tests", tests.map((test) => option(`test:${test.name}`, test.title))),
    group("Step by step", [option("edit:", "Protocol editor"), option("manual:", "Manual set-point")]),
    group("Stored protocols", protocols.map((each) => option(`protocol:${each.id}`, `${each.name}, ${each.n_steps} ${each.n_steps === 1 ? "step" : "steps"}`))),
    group("Stored profiles", profiles.map((each) => option(`profile:${each.id}`, `${each.name}, ${duration(each.duration_s)}`))),
  ];
  known(new Map(tests.map((test) => [test.name, test])));
  select.replaceChildren(...groups.filter(Boolean));
}

/** Fields for the parameters of a standard test; `values()` gives what was typed, the rest is as the bench has it. */
export function parameterFields(test) {
  const inputs = Object.entries(test.parameters).map(([name, { default: value, unit, meaning }]) => {
    const own = typeof value === "string" && value.startsWith("$");
    const text = Array.isArray(value) ? value.join(", ") : value;
    const input = el("input", { id: `parameter-${name}`, name, autocomplete: "off", placeholder: own ? "as the bench allows" : String(text), title: meaning });
    return [name, input, Array.isArray(value), el("div", { class: "field" }, el("label", { for: input.id, text: unit ? `${meaning} / ${unit}` : meaning }), input)];
  });
  const values = () => Object.fromEntries(inputs.filter(([, input]) => input.value.trim()).map(([name, input, many]) => {
    const numbers = input.value.split(/[,; ]+/).filter(Boolean).map(Number);
    return [name, many ? numbers : numbers[0]];
  }));
  const wrong = () => inputs.filter(([, input]) => input.value.trim() && input.value.split(/[,; ]+/).filter(Boolean).some((text) => !Number.isFinite(Number(text)))).map(([name]) => `${name} is no number.`);
  return { nodes: inputs.map(([, , , node]) => node), values, wrong };
}

/** What a profile would do: {told, against, series}. */
export async function lookAtProfile(profileId, bench, initial) {
  const profile = await api.profile(profileId, true);
  const { time_s, current_A, duration_s: length_s, charge_Ah, n_points: n } = profile;
  let charge_As = 0;
  const soc = time_s.map((t, k) => {
    if (k) charge_As += current_A[k - 1] * (t - time_s[k - 1]);
    return 100 * (initial + charge_As / 3600 / bench.capacity_Ah);
  });
  return {
    told: `${lengthWords(bench, length_s)} ${n} rows, ${quantity(charge_Ah[0], 3, "Ah")} net.`,
    against: objections(bench, length_s, current_A, charge_Ah, initial), series: { time_s, current_A, soc }, steps: [],
  };
}

/** What a protocol would do on a nominal cell; what the service refuses stands in `against`, `atOnce` where it would hardly begin. */
export async function lookAtProtocol(what, bench, initial, dt_s) {
  try {
    const seen = await api.previewProtocol({ ...what, bench: bench.name, initial_soc: Number.isFinite(initial) ? initial : undefined, dt_s: dt_s > 0 ? dt_s : undefined });
    const told = `${lengthWords(bench, seen.duration_s ?? NaN, "about ")} Voltages are those of a nominal cell between the limits; steps that end by a voltage take some ten percent more or less.`;
    const atOnce = Boolean(seen.stopped) && seen.duration_s <= AT_ONCE_S;
    return { told, atOnce, against: seen.stopped ? [`It would be stopped${atOnce ? " at once" : ""}: ${seen.stopped}`] : [], series: seen.series, steps: seen.steps };
  } catch (error) {
    return { told: "", against: [error.message], where: error.where, unanswered: error.unanswered, series: null, steps: [] };
  }
}

/** What the service would refuse of a profile, said while one still types. */
function objections({ limits = {}, capacity_Ah }, length_s, currents, charge_Ah, initial) {
  const found = [];
  const [low_A, high_A] = limits.current_A ?? [-Infinity, Infinity];
  const [least_A, most_A] = [Math.min, Math.max].map((pick) => currents.reduce((a, b) => pick(a, b)));
  if (least_A < low_A || most_A > high_A) found.push(`Current ${fixed(least_A, 2)} … ${fixed(most_A, 2)} A leaves the bench's limits ${fixed(low_A, 2)} … ${fixed(high_A, 2)} A.`);
  const [low, high] = limits.soc ?? [0, 1];
  const ends = charge_Ah.slice(1).map((each) => initial + each / capacity_Ah);
  if (Number.isFinite(initial) && (ends[0] < low - 1e-9 || ends[1] > high + 1e-9)) {
    found.push(`Counted state of charge ${fixed(100 * ends[0], 1)} … ${fixed(100 * ends[1], 1)} % leaves the bench's limits ${fixed(100 * low, 0)} … ${fixed(100 * high, 0)} %.`);
  }
  if (Number.isFinite(limits.duration_s) && length_s > limits.duration_s) found.push(`${duration(length_s)} is longer than the bench allows, ${duration(limits.duration_s)}.`);
  return found;
}

const LAWS = { rest: "Rest", current: "Constant current", cc_cv: "CC-CV", voltage: "Constant voltage", power: "Power", resistance: "Resistance", profile: "Profile" };

/** The steps of a protocol as a table. */
export function stepTable(steps) {
  if (!steps.length) return [];
  const end = ({ quantity, above, value }) => {
    const [name, unit, scale] = QUANTITIES.get(quantity) ?? [quantity, "", 1];
    return `${name} ${above ? "≥" : "≤"} ${rounded(scale * value, 5)} ${unit}`.trim();
  };
  const unit = { current: "A", cc_cv: "A", voltage: "A", power: "W", resistance: "Ohm" };
  const level = ({ law, level: size, voltage_V: held }) => [Number.isFinite(size) && law !== "rest" ? `${rounded(size, 5)} ${unit[law] ?? ""}` : "", held ? `held at ${rounded(held, 5)} V` : ""].filter(Boolean).join(", ");
  return [el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": "Steps" }, el("table", {}, el("caption", { text: "Steps" }),
    el("thead", {}, el("tr", {}, ["", "Step", "Kind", "Level", "Ends by", "Times"].map((text) => (text ? el("th", { scope: "col", text }) : el("td", {}))))),
    el("tbody", {}, steps.map((step) => el("tr", {}, [step.step_index, step.name, LAWS[step.law] ?? step.law, level(step), [...new Set(step.ends.map(end))].join(" or "), step.most_times > 1 ? `at most ${step.most_times}` : ""].map((cell) => el("td", {}, String(cell ?? "")))))))) ];
}
