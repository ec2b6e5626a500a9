// Commands to the service and what came of them.
import { api } from "./api.js";
import { duration } from "./format.js";
import { inMotion } from "./words.js";

/** After a STOP, say once when the bench has left its motion: that is what the person waits for. */
export function confirmRest(state, name) {
  const answer = state.answers.get(name);
  const bench = state.benches.get(name);
  if (!answer?.stopAsked || answer.confirmed || inMotion(bench)) return;
  const after = duration((performance.now() - answer.stopAsked) / 1000);
  state.setAnswer(name, { ...answer, confirmed: true, text: `${answer.text} Bench ${bench.state} after ${after}.` });
}

/** Stop what runs on a bench, now; the answer, or that none came, is shown beside the bench. */
export async function stopBench(state, name) {
  const asked = performance.now();
  state.setAnswer(name, { ok: null, text: "STOP sent, waiting for the answer …" });
  try {
    await api.stopBench(name);
    const took_ms = Math.round(performance.now() - asked);
    state.setAnswer(name, { ok: true, stopAsked: asked, text: `STOP: taken after ${took_ms} ms.` });
    if (!inMotion(state.benches.get(name))) confirmRest(state, name);
  } catch (error) {
    // 4xx: the service is there and says why; anything else: nobody has confirmed that the current is off.
    const heard = error.status >= 400 && error.status < 500;
    const advice = heard ? "" : " Nobody confirmed the stop: use the cycler's own stop if the current must go off.";
    state.setAnswer(name, { ok: false, text: `STOP: ${error.message}${advice}` });
  }
}

/** Hold the run, or let it go on. */
export async function hold(state, name, on) {
  const word = on ? "Pause" : "Resume";
  state.setAnswer(name, { ok: null, text: `${word} sent …` });
  try {
    await (on ? api.pauseBench(name) : api.resumeBench(name));
    state.setAnswer(name, { ok: true, text: on ? "Pause: taken. The output goes off, the profile waits." : "Resume: taken." });
  } catch (error) {
    state.setAnswer(name, { ok: false, text: `${word}: ${error.message}` });
  }
}

/** End the step of the protocol that plays. */
export async function skip(state, name) {
  try {
    await api.skipStep(name);
    state.setAnswer(name, { ok: true, text: "Skip: taken. The protocol goes on with its next step." });
  } catch (error) {
    state.setAnswer(name, { ok: false, text: `Skip: ${error.message}` });
  }
}

export async function acknowledge(state, name) {
  state.setAnswer(name, { ok: null, text: "Acknowledging …" });
  try {
    state.mergeBench(await api.acknowledge(name));
    state.setAnswer(name, { ok: true, text: "Fault acknowledged." });
  } catch (error) {
    state.setAnswer(name, { ok: false, text: `Acknowledge: ${error.message}` });
  }
}
