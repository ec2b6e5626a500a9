// The list of runs, newest first, each with its data to take away.
import { api } from "./api.js";
import { chip, el, renderKeyed } from "./dom.js";
import { MISSING, count, duration, timeElement } from "./format.js";
import { wordFor } from "./words.js";

const HEADS = ["Run", "Bench", "State", "Started", "Length", "Samples", "Missed ticks", "Data"];

export function runsPanel(state, { more }) {
  const body = document.getElementById("runs-body");
  state.on("runs", () => {
    const runs = state.runs ?? [];
    renderKeyed(body, JSON.stringify([runs, state.moreRuns]), () => {
      if (!runs.length) return el("p", { class: "empty", text: "No run yet. A campaign makes the first two; a program posts to /api/v1/runs." });
      return [table(runs), state.moreRuns ? el("button", { id: "runs-more", type: "button", text: "Show more runs", on: { click: more } }) : null];
    });
  });
}

function table(runs) {
  return el("table", { class: "rows" },
    el("thead", {}, el("tr", {}, HEADS.map((head) => el("th", { scope: "col", text: head })))),
    el("tbody", {}, runs.map(row)));
}

function length_s(run) {
  if (!run.started_utc || !run.ended_utc) return NaN;
  return (new Date(run.ended_utc) - new Date(run.started_utc)) / 1000;
}

function row(run) {
  const [tone, word] = wordFor("run", run.state);
  const test_s = Number.isFinite(run.n_samples * run.dt_s) && run.n_samples ? run.n_samples * run.dt_s : NaN;
  const cells = [
    el("span", { title: run.id }, run.name ?? `run ${String(run.id).slice(0, 8)}`), run.bench,
    el("span", {}, chip(tone, word), run.reason ? el("span", { class: "about block", text: run.reason }) : null),
    timeElement(run.started_utc ?? run.created_utc),
    el("span", { title: Number.isFinite(length_s(run)) ? `took ${duration(length_s(run))}` : null, text: duration(test_s) }),
    count(run.n_samples), count(run.missed_ticks), links(run),
  ];
  return el("tr", {}, cells.map((cell, index) => el("td", { data: { label: HEADS[index], kind: [5, 6].includes(index) ? "number" : "" } }, cell)));
}

function links(run) {
  if (!run.n_samples) return el("span", { text: MISSING });
  const name = run.name ?? run.id;
  return el("span", { class: "links" }, [["csv", "CSV"], ["bdf", "BDF"]].map(([format, text]) =>
    el("a", { href: api.exportUrl(run.id, format), download: "", "aria-label": `${text} of ${name}` }, text)));
}
