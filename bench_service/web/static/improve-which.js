// Step 4: the verdict in plain words, each finding with its evidence, and what to do next.
import { chip, el } from "./dom.js";
import { legend } from "./charts.js";
import { errorLeft, profileChart, variableName } from "./error-charts.js";
import { reportLinks } from "./report-links.js";
import { confidence, duration, fixed, percent, quantity, rounded } from "./format.js";
import { promise, promiseWords } from "./improve-forecast.js";

// An error that is larger than so many times the noise is more than noise to anybody.
const FAR_ABOVE_NOISE = 2;
const TONE = { missing: "active", nothing_missing: "good", ambiguous: "warn", unknown_effect: "warn" };
const PREFIX = { V: [1e3, "mV"], Ohm: [1e3, "mΩ"], "V/K": [1e3, "mV/K"], "W/K": [1, "W/K"] };

/** A title inside a sentence; an abbreviation stays as it is. */
export const inText = (title) => (/^[A-Z][a-z]/.test(title) ? title[0].toLowerCase() + title.slice(1) : title);

/** `titleOf(effect)` names an effect for people; `shownOver(effect)` names the variables it shows best over: the first that the runs have. */
export function whichStep(record, titleOf, keep, { add, addNote, play, profiles, shownOver }) {
  const { verdict, findings, depends_on: depends, next_experiment: next, remarks = [] } = record.result;
  return [
    el("div", { class: "notice verdict", role: "status", data: { tone: TONE[verdict] ?? "neutral", verdict } },
      el("strong", { text: verdictWords(record, titleOf) }),
      el("span", { text: leftWords(record) }),
      remarks.map((text) => el("span", { class: "about", text: `Note: ${text}.` }))),
    reportLinks("diagnoses", record.id, "the diagnosis"),
    depends.length ? el("div", {}, el("h4", { text: "What the rest depends on" }), el("ul", { class: "regions" }, depends.map(dependence))) : null,
    findings.length ? el("div", { class: "which" }, el("ol", { class: "findings", "aria-label": "Findings" }, findings.map((each) => finding(each, record, titleOf, add, addNote, picture(shownOver(each.effect), profiles, keep)))),
      leftChart(record, titleOf, keep)) : null,
    next ? experiment(next, titleOf, play()) : null,
  ];
}

const above = ({ unexplained_mV: left, noise_floor_mV: floor }) => (Number.isFinite(floor) && left > FAR_ABOVE_NOISE * floor ? 1 - (floor / left) ** 2 : 0);

/** What nothing in the answer explains; where that is much more than noise, "nothing is missing" is not all there is to say. */
function leftWords(record) {
  const { result } = record;
  const { verdict, mode, unexplained_mV: left, noise_floor_mV: floor, findings: [first] } = result;
  const words = `Left unexplained${first && promise(first, record).within ? " within the trained state of charge" : ""}: ${quantity(left, 2, "mV")}${Number.isFinite(floor) ? `, noise floor ${quantity(floor, 2, "mV")}` : ""}.`;
  if (verdict !== "nothing_missing" || !above(result)) return words;
  return `${words} ${percent(above(result), 0)} of its square is more than noise: ${mode === "change"
    ? "no more than this model is off by from one run of the cell to another. A change is told where it is larger than what these runs would have shown of it (power)."
    : "the model itself is off by that much. Another structure or more training data come before any effect."}`;
}

function verdictWords({ result }, titleOf) {
  const { verdict, mode, findings: [first] } = result;
  const what = first ? titleOf(first.effect) : "An effect";
  if (verdict === "missing") return mode === "change" ? `${what}: that is new since the model was made.` : `${what}: that is what the model lacks.`;
  if (verdict === "nothing_missing") {
    return `Nothing significant ${mode === "change" ? "has changed" : "is missing"}: ${above(result) ? "no known effect explains what is left" : "what is left is the model's own error and noise"}.`;
  }
  if (verdict === "ambiguous") {
    const rivals = [what, ...(first?.confounded_with ?? []).map((name) => inText(titleOf(name)))];
    return rivals.length > 1 ? `Something is there, but these data cannot tell: ${rivals.join(" or ")}?` : "Something is there, but these data cannot tell what.";
  }
  return "Something is there that no known effect explains.";
}

/** The effect that a verdict names, with its sizes; null where it names none. */
export function namedBy({ verdict, findings: [first] }) {
  if (!first || !["missing", "ambiguous"].includes(verdict)) return null;
  return { effect: first.effect, words: Object.entries(first.parameters).map(([name, value]) => parameterText(name, value)).join(", ") };
}

function dependence({ variable, strength }) {
  const bar = el("span", { class: "share-bar" });
  bar.style.width = `${100 * strength}%`;
  return el("li", {}, el("strong", { text: variableName(variable) }), el("span", { class: "share-track" }, bar), el("span", { class: "about", text: `${percent(strength, 0)} of it` }));
}

/** A parameter as a person reads it: its unit in front of small numbers, its standard deviation behind. */
export function parameterText(name, { value, std, unit }) {
  const [scale, shown] = PREFIX[unit] ?? [1, unit === "1" ? "" : unit];
  const suffix = `_${unit.replace("/", "_per_").replace(/^1_/, "")}`;
  const words = (name.endsWith(suffix) ? name.slice(0, -suffix.length) : name).replaceAll("_", " ");
  const size = Number.isFinite(std) && std > 0 ? std * scale : Math.abs(value * scale) / 100;
  const digits = Math.min(4, Math.max(0, 1 - Math.floor(Math.log10(size || 1))));
  const band = Number.isFinite(std) ? ` ± ${fixed(std * scale, digits)}` : "";
  return `${words} ${fixed(value * scale, digits)}${band} ${shown}`.trim();
}

