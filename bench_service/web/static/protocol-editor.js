// Steps of a protocol as a table: typed, added, moved, duplicated; what the service objects to stands at the step.
import { el, setText } from "./dom.js";
import { endFields, fieldsOf, levelFields, moreFields } from "./protocol-fields.js";
import { KINDS, editable, flat, freshStep, holdsSteps, move, placeOf, shown, typed, written } from "./protocol-model.js";

const DRAFT = "bench-protocol-draft";
const MOST_UNDONE = 50;

/** `changed()` after each change of the document; `bench()` gives the one that it is for. */
export function protocolEditor(bench, changed) {
  const view = { document: null, ids: new WeakMap(), next: 1, unfolded: new WeakSet(), undo: [], last: "" };
  const body = el("tbody");
  const told = el("p", { class: "hint", role: "status" });
  const name = el("input", { id: "protocol-name", maxlength: 200, autocomplete: "off", data: { path: "name" } });
  const record = el("input", { id: "protocol-record", inputmode: "decimal", autocomplete: "off", placeholder: "every sample", data: { path: "record.time_s" } });
  const kind = el("select", { id: "protocol-add-kind", "aria-label": "Kind of the step to add" }, [...KINDS].filter(([key]) => key !== "design").map(([key, title]) => el("option", { value: key, text: title })));
  const undo = el("button", { type: "button", id: "protocol-undo", text: "Undo", disabled: true });
  const table = el("div", { class: "table-scroll editor-scroll", tabindex: "0", role: "region", "aria-label": "Steps of the protocol" },
    el("table", { class: "editor" }, el("thead", {}, el("tr", {}, ["Step", "Level", "Ends by the first of", "Change"].map((text) => el("th", { scope: "col", text })))), body));
  const add = el("button", { type: "button", id: "protocol-add", text: "Add step" });
  const node = el("section", { class: "protocol-editor", "aria-label": "Protocol editor", hidden: true },
    el("div", { class: "fields" }, labelled("Name of the protocol", name), labelled("Sample each / s", record)), table,
    el("div", { class: "form-end" }, kind, add, undo, told));

  const keep = () => { view.last = JSON.stringify(view.document); try { sessionStorage.setItem(DRAFT, view.last); } catch { /* a full or forbidden store: the draft lives as long as the page */ } };
  const remember = () => { view.undo = [...view.undo, view.last].slice(-MOST_UNDONE); undo.disabled = false; };
  const typedNow = () => { keep(); changed(); };
  const idOf = (step) => { if (!view.ids.has(step)) view.ids.set(step, `step-${view.next++}`); return view.ids.get(step); };
  const rebuilt = (focus = document.activeElement?.id) => { remember(); draw(); keep(); changed(); if (focus) document.getElementById(focus)?.focus(); };

  const act = (step, number, what) => () => {
    const { list, at } = placeOf(view.document.steps, step);
    let focus = `${idOf(step)}-${what}`;
    if (what === "up" || what === "down") {
      if (!move(view.document.steps, step, what === "up" ? -1 : 1)) return;
    } else if (what === "delete") {
      list.splice(at, 1);
      const next = list[at] ?? list[at - 1];
      focus = next ? `${idOf(next)}-kind` : "protocol-add";
    } else {
      const made = what === "copy" ? structuredClone(step) : freshStep("rest", bench());
      if (what === "add" && holdsSteps(step)) step.steps.push(made);
      else list.splice(at + 1, 0, made);
      focus = `${idOf(made)}-kind`;
    }
    rebuilt(focus);
    const now = flat(view.document.steps).find((each) => each.step === step);
    setText(told, what === "delete" ? `Step ${number} deleted.` : what === "copy" ? `Step ${number} duplicated.` : now && now.number !== number ? `Step ${number} is now step ${now.number}.` : "");
  };
  const line = ({ step, path, number, depth }) => {
    const id = idOf(step);
    const row = { id, number, capacity_Ah: view.document.capacity_Ah ?? bench()?.capacity_Ah ?? 1, typed: typedNow, rebuilt, unfolded: () => view.unfolded.has(step), fold: (open) => view.unfolded[open ? "add" : "delete"](step) };
    const { choice, text } = fieldsOf(step, row);
    const kinds = [...KINDS].filter(([key]) => (holdsSteps(step) ? holdsSteps({ step: key }) : key !== "design" || step.step === "design"));
    const button = (what, sign, words) => el("button", { type: "button", class: "small", id: `${id}-${what}`, text: sign, title: words, "aria-label": `${words}, step ${number}`, on: { click: act(step, number, what) } });
    const keys = (event) => { if (event.altKey && ["ArrowUp", "ArrowDown"].includes(event.key)) { event.preventDefault(); act(step, number, event.key === "ArrowUp" ? "up" : "down")(); } };
    return el("tr", { data: { step: path.join("."), depth }, on: { keydown: keys } },
      el("td", { class: "step-what" }, el("div", { class: "step-head" }, el("span", { class: "row-number", text: number }), choice("kind", "kind", kinds, step.step, (to) => become(step, to))), step.step === "mark" ? null : text("name", "Name"), el("p", { class: "field-error", id: `${id}-error` })),
      el("td", {}, el("div", { class: "step-fields" }, levelFields(step, row))),
      el("td", {}, el("div", { class: "step-ends" }, endFields(step, row)), moreFields(step, row)),
      el("td", {}, el("div", { class: "step-buttons" }, button("up", "↑", "Move up"), button("down", "↓", "Move down"), button("add", "+", holdsSteps(step) ? "Add a step inside" : "Add a step below"), button("copy", "Copy", "Duplicate"), button("delete", "×", "Delete"))));
  };
  const become = (step, to) => {
    const { step: _, name: called, label, limits, record: rate, steps } = step;
    const around = holdsSteps({ step: to }) && !steps ? [structuredClone(step)] : steps;
    const fresh = { ...freshStep(to, bench()), ...(steps ? { until: step.until, count: to === "loop" ? step.count ?? 2 : undefined } : {}) };
    for (const key of Object.keys(step)) delete step[key];
    // A step that becomes a loop is what the loop plays.
    Object.assign(step, fresh, around && holdsSteps(fresh) ? { steps: around, name: steps ? called : undefined } : { name: called, label: label ?? fresh.label, limits, record: rate });
  };
  const draw = () => body.replaceChildren(...flat(view.document.steps).map(line));
  const take = (document) => {
    view.document = document;
    [name.value, record.value] = [document.name ?? "", shown(document.record?.time_s)];
    draw();
    keep();
  };
  const begin = (document) => {
    take(document);
    view.undo = [];
    undo.disabled = true;
  };
  add.addEventListener("click", () => { const made = freshStep(kind.value, bench()); if (holdsSteps(made)) made.steps.push(freshStep("rest", bench())); view.document.steps.push(made); rebuilt(`${idOf(made)}-kind`); });
  undo.addEventListener("click", () => { const before = view.undo.pop(); undo.disabled = !view.undo.length; take(JSON.parse(before)); changed(); });
  name.addEventListener("input", () => { view.document.name = name.value.trim() || undefined; typedNow(); });
  record.addEventListener("input", () => { view.document.record = { ...view.document.record, time_s: typed(record.value) }; typedNow(); });
  // What is typed here is no matter of the form around it, which would look a second time.
  node.addEventListener("input", (event) => event.stopPropagation());
  // Enter in a field would start the run.
  node.addEventListener("keydown", (event) => { if (event.key === "Enter" && event.target.tagName === "INPUT") event.preventDefault(); });

  return {
    node, open: (document) => begin(editable(document)),
    focus: () => (body.querySelector("select") ?? add).focus(),
    begin: () => begin({ schema: "bench-protocol-1", name: "New protocol", record: { time_s: 1 }, steps: [freshStep("cc_cv", bench())] }),
    document: () => (view.document ? written(view.document) : null),
    /** What was being written before the page was left, if anything was. */
    draft: () => {
      try {
        const kept = JSON.parse(sessionStorage.getItem(DRAFT));
        if (kept?.steps) take(kept);
      } catch { /* none that can be read */ }
      return view.document;
    },
    /** Show what the service objects to at its step; false where it is of no step. */
    object: (where, message) => object(node, where, message),
  };
}

function labelled(title, control) {
  return el("div", { class: "field" }, el("label", { for: control.id, text: title }), control);
}

function object(node, where, message) {
  for (const each of node.querySelectorAll("[aria-invalid]")) { each.removeAttribute("aria-invalid"); each.removeAttribute("aria-describedby"); }
  for (const each of node.querySelectorAll(".field-error")) each.textContent = "";
  const parts = where.map(String);
  // The deepest step that the path leads through.
  let depth = 0;
  while (parts[depth] === "steps" && /^\d+$/.test(parts[depth + 1] ?? "")) depth += 2;
  const row = depth ? node.querySelector(`tr[data-step="${CSS.escape(parts.slice(0, depth).join("."))}"]`) : null;
  const path = parts.slice(depth).join(".").replace(/\.\d+/g, "");
  const control = [...(row ?? node).querySelectorAll("[data-path]")].find((each) => each.dataset.path === path);
  control?.setAttribute("aria-invalid", "true");
  if (!row) return false;
  const place = row.querySelector(".field-error");
  control?.setAttribute("aria-describedby", place.id);
  place.textContent = message.replace(` at ${parts.join(".")}`, "");
  return true;
}
