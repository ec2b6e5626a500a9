// Brings the page to life: loads, listens, and keeps the two in step.
import { confirmRest } from "./actions.js";
import { api } from "./api.js";
import { benchCards } from "./bench-cards.js";
import { benchPanel } from "./bench-panel.js";
import { campaignPanel } from "./campaign-panel.js";
import { eventsPanel } from "./events-panel.js";
import { header, stopButtons } from "./header.js";
import { LiveLink } from "./live.js";
import { runStart } from "./run-start.js";
import { runsPanel } from "./runs-panel.js";
import { State } from "./state.js";
import { Trace } from "./trace.js";

const HEALTH_EVERY_MS = 5000;
const RUNS_EVERY_MS = 5000;
const REFILL_EVERY_MS = 1500;
const RUNS_PAGE = 20;
const SETTLED_AFTER_MS = 1000;

const state = new State();
const traces = new Map();
let runsShown = RUNS_PAGE;
let runsFilter = null;
let silent = 0;

const link = new LiveLink(onMessage, onLink);

function onMessage(message) {
  state.lastHeard = Date.now();
  if (message.type === "live") state.mergeLive(message);
  else if (message.type === "bench") state.mergeBench(message);
  else if (message.type === "campaign") state.mergeCampaign(message);
  else if (message.type === "event") state.addEvent(message);
}

function onLink(change) {
  state.link = { retryAt: null, reason: "", ...change };
  if (change.state !== "connecting") state.failed = change.state === "down";
  if (change.state === "live") {
    state.everConnected = true;
    state.lastHeard = Date.now();
    loadAll();
  }
  state.tell("link");
}

/** Everything anew: after each connection, since frames may have been missed in between. */
async function loadAll() {
  checkHealth();
  const load = async (ask, take) => { try { take(await ask); } catch (error) { console.warn(error.message); } };
  await Promise.all([
    load(api.benches(), (benches) => { state.setBenches(benches); api.learnStopPorts(benches.map((bench) => bench.name)); }),
    load(api.campaigns(), (campaigns) => state.setCampaigns(campaigns)),
    load(api.events(50), (events) => { state.events = events; }),
    loadRuns(),
  ]);
  state.loaded = true;
  for (const topic of ["benches", "benches-listed", "campaigns", "events"]) state.tell(topic);
  await fillTrace();
}

async function loadRuns() {
  try {
    const filter = runsFilter;
    const newest = await api.runs({ limit: runsShown + 1 });
    const found = filter ? await api.runs({ ...filter, limit: runsShown + 1 }) : newest;
    state.runs = newest.slice(0, runsShown);
    if (filter !== runsFilter) return; // something else was asked for meanwhile
    state.listedRuns = found.slice(0, runsShown);
    state.moreRuns = found.length > runsShown;
    state.tell("runs");
  } catch (error) {
    console.warn(error.message);
  }
}

async function checkHealth() {
  try {
    state.health = await api.health();
    state.lastHeard = Date.now();
    silent = 0;
  } catch {
    state.health = null;
    silent += 1;
    // Twice without an answer: an open socket to a service that hangs must not look alive.
    if (silent >= 2 && state.connected) link.renew();
  }
  state.tell("health");
}

function traceOf(name) {
  if (!traces.has(name)) traces.set(name, new Trace(name));
  return traces.get(name);
}

async function fillTrace(runId = state.bench?.run_id) {
  const bench = state.bench;
  if (!bench) return;
  try {
    await traceOf(bench.name).fill(runId);
  } catch (error) {
    console.warn(error.message);
  }
  state.tell("trace", bench.name);
}

function select(name) {
  state.selected = name;
  history.replaceState(null, "", `?bench=${encodeURIComponent(name)}${location.hash}`);
  state.tell("select");
  fillTrace();
}

state.selected = new URLSearchParams(location.search).get("bench");
state.on("live", ({ name, live }) => { if (traceOf(name).push(live)) state.tell("trace", name); });
state.on("benches", (change) => {
  for (const name of state.benches.keys()) traceOf(name);
  if (!change) return;
  const bench = state.benches.get(change.name);
  if (change.before !== bench.state) {
    confirmRest(state, change.name);
    loadRuns();
    setTimeout(loadRuns, SETTLED_AFTER_MS); // the record of a run follows the state of its bench
  }
  // At the end of a run its stored samples replace the thinner live ones.
  if (change.runBefore && change.runBefore !== bench.run_id && change.name === state.selected) fillTrace(change.runBefore);
});
state.on("campaigns", (change) => { if (change && change.stageBefore !== state.campaigns.get(change.id)?.stage) loadRuns(); });

header(state, { reconnect: () => link.open() });
stopButtons(state);
benchCards(state, { select });
benchPanel(state, { get: traceOf });
campaignPanel(state);
runStart(state, document.getElementById("start-section"), () => loadRuns());
runsPanel(state, { more: () => { runsShown += RUNS_PAGE; loadRuns(); }, look: (filter) => { runsFilter = Object.values(filter).some(Boolean) ? filter : null; runsShown = RUNS_PAGE; loadRuns(); } });
eventsPanel(state);

link.open();
setInterval(() => state.tell("tick"), 1000);
setInterval(checkHealth, HEALTH_EVERY_MS);
// What is drawn comes from the store, each time only what is new: the feed is for the eye and would draw pulses as slopes.
setInterval(() => { if (state.connected && !document.hidden && state.bench?.run_id) fillTrace(); }, REFILL_EVERY_MS);
setInterval(() => {
  const moving = [...state.benches.values()].some((bench) => bench.run_id) || state.runs?.some((run) => run.state === "running");
  if (state.connected && moving) loadRuns();
}, RUNS_EVERY_MS);
