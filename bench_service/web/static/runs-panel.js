// The list of runs, newest first, each with its data to take away.
import { api } from "./api.js";
import { chip, el, renderKeyed } from "./dom.js";
import { MISSING, count, duration, timeElement } from "./format.js";
import { isUnverified, wordFor } from "./words.js";

const HEADS = ["Run", "Bench", "State", "Started", "Length", "Samples", "Missed ticks", "Data"];

export function runsPanel(state, { more }) {
  const body = document.getElementById("runs-body");
  let formats = [];
  const render = () => {
    const runs = state.runs ?? [];
    renderKeyed(body, JSON.stringify([runs, state.moreRuns, formats]), () => {
      if (!runs.length) return el("p", { class: "empty", text: "No run yet. A campaign makes the first two; a program posts to /api/v1/runs." });
      return [table(runs, formats), state.moreRuns ? el("button", { id: "runs-more", type: "button", text: "Show more runs", on: { click: more } }) : null];
    });
  };
  state.on("runs", render);
  api.formats().then((found) => { formats = found; render(); }, () => {}); // Without them the runs are shown all the same.
}

function table(runs, formats) {
  return el("table", { class: "rows" },
    el("thead", {}, el("tr", {}, HEADS.map((head) => el("th", { scope: "col", text: head })))),
    el("tbody", {}, runs.map((run) => row(run, formats))));
}

function length_s(run) {
  if (!run.started_utc || !run.ended_utc) return NaN;
  return (new Date(run.ended_utc) - new Date(run.started_utc)) / 1000;
}

function row(run, formats) {
  const [tone, word] = wordFor("run", run.state);
  const test_s = Number.isFinite(run.n_samples * run.dt_s) && run.n_samples ? run.n_samples * run.dt_s : NaN;
  const cells = [
    el("span", { title: run.id }, run.name ?? `run ${String(run.id).slice(0, 8)}`), run.bench,
    el("span", {}, chip(tone, word), run.reason ? el("span", { class: "about block", text: run.reason }) : null,
      isUnverified(run.commissioning) ? el("span", { class: "block" }, chip("warn", "unverified hardware")) : null,
      run.damage ? el("span", { class: "block" }, chip("bad", "damaged"), el("span", { class: "about block", text: run.damage })) : null),
    timeElement(run.started_utc ?? run.created_utc),
    el("span", { title: Number.isFinite(length_s(run)) ? `took ${duration(length_s(run))}` : null, text: duration(test_s) }),
    count(run.n_samples), count(run.missed_ticks), links(run, formats),
  ];
  return el("tr", {}, cells.map((cell, index) => el("td", { data: { label: HEADS[index], kind: [5, 6].includes(index) ? "number" : "" } }, cell)));
}

function links(run, formats) {
  if (!run.n_samples) return el("span", { text: MISSING });
  const name = run.damage ? `what is left of ${run.name ?? run.id}` : run.name ?? run.id;
  return el("span", { class: "links" }, formats.map((format) =>
    el("a", { href: api.exportUrl(run.id, format.name, run.damage), download: "", title: format.title, "aria-label": `${format.name.toUpperCase()} of ${name}` }, format.name.toUpperCase())));
}
