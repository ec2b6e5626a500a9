// The list of runs, newest first: searched, filtered, each with its page and its data to take away.
import { cellHref } from "./cell-fields.js";
import { chip, el, renderKeyed } from "./dom.js";
import { MISSING, count, duration, startElement } from "./format.js";
import { currentFormats, exportLinks } from "./run-exports.js";
import { isUnverified, wordFor } from "./words.js";

const HEADS = ["Together", "Run", "Bench", "State", "Started", "Length", "Samples", "Missed ticks", "Data"];
const NUMBERS = [6, 7];
const STATES = ["running", "paused", "completed", "stopped", "fault", "interrupted"];
const TYPED_MS = 250;

/** `more` shows older runs, `look(filter)` others: {q, state, bench}. */
export function runsPanel(state, { more, look }) {
  const body = document.getElementById("runs-body");
  const tools = document.getElementById("runs-tools");
  const chosen = new Set();
  const together = el("button", { id: "runs-together", type: "button", text: "Open together", on: { click: () => {
    const [first, ...rest] = chosen;
    location.href = `/runs/${encodeURIComponent(first)}${rest.length ? `?with=${rest.map(encodeURIComponent).join(",")}` : ""}`;
  } } });
  const pick = (run, on) => {
    if (on) chosen.add(run.id);
    else chosen.delete(run.id);
    showChosen();
  };
  const showChosen = () => {
    together.disabled = chosen.size < 1;
    together.textContent = chosen.size > 1 ? `Open ${chosen.size} runs on one plot` : "Open together";
  };
  let formats = [];
  const filter = searchTools(state, tools, together, look);
  const render = () => {
    const runs = state.listedRuns ?? [];
    renderKeyed(body, JSON.stringify([runs, state.moreRuns, formats]), () => {
      if (!runs.length) return el("p", { class: "empty", text: filter.active() ? "No run is like that." : "No run yet. Start a test above, or a campaign; a program posts to /api/v1/runs." });
      return [table(runs, formats, chosen, pick), state.moreRuns ? el("button", { id: "runs-more", type: "button", text: "Show more runs", on: { click: more } }) : null];
    });
    showChosen();
  };
  state.on("runs", render);
  state.on("benches-listed", filter.benches);
  currentFormats().then((found) => { formats = found; render(); }, () => {}); // Without them the runs are shown all the same.
}

function searchTools(state, tools, together, look) {
  const words = el("input", { id: "runs-q", type: "search", autocomplete: "off", maxlength: 200, placeholder: "name, label, operator, cell, notes, date …" });
  const is = el("select", { id: "runs-state" }, el("option", { value: "", text: "any" }), STATES.map((each) => el("option", { value: each, text: wordFor("run", each)[1] })));
  const on = el("select", { id: "runs-bench" }, el("option", { value: "", text: "any" }));
  let timer = 0;
  const ask = () => look({ q: words.value.trim() || undefined, state: is.value || undefined, bench: on.value || undefined });
  words.addEventListener("input", () => { clearTimeout(timer); timer = setTimeout(ask, TYPED_MS); });
  for (const select of [is, on]) select.addEventListener("change", ask);
  const field = (title, control, kind = "") => el("div", { class: `field ${kind}` }, el("label", { for: control.id, text: title }), control);
  tools.replaceChildren(field("Search runs", words, "words"), field("State of the run", is), field("On bench", on), together);
  return {
    active: () => Boolean(words.value.trim() || is.value || on.value),
    benches: () => { on.replaceChildren(on.firstElementChild, ...[...state.benches.keys()].map((name) => el("option", { value: name, text: name, selected: name === on.value }))); },
  };
}

function table(runs, formats, chosen, pick) {
  return el("table", { class: "rows" },
    el("thead", {}, el("tr", {}, HEADS.map((head) => el("th", { scope: "col", text: head })))),
    el("tbody", {}, runs.map((run) => row(run, formats, chosen, pick))));
}

function length_s(run) {
  if (!run.started_utc || !run.ended_utc) return NaN;
  return (new Date(run.ended_utc) - new Date(run.started_utc)) / 1000;
}

function row(run, formats, chosen, pick) {
  const [tone, word] = wordFor("run", run.state);
  const test_s = Number.isFinite(run.n_samples * run.dt_s) && run.n_samples ? run.n_samples * run.dt_s : NaN;
  const name = run.name ?? `run ${String(run.id).slice(0, 8)}`;
  const box = el("input", { type: "checkbox", class: "pick", "aria-label": `Choose ${run.label ?? name}`, checked: chosen.has(run.id), on: { change: () => pick(run, box.checked) } });
  const cells = [
    box,
    el("span", { title: run.id }, el("a", { href: `/runs/${encodeURIComponent(run.id)}`, text: run.label ?? name }), run.label ? el("span", { class: "about block", text: name }) : null, run.operator ? el("span", { class: "about block", text: run.operator }) : null,
      run.cell_id ? el("span", { class: "about block" }, "cell ", el("a", { href: cellHref(run.cell_id), text: run.cell_id })) : null),
    run.bench,
    el("span", {}, chip(tone, word), run.reason ? el("span", { class: "about block", text: run.reason }) : null,
      isUnverified(run.commissioning) ? el("span", { class: "block" }, chip("warn", "unverified hardware")) : null,
      run.damage ? el("span", { class: "block" }, chip("bad", "damaged"), el("span", { class: "about block", text: run.damage })) : null),
    startElement(run),
    el("span", { title: Number.isFinite(length_s(run)) ? `took ${duration(length_s(run))}` : null, text: duration(test_s) }),
    count(run.n_samples), count(run.missed_ticks), exportLinks(run, formats),
  ];
  return el("tr", {}, cells.map((cell, index) => el("td", { data: { label: HEADS[index], kind: NUMBERS.includes(index) ? "number" : "" } }, cell)));
}
