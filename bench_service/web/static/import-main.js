// A cycler's file comes in: dropped, looked at, its columns corrected, stored as a run.
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
const store = importStore(byId("import-form"), { stored: (runId) => { location.href = `/runs/${encodeURIComponent(runId)}`; }, choices: () => table.choices(), upload: () => view.upload, work });

async function work(title, task) {
  const busy = busyBox(title);
  byId("import-busy").replaceChildren(busy.node);
  byId("import-message").textContent = "";
  try {
    return await task(busy.update);
  } catch (error) {
    byId("import-message").textContent = error.message;
    return null;
  } finally {
    busy.end();
  }
}

async function take(file) {
  byId("import-seen").hidden = byId("import-store").hidden = true;
  const seen = await work(`Uploading ${file.name}`, async (update) => {
    view.upload = await api.addImport(file.name);
    await api.putImport(view.upload.id, file);
    table.forget();
    view.mappings = await api.mappings().catch(() => []);
    return follow(await api.lookImport(view.upload.id, {}), update);
  });
  if (seen) show(seen);
}

async function lookAgain() {
  const seen = await work(`Reading ${view.upload.name}`, async (update) => follow(await api.lookImport(view.upload.id, table.choices()), update));
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
  const zone = el("div", { class: "drop" }, el("strong", { text: "Drop a file here" }), el("span", { text: "as the cycler's program wrote it: CSV or text of any kind, Neware .ndax, Parquet" }),
    el("label", { for: "import-file", text: "or choose one" }), input);
  const over = (on) => (event) => { event.preventDefault(); zone.dataset.over = String(on); };
  zone.addEventListener("dragover", over(true));
  zone.addEventListener("dragleave", over(false));
  zone.addEventListener("drop", (event) => { over(false)(event); if (event.dataTransfer.files[0]) take(event.dataTransfer.files[0]); });
  return zone;
}

byId("import-drop").replaceChildren(dropZone());

sidePage(new State());