/** A size to three digits, its unit in front of small numbers. */
export function sizeText(value, unit) {
  const [scale, shown] = PREFIX[unit] ?? [1, unit === "1" ? "" : unit];
  return `${rounded(value * scale, 3)} ${shown}`.trim();
}

/** The error of the model as it is, over the variable by which one tells the effect. */
function picture(variables, profiles, keep) {
  const profile = variables.map((name) => profiles.find((each) => each.variable === name)).find(Boolean);
  if (!profile) return null;
  const plot = el("div", { class: "plot small", role: "img", "aria-label": `Error of the model as it is over ${variableName(profile.variable)}` });
  requestAnimationFrame(() => { if (plot.isConnected) keep(profileChart(plot, profile)); });
  return el("div", {}, legend([["voltage", "after charge"], ["current", "after discharge"]]), plot);
}

function finding(each, record, titleOf, add, addNote, shown) {
  const bar = el("span", { class: "share-bar" });
  bar.style.width = `${100 * Math.max(0, Math.min(1, each.confidence))}%`;
  const rivals = each.confounded_with.length
    ? el("p", { class: "rivals" }, "Could as well be: ", each.confounded_with.map((name) => chip("warn", titleOf(name)))) : null;
  const button = el("button", { type: "button", class: each.rank === 1 ? "primary" : "", data: { effect: each.effect }, disabled: Boolean(addNote),
    text: `Add ${inText(titleOf(each.effect))}`, on: { click: () => add(each.effect) } });
  return el("li", { class: "finding", data: { effect: each.effect } },
    el("h4", { text: `${each.rank}. ${titleOf(each.effect)}` }),
    el("div", { class: "confidence" }, el("span", { text: "Confidence" }), el("span", { class: "share-track" }, bar), el("strong", { text: confidence(each.confidence) })),
    promiseWords(each, record),
    el("p", { class: "parameters" }, Object.entries(each.parameters).map(([name, value]) => el("span", { class: "parameter", text: parameterText(name, value) }))),
    el("p", { class: "about", text: each.explanation.replaceAll("+-", "±") }), shown, rivals, evidence(each.evidence), el("div", { class: "form-end" }, button, addNote ? el("span", { class: "about", text: addNote }) : null));
}

// Figures that decide, in words; one that is not here is told by its name.
const FACTS = {
  forecast_samples_before_mV: "Samples of the forecast, model as it is", forecast_without_mV: "Same refit without the effect",
  refitted_before_mV: "Fitted to all runs, without the effect", refitted_after_mV: "Fitted to all runs, with the effect",
  explained_share_of_new: "Explained of what goes beyond the model's own error", margin: "Lead over the best rival (1 and more tells them apart)",
  size_mV: "Size of the effect in these runs", least_mV: "Least size that would be named", held_out_share: "Explained in blocks that were held out",
  ratio: "Squared error over the model's own in training", n_rivals: "Rivals",
  held_out_before_mV: "Held-out training runs, without the effect", held_out_after_mV: "Held-out training runs, with the effect",
  log_likelihood_over_nothing: "Log-likelihood above “nothing is new”", probability_of_nothing: "Probability that nothing is new",
  reference_before_mV: "Against a finer model of the training runs, without the effect", reference_after_mV: "The same, with the effect",
  error_before_K: "Temperature error without the effect", error_after_K: "Temperature error with the effect",
};
const SHARES = ["explained_share_of_new", "held_out_share", "probability_of_nothing"];

const factWords = (name) => FACTS[name] ?? inText(name.replace(/_(mV|K)$/, "").replaceAll("_", " "));

function factText(name, value) {
  if (SHARES.includes(name)) return name === "probability_of_nothing" ? confidence(value) : percent(value, 0);
  const unit = name.match(/_(mV|K)$/)?.[1];
  return unit ? quantity(value, unit === "K" ? 2 : 1, unit) : fixed(value, Number.isInteger(value) ? 0 : 1);
}

function evidence(facts) {
  const rows = Object.entries(facts ?? {}).filter(([, value]) => Number.isFinite(value));
  if (!rows.length) return null;
  return el("details", { class: "more" }, el("summary", { text: "Evidence" }), el("dl", { class: "facts" }, rows.map(([name, value]) =>
    el("div", {}, el("dt", { text: factWords(name) }), el("dd", { class: "number", text: factText(name, value) })))));
}

function leftChart(record, titleOf, keep) {
  const { findings, noise_floor_mV: floor } = record.result;
  const { before_mV: before, within } = promise(findings[0], record);
  const plot = el("div", { class: "plot small", role: "img", "aria-label": "Error as it is and with each finding" });
  requestAnimationFrame(() => {
    if (plot.isConnected) keep(errorLeft(plot, before, findings.slice(0, 4).map((each) => ({ label: inText(titleOf(each.effect)), after: each.error_after_mV })), floor));
  });
  return el("div", { class: "left-box" }, el("h4", { text: within ? "What would be left within the trained state of charge" : "What would be left" }), plot);
}

function experiment(next, titleOf, play) {
  const range = ([low, high], digits, unit, scale = 1) => `${fixed(low * scale, digits)} to ${fixed(high * scale, digits)} ${unit}`;
  const within = [next.limits?.current_A && range(next.limits.current_A, 1, "A"), next.limits?.soc && `SoC ${range(next.limits.soc, 0, "%", 100)}`].filter(Boolean).join(", ");
  return el("div", { class: "notice", data: { tone: "active" } }, el("strong", { text: `Next experiment: a run that tells ${(next.rivals ?? []).map((name) => inText(titleOf(name))).join(" from ")}` }),
    el("span", { text: `${duration(next.duration_s)} of test time${within ? `, within ${within}` : ""}.` }), play);
}
