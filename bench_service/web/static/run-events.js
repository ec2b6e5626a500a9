// What happened in a run: in a list, and marked on the plot where its clock and the wall's go together.
import { chip, el, renderKeyed } from "./dom.js";
import { duration, timeElement } from "./format.js";
import { wordFor } from "./words.js";

const FIRST = 30;

/** Events in their order, each with its number and its place in test time, `at` (NaN where that is not known). */
export function eventsOf({ run, end_s: end }, events) {
  const began = Date.parse(run.started_utc ?? "");
  // A simulated bench may be faster than the wall clock: its times are stretched to it.
  const rate = Number.isFinite(run.elapsed_s) && run.elapsed_s > 0 && end > 0 ? end / run.elapsed_s : 1;
  const even = Math.abs(rate - 1) < 0.02 ? 1 : rate;
  return [...events].reverse().map((event, k) => {
    const at = even * ((Date.parse(event.created_utc) - began) / 1000);
    // A quick bench may have played minutes before its start is written down.
    if (event.code === "run_started") return { ...event, number: k + 1, at: 0 };
    return { ...event, number: k + 1, at: at >= 0 && at <= end ? at : NaN };
  });
}

export function eventsList(shown) {
  const node = el("div");
  const show = () => renderKeyed(node, JSON.stringify(shown.events), () => {
    if (!shown.events.length) return el("p", { class: "empty", text: "Nothing was noted in this run." });
    return el("ol", { class: "events" }, shown.events.slice(0, FIRST).map(row));
  });
  return { node, show };
}

function row({ number, severity, text, code, created_utc: at, at: test_s }) {
  const [tone, word] = wordFor("severity", severity);
  return el("li", {}, timeElement(at), chip(tone, word),
    el("span", { class: "event-text" }, el("strong", { text: `${number} ` }), text ?? code, Number.isFinite(test_s) ? el("span", { class: "about", text: ` at ${duration(test_s)} of test time` }) : null));
}
