// What a diagnosis promises of an effect, and whether that has come. Only what the training runs say is a forecast.
import { el } from "./dom.js";
import { fixed, percent, quantity } from "./format.js";

// Less than this share of the promised fall in the squared error is none to speak of; from the second on it is as promised.
const SOME = 0.5;
const MOST = 0.8;

const fall = (before, after) => 1 - (after / before) ** 2;
const mV = (value, digits = 1) => quantity(value, digits, "mV");

/** Figures of a finding: `forecast` where the runs that are looked at gave no more than their starts, else fitted to them. */
export function promise({ evidence = {}, error_before_mV: all_mV, error_after_mV: after_mV }, { mode, train_run_ids: train = [] }) {
  const forecast = mode === "structure" && train.length > 0;
  const own_mV = evidence.forecast_samples_before_mV;
  // A forecast goes no further than the trained state of charge: what it is held against must not either.
  const before_mV = forecast && Number.isFinite(own_mV) ? own_mV : all_mV;
  return { forecast, before_mV, after_mV, all_mV, within: before_mV !== all_mV, share: Math.max(0, fall(before_mV, after_mV)) };
}

/** What the bold figure of a finding is, and beside it what else speaks for the effect. */
export function promiseWords(finding, record) {
  const { forecast, before_mV, after_mV, all_mV, within, share } = promise(finding, record);
  const { evidence = {} } = finding;
  const of = within ? `, within the trained state of charge (all samples: ${mV(all_mV)})` : "";
  const what = forecast ? `forecast by the training runs for the runs that are looked at${of}` : "fitted to these very runs: no forecast";
  return [
    el("p", { class: "promise", data: { forecast } }, el("strong", { text: `${mV(before_mV, 2)} → ${mV(after_mV, 2)}` }), ` ${what}; ${percent(share, 0)} of the squared error`),
    el("p", { class: "about", text: besides(evidence, after_mV).join(" ") }),
  ];
}

function besides(evidence, after_mV) {
  const { forecast_without_mV: without, refitted_before_mV: free, refitted_after_mV: freed, held_out_share: blocks, held_out_before_mV: held, held_out_after_mV: helped,
    reference_before_mV: finer, reference_after_mV: left } = evidence;
  const said = [
    [without, () => `The same refit without the effect: ${mV(without)}; so the effect itself takes ${mV(without)} to ${mV(after_mV)}.`],
    [free, () => `Fitted to all runs at once: ${mV(free)} without it, ${mV(freed)} with it.`],
    [blocks, () => `In blocks that were held out it explains ${percent(Math.max(0, blocks), 0)} of the squared error.`],
    [held, () => `Training runs that were held out: ${mV(held)} without it, ${mV(helped)} with it.`],
    [finer, () => `Held against a finer model of the training runs: ${mV(finer)} without it, ${mV(left)} with it.`],
  ];
  return said.filter(([value]) => Number.isFinite(value)).map(([, words]) => words());
}

const rose = ({ before_mV: before, after_mV: after } = {}) => Number.isFinite(before) && Number.isFinite(after) && after > before;

/** Whether what was promised has come: `good`, and the words. `told` is a `promise`, null where no diagnosis is at hand. */
export function outcome(added, told) {
  const { error_before_mV: before, error_after_mV: after, inside = {} } = added;
  const fell = after < before && !rose(inside);
  const said = rose(inside) ? ["Inside of what the model was trained on the error rose."] : [];
  if (!told || !Number.isFinite(told.after_mV) || !(told.share > 0)) return { good: fell, words: said };
  const inner = told.within && Number.isFinite(inside.after_mV);
  const got = inner ? fall(inside.before_mV, inside.after_mV) : fall(before, after);
  const part = got / told.share;
  const came = part >= MOST ? "the forecast held" : part >= SOME ? `the forecast held in part: ${percent(part, 0)} of the fall of the squared error came` : "the forecast did not hold";
  const where = inner ? `${mV(inside.after_mV)} there, ${mV(after)} over all samples` : mV(after);
  const first = told.forecast ? `Forecast ${mV(told.after_mV)}${inner ? " within the trained state of charge" : ""}, got ${where}: ${came}.`
    : `Fitted to the runs that were looked at the effect left ${mV(told.after_mV)}; learned from the training runs it leaves ${mV(after)}${part >= SOME ? "" : ": what was found does not carry over"}.`;
  return { good: fell && part >= SOME, words: [first, ...said] };
}

/** The errors of both versions inside and outside of what the version before was trained on. */
export function apart({ inside, outside }) {
  const rows = [["inside", inside], ["outside", outside]].filter(([, pair]) => Number.isFinite(pair?.before_mV));
  if (!rows.length) return null;
  return el("ul", { class: "apart", "aria-label": "Error inside and outside of the trained ranges" }, rows.map(([side, pair]) =>
    el("li", { data: { side } }, `${side === "inside" ? "Inside" : "Outside"} of the trained ranges: `,
      el("span", { class: "number", text: `${mV(pair.before_mV)} → ${mV(pair.after_mV)}` }), ` (${pair.after_mV > pair.before_mV ? "+" : ""}${fixed(pair.after_mV - pair.before_mV, 1)})`)));
}
