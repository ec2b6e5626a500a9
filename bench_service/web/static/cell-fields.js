// What is written of a cell: words, its type, whatever else its owner keeps with it.
import { el } from "./dom.js";

/** "A17", "LG M50", or both where a cell has a label. */
export const cellName = (cell) => (cell.label ? `${cell.id} · ${cell.label}` : cell.id);
export const typeName = (type) => (type ? `${type.maker} ${type.model}` : null);
export const cellCapacity = (cell) => cell.capacity_Ah ?? cell.type?.capacity_Ah ?? NaN;
export const cellHref = (id) => `/cells/${encodeURIComponent(id)}`;

export function labelled(title, control, hint = null) {
  return el("div", { class: "field" }, el("label", { for: control.id, text: title }), control, hint ? el("span", { class: "about", text: hint }) : null);
}

export const textInput = (id, value = "", more = {}) => el("input", { id, value: value ?? "", autocomplete: "off", maxlength: 200, ...more });
const numberInput = (id, more = {}) => el("input", { id, inputmode: "decimal", autocomplete: "off", ...more });
/** NaN where it is none; a decimal comma is one too. */
export const numberOf = (input) => (input.value.trim() ? Number(input.value.trim().replace(",", ".")) : NaN);

/** Lines such as `batch = 7b`; numbers and true or false are kept as such. */
export function entriesField(id, metadata = {}) {
  const area = el("textarea", { id, rows: 3, spellcheck: "false" }, Object.entries(metadata).map(([name, value]) => `${name} = ${value}`).join("\n"));
  const read = () => {
    const found = {};
    for (const line of area.value.split("\n").filter((each) => each.trim())) {
      const [name, value] = [line.slice(0, line.indexOf("=")).trim(), line.slice(line.indexOf("=") + 1).trim()];
      if (!line.includes("=") || !name || !value) throw new Error(`“${line.trim()}” does not read name = value.`);
      const number = Number(value);
      found[name] = value === "true" || value === "false" ? value === "true" : value !== "" && Number.isFinite(number) ? number : value;
    }
    return found;
  };
  return { area, read };
}

const TEXTS = [["maker", "Maker"], ["model", "Model"], ["chemistry", "Chemistry"], ["source", "Source of the figures"]];
const NUMBERS = [["capacity_Ah", "Nominal capacity / Ah"], ["charge_A", "Largest charging current / A"], ["discharge_A", "Largest discharging current / A"]];
const WINDOWS = [["voltage_V", "voltage / V"], ["temperature_degC", "temperature / °C"]];

/** Fields of a type that nobody has entered yet. */
export function typeFields() {
  const texts = TEXTS.map(([key, title]) => [key, title, textInput(`type-${key}`, "", { required: true })]);
  const numbers = NUMBERS.map(([key, title]) => [key, title, numberInput(`type-${key}`, { required: true })]);
  const windows = WINDOWS.map(([key, title]) => [key, title, numberInput(`type-${key}-low`, { required: true }), numberInput(`type-${key}-high`, { required: true })]);
  const node = el("div", { class: "fields", id: "type-fields" },
    [...texts.slice(0, 3), ...numbers].map(([, title, input]) => labelled(title, input)),
    windows.flatMap(([, title, low, high]) => [labelled(`Lowest ${title}`, low), labelled(`Highest ${title}`, high)]),
    labelled(texts[3][1], texts[3][2], "data sheet, revision, page"));
  const read = () => {
    const type = {};
    for (const [key, title, input] of texts) {
      if (!input.value.trim()) throw Object.assign(new Error(`${title}: say it, or choose another type.`), { input });
      type[key] = input.value.trim();
    }
    const number = (title, input) => {
      const value = numberOf(input);
      if (!Number.isFinite(value)) throw Object.assign(new Error(`${title}: a number is needed.`), { input });
      return value;
    };
    for (const [key, title, input] of numbers) type[key] = number(title, input);
    for (const [key, title, low, high] of windows) type[key] = [number(`Lowest ${title}`, low), number(`Highest ${title}`, high)];
    return type;
  };
  return { node, read };
}
