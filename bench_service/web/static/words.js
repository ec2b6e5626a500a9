// One place for what a state is called and which tone it has.

/** What a figure means, told where the pointer rests on its title. */
export const GLOSSARY = {
  "Voltage error": "Root of the mean square of measured − model. The model is given the measured current and temperature, never the voltage.",
  "Held-out voltage error": "Root of the mean square of measured − model, on a run that the model did not learn from.",
  "95 % of the samples below": "Of 100 samples 95 are nearer to the model than this.",
  "With its start fitted too": "The error where the state of charge at the start is read off the whole voltage in place of what was stated.",
  "Cannot be foretold": "The part of the error that looks like noise from sample to sample: no better model takes it away.",
  "Outside what the model knows": "Samples at a state of charge, current or temperature that did not occur in the runs that the model learned from.",
  "Inside the 95 % band": "Share of the measured voltages in the band in which the model expects 95 of 100.",
  "Temperature error": "Root of the mean square of measured − modelled temperature.",
};

/** Whether a run is on a bench. */
export const inMotion = (bench) => ["running", "paused", "stopping"].includes(bench?.state);

/** Whether hardware has no valid commissioning record, and must say so. */
export const isUnverified = (commissioning) => ["missing", "failed", "void"].includes(commissioning?.state);

const BENCH = {
  offline: ["muted", "offline"], idle: ["good", "idle"], running: ["active", "running"], paused: ["warn", "paused"],
  stopping: ["warn", "stopping"], fault: ["bad", "fault"],
};
const RUN = {
  created: ["muted", "created"], running: ["active", "running"], paused: ["warn", "paused"], completed: ["good", "completed"],
  stopped: ["warn", "stopped"], fault: ["bad", "fault"], interrupted: ["bad", "interrupted"],
};
const CAMPAIGN = {
  queued: ["muted", "waiting its turn"],
  running: ["active", "running"], completed: ["good", "completed"], failed: ["bad", "failed"],
  stopped: ["warn", "stopped"], interrupted: ["bad", "interrupted"],
};
const STAGE = {
  pending: ["muted", "waiting"], waiting: ["muted", "waiting"], running: ["active", "running"], done: ["good", "done"],
  completed: ["good", "done"], failed: ["bad", "failed"], stopped: ["warn", "stopped"], skipped: ["muted", "skipped"],
  interrupted: ["bad", "interrupted"],
};
const SEVERITY = { info: ["muted", "info"], warning: ["warn", "warning"], error: ["bad", "error"] };
const BOOKS = { bench: BENCH, run: RUN, campaign: CAMPAIGN, stage: STAGE, severity: SEVERITY };

/** [tone, word] of a state; one that the page does not know is shown as it is. */
export function wordFor(book, state) {
  return BOOKS[book][state] ?? ["neutral", String(state ?? "unknown")];
}

/** [tone, word] of a bench as the page may claim it: without a connection a state is only what it was. */
export function benchWord(state, bench) {
  const [tone, word] = wordFor("bench", bench.state);
  return !state.connected && state.everConnected ? ["muted", `was ${word}`] : [tone, word];
}

const STAGE_TITLES = {
  design: "Design profile", run: "Run on the bench", fit: "Fit the model", rounds: "Design again", observe: "Observe live",
  compare: "Compare", change: "Play the changed cell", diagnose: "Find the effect", report: "Report", done: "Done",
};

export function stageTitle(name) {
  return STAGE_TITLES[name] ?? name;
}
