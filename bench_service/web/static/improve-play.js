// The next experiment: designed for the bench, played on it, and handed back.
import { api } from "./api.js";
import { el } from "./dom.js";
import { fixed } from "./format.js";
import { busyBox, follow } from "./jobs.js";

const LOOK_EVERY_MS = 700;
const ENDED = ["completed", "stopped", "fault", "interrupted"];

/** A bench to choose and a button; `played(run)` after the run has completed. */
export function playBox(state, diagnosisId, played) {
  const bench = el("select", { "aria-label": "Bench to play it on" }, [...state.benches.keys()].map((name) => el("option", { value: name, text: name, selected: name === state.selected })));
  const message = el("p", { class: "form-message", role: "alert" });
  const place = el("div", { class: "play-place" });
  const button = el("button", { type: "button", class: "primary", text: "Design it and play it", on: { click: async () => {
    const found = state.benches.get(bench.value);
    // Better before a design of minutes than after it.
    message.textContent = found?.state === "idle" ? "" : `${bench.value} is ${found?.state ?? "unknown"}: it must be idle to play a run. ${found?.reason ?? ""}`;
    if (message.textContent) return;
    button.disabled = true;
    try {
      const designed = await during(place, "Designing the experiment", async (update) => follow(await api.experiment(diagnosisId, bench.value), update));
      const told = Math.min(...(designed.figures?.separation ?? [NaN]));
      message.textContent = "";
      const run = await during(place, `Playing it on ${bench.value}${Number.isFinite(told) ? `: the rivals will differ by ${fixed(told, 0)} standard deviations` : ""}`, (update) => play(state, bench.value, designed, update));
      if (run.state === "completed") await played(run);
      else message.textContent = `The run ended as ${run.state}: ${run.reason ?? "no reason given"}`;
    } catch (error) {
      message.textContent = error.message;
    } finally {
      button.disabled = false;
    }
  } } });
  return el("div", { class: "play" }, el("div", { class: "form-end" }, bench, button), place, message);
}

async function during(place, title, work) {
  const box = busyBox(title);
  place.replaceChildren(box.node);
  try {
    return await work(box.update);
  } finally {
    box.end();
  }
}

async function play(state, bench, { profile_id, name, dt_s, initial_soc }, update) {
  let run = await api.startRun({ bench, profile_id, dt_s, initial_soc, name });
  while (!ENDED.includes(run.state)) {
    await new Promise((done) => { setTimeout(done, LOOK_EVERY_MS); });
    run = await api.run(run.id).catch((error) => { if (error.status) throw error; return run; });
    const live = state.benches.get(bench)?.live;
    if (live?.run_id === run.id) update({ progress: live.progress ?? 0, message: "STOP is at the top of the page" });
  }
  return run;
}
