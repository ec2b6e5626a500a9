// Long work: a bar, what is being done and for how long, until it has ended.
import { ApiError, api } from "./api.js";
import { el, setText } from "./dom.js";
import { duration, percent } from "./format.js";

const LOOK_EVERY_MS = 400;
const LONGEST_SILENCE = 20; // looks without an answer, about half a minute

const pause = (ms) => new Promise((done) => { setTimeout(done, ms); });

/** Wait for a job and give its result; a service that is silent for a moment is asked again. */
export async function follow(job, onChange) {
  let [found, silent] = [job, 0];
  onChange(found);
  while (found.state !== "done" && found.state !== "failed") {
    await pause(LOOK_EVERY_MS);
    try {
      found = await api.job(job.id);
      silent = 0;
    } catch (error) {
      silent += 1;
      if (error.status !== 0 || silent > LONGEST_SILENCE) throw error;
    }
    onChange(found);
  }
  if (found.state === "failed") throw new ApiError(0, "job_failed", found.error);
  return found.result;
}

/** A bar with its words; `update(job)` moves it, without a share it only shows that time passes. What is a job can be cancelled. */
export function busyBox(title) {
  const began = performance.now();
  const bar = el("progress", { max: 1, "aria-label": title });
  const words = el("span", { class: "busy-words" });
  const time = el("span", { class: "number about" });
  let job = null;
  const cancel = el("button", { type: "button", class: "small", text: "Cancel", "aria-label": `Cancel: ${title}`, hidden: true, on: { click: async () => {
    cancel.disabled = true;
    // Whoever follows the job hears of its end; a service that did not hear this is asked once more.
    await api.cancelJob(job).catch((error) => { setText(words, error.message); cancel.disabled = false; });
  } } });
  const node = el("div", { class: "busy", data: { tone: "active" } }, el("strong", { role: "status", text: title }),
    el("div", { class: "campaign-bar" }, bar, time), el("div", { class: "busy-end" }, words, cancel));
  const tick = () => setText(time, duration((performance.now() - began) / 1000));
  const timer = setInterval(tick, 500);
  tick();
  const update = ({ id, progress = 0, message = "", state = "" }) => {
    job = id ?? null;
    cancel.hidden = !job || state === "done" || state === "failed";
    if (progress > 0) bar.value = progress;
    const what = state === "queued" ? "waiting for other work to end" : message;
    setText(words, [progress > 0 ? percent(progress, 0) : "", what].filter(Boolean).join(" · "));
  };
  return { node, update, end: () => { clearInterval(timer); node.remove(); } };
}
