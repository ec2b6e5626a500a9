// The page of one run: everything that is shown of it follows from the address, so that a reload keeps its place.
import { api } from "./api.js";
import { el, setText } from "./dom.js";
import { comparePanel, loadCompared } from "./run-compare.js";
import { controlPanel } from "./run-control.js";
import { cyclesPanel } from "./run-cycles.js";
import { cursorTable } from "./run-cursors.js";
import { RunData } from "./run-data.js";
import { eventsOf, eventsList } from "./run-events.js";
import { factsPanel, notesPanel } from "./run-facts.js";
import { incrementalPanel } from "./run-incremental.js";
import { RunPlot } from "./run-plot.js";
import { rowsChooser } from "./run-rows.js";
import { offered } from "./run-signals.js";
import { plotGestures, zoomButtons } from "./run-zoom.js";
import { sidePage } from "./side-page.js";
import { State } from "./state.js";

const NEWS_EVERY_MS = 1500;
const SETTLE_MS = 60; // a turning wheel asks once, when it has come to rest
const POINTS = 2500;
const ROWS = ["voltage", "current", "soc.temperature"];
const place = (id) => document.getElementById(id);

const runId = decodeURIComponent(location.pathname.split("/").at(-1));
const given = new URLSearchParams(location.search);
const numberOf = (name) => (given.has(name) && Number.isFinite(Number(given.get(name))) ? Number(given.get(name)) : null);

const shown = {
  runs: [], events: [], comparison: null, over: given.get("over") === "charge" ? "charge" : "time", model: given.get("model"),
  rows: (given.get("rows")?.split(",") ?? ROWS).slice(0, 4).map((text) => { const [left, right] = text.split("."); return { left: left || null, right: right || null }; }),
  wanted: { from: numberOf("from"), to: numberOf("to") }, cursors: { a: numberOf("a"), b: numberOf("b") },
  get view() { return { from: this.wanted.from ?? 0, to: this.wanted.to ?? Math.max(this.whole.to, 1) }; },
  get whole() { return { from: 0, to: Math.max(0, ...this.runs.map((data) => data.end_s)) }; },
};
const state = new State();
let plot = null;
let parts = [];
let timer = 0;
let busy = false;

function remember() {
  const values = {
    rows: shown.rows.map(({ left, right }) => [left ?? "", right].filter((key) => key !== null).join(".")).join(","), over: shown.over === "time" ? null : shown.over,
    from: shown.wanted.from, to: shown.wanted.to, a: shown.cursors.a, b: shown.cursors.b, model: shown.model, with: shown.runs.slice(1).map((data) => data.run.id).join(",") || null,
  };
  const known = Object.entries(values).filter(([, value]) => value !== null).map(([name, value]) => [name, typeof value === "number" ? String(Math.round(value * 1e6) / 1e6) : value]);
  history.replaceState(null, "", `?${new URLSearchParams(known)}`);
}

function draw() {
  remember();
  plot?.draw();
  for (const part of parts) part.show?.();
  document.body.dataset.drawn = String(Number(document.body.dataset.drawn ?? 0) + 1);
}

/** Another part of the test time: drawn at once of what is there, then of what the service has of it. */
function change(view) {
  shown.wanted = view;
  draw();
  clearTimeout(timer);
  timer = setTimeout(load, SETTLE_MS);
}

/** What is asked for: a little more on both sides than is seen, so that lines run to the edge. */
function wantedPart() {
  const { from, to } = shown.wanted;
  const margin = 0.02 * (shown.view.to - shown.view.from);
  return { from: from === null ? null : Math.max(0, from - margin), to: to === null ? null : to + margin };
}

async function load() {
  const part = wantedPart();
  const began = performance.now();
  try {
    await Promise.all([...shown.runs.map((data) => data.load(part, POINTS)), loadCompared(shown, part)]);
    say("");
  } catch (error) {
    say(`Samples cannot be shown: ${error.message}`);
  }
  draw();
  document.body.dataset.loadMs = String(Math.round(performance.now() - began));
}

