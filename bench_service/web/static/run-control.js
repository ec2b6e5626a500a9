// What can be done with a run that goes on, from its own page; STOP stands in the header.
import { hold, skip } from "./actions.js";
import { el, renderKeyed, setText } from "./dom.js";
import { duration, localTime, quantity } from "./format.js";
import { TimeLeft } from "./time-left.js";
import { inMotion } from "./words.js";

export function controlPanel(state, data) {
  const left = el("p", { class: "time-left" });
  const answer = el("p", { class: "answer", role: "status" });
  const buttons = el("div", { class: "form-end" });
  const node = el("div", { class: "run-control" }, left, buttons, answer);
  const timeLeft = new TimeLeft();
  const show = () => {
    const bench = state.benches.get(data.run.bench);
    const ours = inMotion(bench) && bench.run_id === data.run.id;
    node.hidden = !ours && !answer.textContent;
    setText(left, ours ? [stepWords(bench.live), timeLeft.words(bench)].filter(Boolean).join(" · ") : "");
    renderKeyed(buttons, holdKey(ours ? bench : null), () => (ours ? holdButton(state, bench) : []));
    const told = state.answers.get(data.run.bench);
    setText(answer, told ? `${localTime(told.at)} ${told.text}` : "");
    answer.dataset.tone = told ? { true: "good", false: "bad", null: "neutral" }[told.ok] : "";
  };
  state.on("benches live answers", show);
  return { node, show };
}

/** Where a protocol is: "step 3, charge, cycle 2, for 4 min 10 s, 0.210 Ah". */
export function stepWords(live) {
  if (!live?.step_count) return "";
  const moved = Math.abs(live.step_charge_Ah ?? 0) >= 5e-5 ? quantity(live.step_charge_Ah, 4, "Ah") : "";
  return [`step ${live.step_count}`, live.step_name, live.cycle_count ? `cycle ${live.cycle_count}` : "", `for ${duration(live.step_time_s)}`, moved].filter(Boolean).join(", ");
}

export const holdKey = (bench) => (bench ? `${bench.state} ${Boolean(bench.live?.step_count)}` : "none");

/** Pause or resume, as the bench's state has it. */
export function holdButton(state, { name, state: is, live }) {
  const pause = () => el("button", { id: "pause", type: "button", text: "Pause", title: "Output off, the profile waits", on: { click: () => hold(state, name, true) } });
  if (is === "running") return [pause(), live?.step_count ? el("button", { id: "skip", type: "button", text: "Skip step", title: "End this step, go on with the next", on: { click: () => skip(state, name) } }) : null].filter(Boolean);
  if (is === "paused") return el("button", { id: "resume", class: "primary", type: "button", text: "Resume", on: { click: () => hold(state, name, false) } });
  return [];
}
