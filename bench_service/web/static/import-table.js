// What a file's columns are taken for, and why: shown beside a plot and the first rows, corrected by a person.
import { el } from "./dom.js";
import { previewChart } from "./run-preview.js";

const TITLES = {
  time_s: "Test time", clock: "Date and time", voltage_V: "Voltage", current_A: "Current", charge_current_A: "Charge current",
  discharge_current_A: "Discharge current", temperature_degC: "Cell temperature", ambient_degC: "Ambient temperature",
  cycle_count: "Cycle", step_count: "Step", state: "Charge or discharge (state)", cell: "Which cell", soc_ref: "Reference state of charge",
};
const SIGNS = [["", "as the voltage tells"], ["charge-positive", "positive charges"], ["discharge-positive", "positive discharges"]];
const DATES = [["", "as the dates tell"], ["day-first", "day first"], ["month-first", "month first"]];
const SHOWN_ROWS = 8;

/** `changed()` after each correction. */
export function importTable(node, changed) {
  let [chosen, others, seen, remembered] = [{}, {}, null, []];
  const settle = (key, value) => { if (value) others[key] = value; else delete others[key]; changed(); };
  const options = (pairs, now) => pairs.map(([value, text]) => el("option", { value, text, selected: value === now }));

  const row = ([role, units]) => {
    const column = seen.mapping?.columns[role];
    const pick = el("select", { id: `column-${role}`, "aria-label": `Column of ${TITLES[role]}`, on: { change: () => { chosen[role] = { column: pick.value, unit: null }; changed(); } } },
      options([["", "none"], ...seen.columns.map((name) => [name, name])], column?.column ?? ""));
    const unit = units.length && column ? el("select", { id: `unit-${role}`, "aria-label": `Unit of ${TITLES[role]}`, on: { change: () => { chosen[role] = { column: column.column, unit: unit.value }; changed(); } } },
      options(units.map((name) => [name, name]), column.unit)) : null;
    return el("tr", { data: { asked: String(seen.asks === role) } }, el("th", { scope: "row", text: TITLES[role] ?? role }), el("td", {}, pick), el("td", {}, unit), el("td", { class: "why", text: column?.why ?? "" }));
  };
  const choice = (key, title, pairs) => {
    const pick = el("select", { id: `import-${key}`, on: { change: () => settle(key, pick.value) } }, options(pairs, others[key] ?? ""));
    return labelled(title, pick);
  };
  const typed = (key, title, placeholder) => {
    const input = el("input", { id: `import-${key}`, autocomplete: "off", placeholder, value: others[key] ?? "", on: { change: () => settle(key, input.value.trim()) } });
    return labelled(title, input);
  };
  /** A mapping takes the place of what was corrected by hand. */
  const known = () => {
    const pick = el("select", { id: "import-known", on: { change: () => { chosen = {}; settle("mapping", pick.value); } } },
      options([["", "guessed"], ...remembered.map(({ name }) => [name, name])], others.mapping ?? ""));
    return labelled("Columns as remembered", pick);
  };
  const columns = () => el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": "Columns" }, el("table", {},
    el("thead", {}, el("tr", {}, ["Is read as", "Column", "Unit", "Why"].map((text) => el("th", { scope: "col", text })))),
    el("tbody", {}, Object.entries(seen.roles).map(row))));
  const firstRows = () => el("div", { class: "table-scroll", tabindex: "0", role: "region", "aria-label": "First rows" }, el("table", {},
    el("caption", { text: "First rows of the file" }),
    el("thead", {}, el("tr", {}, seen.columns.map((text) => el("th", { scope: "col", text })))),
    el("tbody", {}, seen.first_rows.slice(0, SHOWN_ROWS).map((cells) => el("tr", {}, cells.map((text) => el("td", { text })))))));

  const draw = () => {
    const focused = document.activeElement?.id;
    const plot = el("div", { class: "import-plot", role: "img", "aria-label": "Current and voltage over time" });
    const leave = el("input", { id: "import-leave_out", type: "checkbox", class: "pick", checked: Boolean(others.leave_out), on: { change: () => settle("leave_out", leave.checked) } });
    node.replaceChildren(...[
      seen.question ? el("p", { class: "question", role: "alert", text: plain(seen.question) }) : null,
      el("p", { text: `${seen.file}: ${seen.mapping?.title ?? "its columns are not known"}${seen.samples ? `, ${seen.samples} samples` : ""}` }),
      el("div", { class: "import-columns" }, columns(), el("div", {}, plot, el("ul", { class: "remarks" }, (seen.remarks ?? []).map((text) => el("li", { text: plain(text) }))))),
      el("div", { class: "fields" }, remembered.length ? known() : null, choice("current_sign", "Sign of the current", SIGNS), choice("date_order", "Dates", DATES),
        typed("time_zone", "Time zone of its clock", "Europe/Oslo"), typed("cell", "Which cell, of several", ""), labelled("Leave out rows out of time order", leave)),
      firstRows(),
    ].filter(Boolean));
    previewChart(plot)(seen.plot ? { time_s: seen.plot.time_s.map((t) => t - seen.plot.time_s[0]), current_A: seen.plot.current_A, voltage_V: seen.plot.voltage_V } : null);
    if (focused) document.getElementById(focused)?.focus();
  };
  return {
    show: (found, mappings) => { [seen, remembered] = [found, mappings]; draw(); },
    choices: () => ({ ...others, columns: chosen }),
    /** Choices as `choices()` gave them once, in place of those that are there. */
    take: ({ columns = {}, ...rest } = {}) => { [chosen, others] = [columns, rest]; },
  };
}

function labelled(title, input) {
  return el("div", { class: "field" }, el("label", { for: input.id, text: title }), input);
}

/** A question in the words of the table, without what a person types on a command line: the fields are below it. */
function plain(text) {
  const named = text.replace(/\b[A-Za-z]+(_[A-Za-z]+)+\b/g, (role) => TITLES[role]?.toLowerCase() ?? role);
  const at = named.indexOf(" --");
  if (at < 0) return named;
  const end = Math.max(...[";", "?", ":", ","].map((mark) => named.lastIndexOf(mark, at)));
  return end > 0 ? `${named.slice(0, end)}${named[end] === "?" ? "?" : "."} Settle it below.` : named;
}
