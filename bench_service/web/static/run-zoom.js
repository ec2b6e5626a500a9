// Zoom and cursors of a run's plot: by mouse, by finger, and by fields and buttons for who uses neither.
import { el } from "./dom.js";

const WHEEL = 1.3;
const DRAGGED_PX = 6;
const SHORTEST_S = 0.05;

/** `change(view)` with {from, to}, both null for the whole run; `cursor(which, at)`. */
export function plotGestures(plot, { view, whole, change, cursor, over }) {
  const { node } = plot;
  const box = el("div", { class: "zoom-box", hidden: true });
  node.parentElement.append(box);
  let drag = null;
  const place = (event) => { const { left, top } = node.getBoundingClientRect(); return [event.clientX - left, event.clientY - top]; };
  const active = () => over() === "time";

  node.addEventListener("wheel", (event) => {
    const [x, y] = place(event);
    if (!active() || !plot.inside(x, y) || !event.deltaY) return;
    const wider = event.deltaY > 0;
    if (wider && isWhole(view(), whole())) return; // nothing left to show: the wheel scrolls the page again
    event.preventDefault();
    if (event.shiftKey) change(moved(view(), whole(), wider ? 0.1 : -0.1));
    else change(zoomed(view(), whole(), wider ? WHEEL : 1 / WHEEL, plot.at(x)));
  }, { passive: false });

  node.addEventListener("pointerdown", (event) => {
    const [x, y] = place(event);
    if (event.button !== 0 || !plot.inside(x, y)) return;
    drag = { x, at: plot.at(x), view: view(), moves: event.shiftKey || event.pointerType === "touch" };
    node.setPointerCapture(event.pointerId);
  });
  node.addEventListener("pointermove", (event) => {
    if (!drag || !active()) return;
    const [x] = place(event);
    drag.far = drag.far || Math.abs(x - drag.x) > DRAGGED_PX;
    if (!drag.far) return;
    if (drag.moves) return change(moved(drag.view, whole(), (drag.x - x) / node.clientWidth));
    box.hidden = false;
    box.style.left = `${node.offsetLeft + Math.min(x, drag.x)}px`;
    box.style.width = `${Math.abs(x - drag.x)}px`;
    box.style.top = `${node.offsetTop}px`;
    box.style.height = `${node.clientHeight}px`;
  });
  const done = (event) => {
    const was = drag;
    drag = null;
    box.hidden = true;
    if (!was || event.type === "pointercancel" || !active()) return;
    const at = plot.at(place(event)[0]);
    if (!was.far) cursor(event.shiftKey ? "b" : "a", at);
    else if (!was.moves) change(clipped({ from: Math.min(at, was.at), to: Math.max(at, was.at) }, whole()));
  };
  node.addEventListener("pointerup", done);
  node.addEventListener("pointercancel", done);
  node.addEventListener("dblclick", () => change({ from: null, to: null }));
}

export function zoomButtons({ view, whole, change }) {
  const button = (text, label, act) => el("button", { type: "button", class: "small", text, "aria-label": label, title: label, on: { click: act } });
  const middle = () => { const { from, to } = view(); return (from + to) / 2; };
  const field = (name, label) => el("input", { type: "number", step: "any", min: 0, class: "time-field", "aria-label": label, id: `view-${name}`, on: { change: () => {
    const typed = { from: from.valueAsNumber, to: to.valueAsNumber };
    if (Number.isFinite(typed.from) && typed.to > typed.from) change(clipped(typed, whole()));
  } } });
  const from = field("from", "From, in seconds of test time");
  const to = field("to", "To, in seconds of test time");
  const reset = el("button", { type: "button", class: "small", id: "zoom-reset", text: "Reset zoom", on: { click: () => change({ from: null, to: null }) } });
  const node = el("div", { class: "zoom-tools", role: "group", "aria-label": "Zoom" },
    button("+", "Zoom in", () => change(zoomed(view(), whole(), 0.5, middle()))), button("−", "Zoom out", () => change(zoomed(view(), whole(), 2, middle()))),
    button("◀", "Earlier", () => change(moved(view(), whole(), -0.5))), button("▶", "Later", () => change(moved(view(), whole(), 0.5))), reset,
    el("label", { class: "inline" }, "from ", from, " s"), el("label", { class: "inline" }, "to ", to, " s"));
  return { node, show: () => {
    const shown = view();
    for (const [input, value] of [[from, shown.from], [to, shown.to]]) if (document.activeElement !== input) input.value = String(Math.round(value * 1000) / 1000);
    reset.disabled = isWhole(shown, whole());
  } };
}

const isWhole = (view, whole) => view.from <= whole.from && view.to >= whole.to;

function clipped({ from, to }, whole) {
  const length = Math.max(to - from, SHORTEST_S);
  const start = Math.min(Math.max(from, whole.from), Math.max(whole.from, whole.to - length));
  const view = { from: start, to: Math.min(start + length, whole.to) };
  return isWhole(view, whole) ? { from: null, to: null } : view;
}

function zoomed({ from, to }, whole, factor, around) {
  return clipped({ from: around - (around - from) * factor, to: around + (to - around) * factor }, whole);
}

function moved({ from, to }, whole, share) {
  const by = share * (to - from);
  return clipped({ from: from + by, to: to + by }, whole);
}
