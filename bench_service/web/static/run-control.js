// What can be done with a run that goes on, from its own page; STOP stands in the header.
import { hold } from "./actions.js";
import { el, renderKeyed, setText } from "./dom.js";
import { localTime } from "./format.js";
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
    setText(left, ours ? timeLeft.words(bench) : "");
    renderKeyed(buttons, String(ours && bench.state), () => (ours ? holdButton(state, bench) : []));
    const told = state.answers.get(data.run.bench);
    setText(answer, told ? `${localTime(told.at)} ${told.text}` : "");
    answer.dataset.tone = told ? { true: "good", false: "bad", null: "neutral" }[told.ok] : "";
  };
  state.on("benches live answers", show);
  return { node, show };
}

/** Pause or resume, as the bench's state has it. */
export function holdButton(state, { name, state: is }) {
  if (is === "running") return el("button", { id: "pause", type: "button", text: "Pause", title: "Output off, the profile waits", on: { click: () => hold(state, name, true) } });
  if (is === "paused") return el("button", { id: "resume", class: "primary", type: "button", text: "Resume", on: { click: () => hold(state, name, false) } });
  return [];
}
