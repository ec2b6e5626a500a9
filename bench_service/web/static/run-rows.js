// What is drawn in which row, on which axis, and over what.
import { el, renderKeyed } from "./dom.js";
import { signalOf } from "./run-signals.js";

const MOST_ROWS = 4;

export function rowsChooser(shown, offered, changed) {
  const node = el("div", { class: "rows-chooser" });
  const choose = (row, k, side) => {
    const keys = offered().map((signal) => signal.key);
    // What was chosen stays to be seen, though this run may have nothing of it.
    if (row[side] && !keys.includes(row[side]) && signalOf(row[side])) keys.push(row[side]);
    const name = `Plot ${k + 1}, ${side} axis`;
    const select = el("select", { id: `row-${k + 1}-${side}`, "aria-label": name, on: { change: () => {
      while (shown.rows.length <= k) shown.rows.push({ left: null, right: null });
      shown.rows[k][side] = select.value || null;
      changed();
    } } }, el("option", { value: "", text: "–", selected: !row[side] }), keys.map((key) => el("option", { value: key, text: signalOf(key).title, selected: key === row[side] })));
    return select;
  };
  const over = () => {
    const select = el("select", { id: "run-over", on: { change: () => { shown.over = select.value; changed(); } } },
      [["time", "test time"], ["charge", "charge"]].map(([value, text]) => el("option", { value, text, selected: value === shown.over })));
    return el("label", { class: "inline" }, "Over ", select);
  };
  const show = () => {
    const rows = Array.from({ length: MOST_ROWS }, (_, k) => shown.rows[k] ?? { left: null, right: null });
    renderKeyed(node, JSON.stringify([rows, shown.over, offered().map(({ key }) => key)]), () => [
      ...rows.map((row, k) => el("div", { class: "row-choice", role: "group", "aria-label": `Plot ${k + 1}` }, el("span", { class: "about", text: `Plot ${k + 1}: left, right` }), choose(row, k, "left"), choose(row, k, "right"))), over(),
    ]);
  };
  return { node, show };
}
