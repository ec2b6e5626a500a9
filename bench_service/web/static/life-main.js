// The page of a cell's life: which runs are followed with which model, and what has become of the cell.
import { api } from "./api.js";
import { cellName } from "./cell-fields.js";
import { el, setText } from "./dom.js";
import { percent } from "./format.js";
import { busyBox, follow } from "./jobs.js";
import { drawLife } from "./life-charts.js";
import { reportLinks } from "./report-links.js";
import { sidePage } from "./side-page.js";
import { State } from "./state.js";

const place = (id) => document.getElementById(id);

const nameOf = (run) => run.label ?? run.name ?? `run ${run.id.slice(0, 8)}`;

/** The cycle that a run's name tells, "" where it tells none; what has a unit, as in `cycle_25degC`, is no number of a cycle. */
const cycleIn = (name) => name.match(/cyc(?:le)?[\s_#-]*0*(\d+)(?![\d.]*[a-z%])/i)?.[1] ?? "";

/** The oldest first: by the cycles that all names tell, whenever they were imported; else by when they were stored. */
function inOrder(runs) {
  const stored = [...runs].reverse().map((run) => ({ run, cycle: cycleIn(nameOf(run)) }));
  const known = stored.every(({ cycle }) => cycle !== "");
  if (known) stored.sort((a, b) => Number(a.cycle) - Number(b.cycle));
  return { runs: stored.map(({ run }) => run), told: stored.map(({ cycle }) => (known ? cycle : "")) };
}

/** Where the chosen runs lie along the life: `{ at, unit }`, `{}` where they are counted, or `{ wrong }` in words. */
function along(chosen) {
  const told = chosen.filter(({ cycle }) => cycle !== "");
  if (!told.length) return {};
  if (told.length < chosen.length) return { wrong: `${chosen.find(({ cycle }) => cycle === "").name} has no cycle: give one to every chosen run, or to none.` };
  const back = chosen.find(({ cycle }, k) => k > 0 && Number(cycle) < Number(chosen[k - 1].cycle));
  if (back) return { wrong: `${back.name} has cycle ${back.cycle}, below that of the run before it: cycles never fall, the oldest run is the first.` };
  return { at: chosen.map(({ cycle }) => Number(cycle)), unit: "cycle" };
}

async function choose() {
  // `?cell=C7`: its runs alone; its own models come first.
  const cellId = new URLSearchParams(location.search).get("cell") ?? undefined;
  const cell = cellId && (await api.cell(cellId));
  if (cell) setText(place("life-choose-title"), `Follow ${cellName(cell)}`);
  const [all, found] = await Promise.all([api.models(), api.runs({ limit: 1000, cell_id: cell?.id })]);
  const models = cell ? [...all.filter((each) => each.cell_id === cell.id), ...all.filter((each) => each.cell_id !== cell.id)] : all;
  const { runs, told } = inOrder(found.filter((run) => run.state === "completed"));
  if (!models.length || !runs.length) return place("life-choose").replaceChildren(el("p", { class: "empty", text: "A model of the cell as it was is needed, and runs that have ended." }));
  const message = el("p", { class: "form-message", role: "alert" });
  const model = el("select", { id: "life-model" }, models.map((each) => el("option", { value: each.id, text: each.name })));
  const end = el("input", { id: "life-end", type: "number", min: 1, max: 99, step: 1, value: 80, required: true });
  const boxes = runs.map((run) => el("input", { type: "checkbox", value: run.id, checked: true, "aria-label": `Follow ${nameOf(run)}` }));
  const cycles = runs.map((run, k) => el("input", { type: "number", min: 0, step: "any", value: told[k], class: "life-cycle", "aria-label": `Cycle of ${nameOf(run)}` }));
  const start = el("button", { class: "primary", type: "submit", text: "Follow the cell" });
  const form = el("form", { class: "life-form", "aria-label": "Choose model and runs" },
    el("div", { class: "life-fields" },
      el("label", { class: "field", for: "life-model" }, el("span", { text: "Model of the cell as it was" }), model),
      el("label", { class: "field", for: "life-end" }, el("span", { text: "End of life / %" }), end)),
    el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": "Runs, the oldest first" }, el("table", {},
      el("thead", {}, el("tr", {}, ["Follow", "Run, the oldest first", "Cycle", "SoC at the start"].map((text) => el("th", { scope: "col", text })))),
      el("tbody", {}, runs.map((run, k) => el("tr", {}, el("td", {}, boxes[k]), el("td", { text: nameOf(run) }), el("td", {}, cycles[k]), el("td", { text: percent(run.initial_soc, 0) })))))),
    el("div", { class: "form-end" }, start, message));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const chosen = runs.map((run, k) => ({ id: run.id, name: nameOf(run), cycle: cycles[k].value, kept: boxes[k].checked })).filter(({ kept }) => kept);
    const { wrong = chosen.length ? "" : "Choose at least one run.", ...places } = along(chosen);
    setText(message, wrong);
    if (wrong) return;
    start.disabled = true;
    const busy = busyBox("Following the cell");
    form.append(busy.node);
    try {
      const job = await api.trend({ model_id: model.value, run_ids: chosen.map(({ id }) => id), ...places, end: Number(end.value) / 100 });
      show(await follow(job, busy.update), job.id, new Map(runs.map((run) => [run.id, nameOf(run)])));
    } catch (error) {
      setText(message, error.message);
    } finally {
      busy.end();
      start.disabled = false;
    }
  });
  return place("life-choose").replaceChildren(form);
}

function show(life, jobId, names) {
  place("life-section").hidden = false;
  place("life-tools").replaceChildren(el("a", { href: api.trendUrl(jobId), download: "life.csv", text: "Export as CSV" }), reportLinks("trends", jobId, "the life"));
  drawLife(place("life-body"), life, (id) => names.get(id) ?? id);
  document.body.dataset.drawn = "1";
}

sidePage(new State());
choose().catch((error) => place("life-choose").replaceChildren(el("p", { class: "form-message", text: error.message })));
