// Which cell is on the selected bench: shown, and said anew by whoever puts another one there.
import { api } from "./api.js";
import { cellHref, cellName } from "./cell-fields.js";
import { el, setText } from "./dom.js";

/** `changed()` after another cell is there. */
export function cellChoice(state, changed) {
  const select = el("select", { id: "start-cell", name: "cell_id" });
  const about = el("span", { class: "about" });
  const message = el("p", { class: "form-message", role: "alert" });
  const view = { cells: [] };
  const there = () => state.bench?.cell?.id ?? "";
  const show = () => {
    const cell = state.bench?.cell;
    const others = view.cells.filter((each) => each.id !== cell?.id && (!each.bench || each.bench === state.bench?.name));
    select.replaceChildren(el("option", { value: "", text: "none that has a name" }), ...[cell, ...others].filter(Boolean).map((each) => el("option", { value: each.id, text: cellName(each) })));
    select.value = there();
    select.disabled = state.bench?.state !== "idle";
    about.replaceChildren(...(cell ? [el("a", { href: cellHref(cell.id), text: cell.id }), [cell.type, cell.owner].filter(Boolean).map((text) => `, ${text}`).join("")] : [el("a", { href: "/cells", text: "Cells" })]));
  };
  const list = async () => {
    view.cells = (await api.cells({ limit: 1000 }).catch(() => ({ cells: [] }))).cells;
    show();
  };
  select.addEventListener("change", async () => {
    setText(message, "");
    select.disabled = true;
    try {
      state.mergeBench(await api.putCell(state.bench.name, select.value || null));
      await list();
      changed();
    } catch (error) {
      setText(message, error.message);
      show();
    }
  });
  const node = el("div", { class: "field" }, el("label", { for: "start-cell", text: "Cell on the bench" }), select, about, message);
  let key = null;
  const seen = new Map();
  state.on("benches", (change) => {
    // Who else has put a cell there has changed the bench's limits, which the live feed does not carry.
    const bench = change && state.benches.get(change.name);
    if (bench && seen.has(bench.name) && seen.get(bench.name) !== (bench.cell?.id ?? null)) api.benches().then((all) => all.filter((each) => each.name === bench.name).forEach((each) => state.mergeBench(each)), () => {});
    if (bench) seen.set(bench.name, bench.cell?.id ?? null);
    const now = JSON.stringify([state.bench?.name, state.bench?.cell, state.bench?.state]);
    if (now !== key && document.activeElement !== select) { key = now; show(); }
  });
  return { node, list };
}
