// Steps 5 and 6: the effect is put in, and the held-out error of every version that was ever tried.
import { el } from "./dom.js";
import { waterfall } from "./error-charts.js";
import { quantity, timeElement } from "./format.js";
import { apart, outcome } from "./improve-forecast.js";
import { inText, parameterText } from "./improve-which.js";

// Signals of a structure, as in "low_pass:60/3000", in the words of a laboratory.
const SIGNALS = [[/\bsurface_soc(:\S*\d)?/g, "state of charge at the particles' surface"], [/\bsoc\b/g, "state of charge"], [/\blow_pass:([\d.]+)(\/[\d.]+)*/g, "current smoothed over $1 s"],
  [/:[\d./+-]*\d/g, ""], [/_/g, " "]];
const inWords = (text) => SIGNALS.reduce((said, [signal, words]) => said.replace(signal, words), text);

/** `told`: what the diagnosis promised, see `promise`; null where none is at hand. */
export function addedStep(added, titleOf, told, { next }) {
  const fell = added.error_after_mV < added.error_before_mV;
  const { good, words } = outcome(added, told);
  return el("div", { class: "notice", role: "status", data: { tone: good ? "good" : "warn", effect: added.effect } },
    el("strong", { text: `${titleOf(added.effect)} is in the model: held-out error ${quantity(added.error_before_mV, 2, "mV")} → ${quantity(added.error_after_mV, 2, "mV")}` }),
    words.length ? el("p", { class: "outcome", text: words.join(" ") }) : null,
    apart(added),
    fell ? null : el("span", { text: "It did not help on the runs that judge. Go on from the parent below, and try another finding." }),
    el("span", { class: "parameters" }, Object.entries(added.parameters ?? {}).map(([name, value]) => el("span", { class: "parameter", text: parameterText(name, value) }))),
    added.remark ? el("span", { class: "about", text: `${inWords(added.remark)}.` }) : null,
    el("button", { type: "button", class: good ? "primary" : "", text: "Go on with the new version", on: { click: () => next(added.model) } }));
}

/** The chain in its order, each version followed by what was tried from its parent and not kept. */
function inOrder({ chain, models }) {
  const sorted = [];
  const place = (model) => {
    sorted.push(model);
    const children = models.filter((each) => each.parent_id === model.id);
    for (const child of children.filter((each) => !each.in_chain)) place(child);
    for (const child of children.filter((each) => each.in_chain)) place(child);
  };
  place(models.find((each) => each.id === chain[0]));
  return sorted;
}

export function watchStep(chain, titleOf, keep, { goOn }) {
  const models = inOrder(chain);
  const judged = models.filter((each) => each.held_out);
  const plot = el("div", { class: "plot tall", role: "img", "aria-label": "Held-out error from version to version" });
  const sets = new Set(judged.map((each) => [...each.held_out.run_ids].sort().join()));
  const versions = judged.map((each) => ({ id: each.id, label: each.effect ? `+ ${inText(titleOf(each.effect))}` : each.parent_id ? "refitted" : "first model", before: each.held_out.before_mV ?? NaN, after: each.held_out.rmse_mV, kept: each.in_chain }));
  const now = judged.find((each) => each.id === chain.model_id);
  if (now && now.parent_id) versions.push({ id: now.id, label: "now", before: NaN, after: now.held_out.rmse_mV, kept: true, now: true });
  requestAnimationFrame(() => { if (plot.isConnected && versions.length) keep(waterfall(plot, versions, chain.noise_floor_mV ?? NaN, goOn)); });
  return el("div", { class: "watch" }, versions.length ? plot : el("p", { class: "empty", text: "No version has been judged on runs it never saw." }),
    sets.size > 1 ? el("p", { class: "about", text: "Not all versions were judged on the same runs: only a step and its parent compare." }) : null,
    el("p", { class: "about", text: "Grey: the first model. Green: the error fell. Red: it rose. Outlined: tried, not in this chain. Blue: the version shown. Dashed line: noise of the measurement." }),
    table(chain, models, titleOf, goOn));
}

function table(chain, models, titleOf, goOn) {
  const heads = ["Version", "Effect added", "Held-out error", "Made", ""];
  const now = chain.model_id;
  return el("div", { class: "table-scroll" }, el("table", { class: "rows named" }, el("caption", { text: "Versions" }),
    el("thead", {}, el("tr", {}, heads.map((head) => (head ? el("th", { scope: "col", text: head }) : el("td", {}))))),
    el("tbody", {}, models.map((each) => {
      const name = each.effect ? titleOf(each.effect) : each.parent_id ? "none, refitted" : "none, first model";
      const button = each.id === now ? el("span", { class: "about", text: "shown now" })
        : el("button", { type: "button", class: "small", text: chain.chain.includes(each.id) ? "Back to this one" : "Go on from here", on: { click: () => goOn(each.id) } });
      return el("tr", { data: { model: each.id } }, [el("span", { title: each.id }, el("strong", { text: each.name })), name, each.held_out ? quantity(each.held_out.rmse_mV, 2, "mV") : "not judged",
        timeElement(each.created_utc), button].map((cell, k) => el("td", { data: { label: heads[k] } }, cell)));
    }))));
}