function say(text) {
  setText(place("run-message"), text);
}

async function news() {
  if (busy || document.hidden || !shown.runs.some((data) => data.goesOn)) return;
  busy = true;
  try {
    const changed = await Promise.all(shown.runs.filter((data) => data.goesOn).map(async (data) => {
      const record = await api.run(data.run.id);
      const ended = record.state !== data.run.state;
      data.run = record;
      return (await data.news()) || ended;
    }));
    if (changed.some(Boolean)) draw();
    say("");
  } catch (error) {
    say(`Not up to date: ${error.message}`);
  } finally {
    busy = false;
  }
}

async function refreshEvents() {
  const found = await api.runEvents(runId).catch(() => null);
  if (found) shown.events = eventsOf(shown.runs[0], found);
  draw();
}

async function addRun(otherId) {
  if (shown.runs.some((data) => data.run.id === otherId)) return;
  shown.runs.push(new RunData(await api.run(otherId)));
  await load();
}

function removeRun(otherId) {
  shown.runs = shown.runs.filter((data, k) => k === 0 || data.run.id !== otherId);
  load();
}

async function start() {
  let run;
  // The service reads a long run while the page learns what it is.
  api.samples(runId, { points: 2 }).catch(() => {});
  try {
    run = await api.run(runId);
  } catch (error) {
    say(error.status === 404 ? `There is no run ${runId}.` : error.message);
    place("run-facts").replaceChildren(el("h1", { text: "No run" }), el("p", {}, el("a", { href: "/#runs-section", text: "All runs" })));
    for (const panel of document.querySelectorAll(".of-a-run")) panel.hidden = true;
    return;
  }
  shown.runs = [new RunData(run)];
  state.selected = run.bench;
  state.tell("select");
  const others = given.get("with")?.split(",").filter(Boolean) ?? [];
  for (const other of others) shown.runs.push(...await api.run(other).then((found) => [new RunData(found)], () => []));
  const first = shown.runs[0];
  document.title = `${first.name} · Bench service`;
  await load();
  build(first);
  refreshEvents();
}

function build(first) {
  const facts = factsPanel(() => first);
  const control = controlPanel(state, first);
  place("run-facts").replaceChildren(facts.node, control.node);
  const rows = rowsChooser(shown, () => offered(shown.runs), draw);
  const gestures = { view: () => shown.view, whole: () => shown.whole, change, over: () => shown.over, cursor: (which, at) => { shown.cursors[which] = at; draw(); } };
  const zoom = zoomButtons(gestures);
  const cursors = cursorTable(shown, draw);
  const events = eventsList(shown);
  const node = el("div", { class: "run-plot", role: "img", "aria-label": `Samples of ${first.name} over ${shown.over === "time" ? "test time" : "charge"}` });
  place("run-plot").replaceChildren(rows.node, zoom.node,
    el("p", { class: "hint", text: "Drag over a stretch to zoom in, turn the wheel to zoom around the pointer, Shift and drag to move, double click for the whole run. A click sets cursor A, Shift and click cursor B." }),
    el("div", { class: "run-plot-box" }, node), cursors.node);
  plot = new RunPlot(node, shown);
  plotGestures(plot, gestures);
  const cycles = cyclesPanel(first, place("cycles-section"));
  place("run-cycles").replaceChildren(cycles.node);
  const incremental = incrementalPanel(shown);
  place("run-incremental").replaceChildren(incremental.node);
  const compare = comparePanel(shown, { draw, load: () => loadCompared(shown, wantedPart()), addRun, removeRun });
  place("run-compare").replaceChildren(compare.node);
  place("run-notes").replaceChildren(notesPanel(first, () => { document.title = `${first.name} · Bench service`; draw(); }));
  place("run-events").replaceChildren(events.node);
  parts = [facts, control, rows, zoom, cursors, events, cycles, incremental, compare];
  draw();
}

sidePage(state, { onEvent: (event) => { if (event.run_id === runId) refreshEvents(); }, onBench: news });
setInterval(news, NEWS_EVERY_MS);
start();
