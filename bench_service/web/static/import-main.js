// A cycler's file comes in: dropped, looked at, its columns corrected, stored as a run. The address keeps it over a reload.
import { api } from "./api.js";
import { el } from "./dom.js";
import { importStore } from "./import-store.js";
import { importTable } from "./import-table.js";
import { busyBox, follow } from "./jobs.js";
import { sidePage } from "./side-page.js";
import { State } from "./state.js";

const byId = (name) => document.getElementById(name);
const view = { upload: null, seen: null, mappings: [] };
const table = importTable(byId("import-body"), () => lookAgain());
const store = importStore(byId("import-form"), { stored, began: (job) => remember({ job: job?.id }), choices: () => table.choices(), upload: () => view.upload, work });

/** What the address says besides: the upload, what was settled of it, and the job that stores it. */
function remember(news) {
  const said = new URLSearchParams(location.search);
  for (const [key, value] of Object.entries(news)) {
    if (value) said.set(key, value);
    else said.delete(key);
  }
  history.replaceState(null, "", `${location.pathname}${said.size ? `?${said}` : ""}`);
}

/** On to the run; who comes back finds the page as it was before the file. */
function stored(runId) {
  remember({ upload: null, choices: null, job: null });
  location.href = `/runs/${encodeURIComponent(runId)}`;
}

/** `place`: where the bar stands, and what went wrong. */
async function work(title, place, task) {
  const busy = busyBox(title);
  place.replaceChildren(busy.node);
  byId("import-message").textContent = "";
  try {
    return await task(busy.update);
  } catch (error) {
    if (place === byId("import-busy")) byId("import-message").textContent = error.message;
    else place.append(el("p", { class: "form-message", role: "alert", text: error.message }));
    return null;
  } finally {
    busy.end();
  }
}

async function take(file) {
  byId("import-seen").hidden = byId("import-store").hidden = true;
  const seen = await work(`Uploading ${file.name}`, byId("import-busy"), async (update) => {
    view.upload = await api.addImport(file.name);
    await api.putImport(view.upload.id, file);
    table.take();
    remember({ upload: view.upload.id, choices: null, job: null });
    view.mappings = await api.mappings().catch(() => []);
    return follow(await api.lookImport(view.upload.id, {}), update);
  });
  if (seen) show(seen);
}

/** What an address tells of: a file that is there already, and what was settled of it. */
async function goBack() {
  const said = new URLSearchParams(location.search);
  if (!said.has("upload")) return;
  const job = said.get("job");
  const done = job && await work("Storing the run", byId("import-busy"), (update) => follow({ id: job }, update));
  if (done) {
    stored(done.run);
    return;
  }
  const told = byId("import-message").textContent;
  const seen = await work("Reading the file", byId("import-busy"), async (update) => {
    [view.upload, view.mappings] = await Promise.all([api.importOf(said.get("upload")), api.mappings().catch(() => [])]);
    table.take(settled(said.get("choices")));
    return follow(await api.lookImport(view.upload.id, table.choices()), update);
  });
  remember({ job: null });
  if (!seen) return;
  byId("import-message").textContent = told;
  show(seen);
}

function settled(text) {
  try {
    return JSON.parse(text) ?? {};
  } catch {
    return {};
  }
}

async function lookAgain() {
  remember({ choices: JSON.stringify(table.choices()) });
  const seen = await work(`Reading ${view.upload.name}`, byId("import-busy"), async (update) => follow(await api.lookImport(view.upload.id, table.choices()), update));
  if (seen) show(seen);
}

function show(seen) {
  view.seen = seen;
  byId("import-seen").hidden = false;
  byId("import-store").hidden = seen.state !== "ok";
  table.show(seen, view.mappings);
  store.show(seen);
}

function dropZone() {
  const input = el("input", { id: "import-file", type: "file", on: { change: () => input.files[0] && take(input.files[0]) } });
  const zone = el("div", { class: "drop" }, el("strong", { text: "Drop a file here" }), el("span", { text: "as the cycler's program wrote it: CSV or text of any kind (gzipped too), Parquet, MATLAB .mat, Neware .ndax and .nda, MDF .mf4 and .mdf" }),
    el("label", { for: "import-file", text: "or choose one" }), input);
  const over = (on) => (event) => { event.preventDefault(); zone.dataset.over = String(on); };
  zone.addEventListener("dragover", over(true));
  zone.addEventListener("dragleave", over(false));
  zone.addEventListener("drop", (event) => { over(false)(event); if (event.dataTransfer.files[0]) take(event.dataTransfer.files[0]); });
  return zone;
}

byId("import-drop").replaceChildren(dropZone());

goBack();

sidePage(new State());
