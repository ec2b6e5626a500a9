// The page of all cells: found by words, and one more taken in.
import { api } from "./api.js";
import { cellCapacity, cellHref, cellName, entriesField, labelled, numberOf, textInput, typeFields, typeName } from "./cell-fields.js";
import { chip, el, setText } from "./dom.js";
import { MISSING, count, quantity } from "./format.js";
import { sidePage } from "./side-page.js";
import { State } from "./state.js";

const place = (id) => document.getElementById(id);
const HEADS = ["Cell", "Owner", "Type", "Capacity", "Where", "Runs", "Models", "Diagnoses"];
const TYPED_MS = 250;
const PAGE = 100;

const words = el("input", { id: "cells-q", type: "search", autocomplete: "off", maxlength: 200, placeholder: "id, label, owner, type, batch …" });
const retired = el("input", { id: "cells-retired", type: "checkbox", class: "pick" });
const view = { asked: 0, cells: [], more: null, timer: 0 };

const where = (cell) => (cell.retired_utc ? chip("neutral", "retired") : cell.bench ? el("a", { href: `/?bench=${encodeURIComponent(cell.bench)}`, text: cell.bench }) : MISSING);

function row(cell) {
  const cells = [el("a", { href: cellHref(cell.id), text: cellName(cell) }), cell.owner ?? MISSING, typeName(cell.type) ?? "unknown", quantity(cellCapacity(cell), 2, "Ah"),
    where(cell), count(cell.n_run), count(cell.n_model), count(cell.n_diagnosis)];
  return el("tr", {}, cells.map((each, k) => el("td", { data: { label: HEADS[k], kind: k > 4 ? "number" : "" } }, each)));
}

function show() {
  if (!view.cells.length) {
    place("cells-body").replaceChildren(el("p", { class: "empty", text: words.value.trim() ? "No cell is like that." : "No cell has a name yet. Take one in below: its runs, models and diagnoses then stay together." }));
    return;
  }
  const more = el("button", { type: "button", id: "cells-more", text: "Show more cells", on: { click: () => look(view.more) } });
  place("cells-body").replaceChildren(
    el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": "List of cells" }, el("table", { class: "rows named" },
      el("thead", {}, el("tr", {}, HEADS.map((head) => el("th", { scope: "col", text: head })))), el("tbody", {}, view.cells.map(row)))),
    view.more === null ? "" : more);
}

async function look(cursor) {
  view.asked += 1;
  const asked = view.asked;
  try {
    const page = await api.cells({ q: words.value.trim() || undefined, retired: retired.checked || undefined, limit: PAGE, cursor });
    if (asked !== view.asked) return; // something else was typed meanwhile
    view.cells = cursor === undefined ? page.cells : [...view.cells, ...page.cells];
    view.more = page.next_cursor;
    show();
  } catch (error) {
    place("cells-body").replaceChildren(el("p", { class: "form-message", text: error.message }));
  }
}

/** The types that cells have already, each with one of its cells. */
async function knownTypes() {
  const { cells } = await api.cells({ retired: true, limit: 1000 });
  const found = new Map();
  for (const cell of cells) {
    if (!cell.type) continue;
    const key = JSON.stringify(cell.type);
    if (!found.has(key)) found.set(key, cell);
  }
  return [...found.values()];
}

async function addForm() {
  const message = el("p", { class: "form-message", role: "alert" });
  const [id, label, owner] = [textInput("cell-id", "", { maxlength: 32, placeholder: "next free one" }), textInput("cell-label"), textInput("cell-owner")];
  const capacity = textInput("cell-capacity", "", { inputmode: "decimal" });
  const kind = el("select", { id: "cell-kind" }, el("option", { value: "new", text: "a new type" }), el("option", { value: "", text: "unknown: no limits of its own" }),
    (await knownTypes()).map((cell) => el("option", { value: `like:${cell.id}`, text: `${typeName(cell.type)} (as ${cell.id})` })));
  const type = typeFields();
  const { area, read } = entriesField("cell-metadata");
  const submit = el("button", { class: "primary", type: "submit", id: "cell-add", text: "Take it in" });
  const allow = () => { type.node.hidden = kind.value !== "new"; };
  kind.addEventListener("change", allow);
  if (kind.options.length > 2) kind.selectedIndex = 2;
  allow();
  const told = () => {
    const body = { id: id.value.trim() || undefined, label: label.value.trim() || undefined, owner: owner.value.trim() || undefined, metadata: read() };
    if (capacity.value.trim()) {
      body.capacity_Ah = numberOf(capacity);
      if (!(body.capacity_Ah > 0)) throw Object.assign(new Error("Measured capacity: a number above 0 is needed."), { input: capacity });
    }
    if (kind.value === "new") body.type = type.read();
    else if (kind.value) body.like = kind.value.slice("like:".length);
    return body;
  };
  const form = el("form", { class: "notes-form", novalidate: true, "aria-label": "Take a cell in" },
    el("div", { class: "fields" }, labelled("Id", id, "short enough to be typed"), labelled("Label", label), labelled("Owner", owner), labelled("Type", kind), labelled("Measured capacity / Ah", capacity, "else that of its type")),
    type.node, el("div", { class: "field field-wide" }, el("label", { for: area.id, text: "Whatever else is kept with it, a line each: name = value" }), area), el("div", { class: "form-end" }, submit, message));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    setText(message, "");
    submit.disabled = true;
    try {
      location.href = cellHref((await api.addCell(told())).id);
    } catch (error) {
      setText(message, error.message);
      error.input?.focus();
      submit.disabled = false;
    }
  });
  place("cells-add").replaceChildren(form);
}

words.addEventListener("input", () => { clearTimeout(view.timer); view.timer = setTimeout(look, TYPED_MS); });
retired.addEventListener("change", () => look());
place("cells-tools").replaceChildren(el("div", { class: "field words" }, el("label", { for: "cells-q", text: "Search cells" }), words), el("label", { class: "inline" }, retired, "retired ones too"));
const state = new State();
sidePage(state, { onEvent: (event) => { if (event.code.startsWith("cell_")) look(); } });
look();
addForm().catch((error) => place("cells-add").replaceChildren(el("p", { class: "form-message", text: error.message })));
