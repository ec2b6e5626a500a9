// What happened lately, newest first.
import { chip, el, renderKeyed } from "./dom.js";
import { timeElement } from "./format.js";
import { wordFor } from "./words.js";

const SHOWN = 30;

export function eventsPanel(state) {
  const body = document.getElementById("events-body");
  state.on("events", () => {
    const events = (state.events ?? []).slice(0, SHOWN);
    renderKeyed(body, JSON.stringify(events), () => (events.length ? el("ul", { class: "events" }, events.map(row))
      : el("p", { class: "empty", text: "Nothing has happened yet. Starts, stops, faults and lost connections are listed here." })));
  });
}

function row(event) {
  const [tone, word] = wordFor("severity", event.severity);
  return el("li", {}, timeElement(event.time_utc ?? event.created_utc), chip(tone, word),
    el("span", { class: "event-text" }, event.bench ? el("strong", { text: `${event.bench} ` }) : null, event.text ?? event.code));
}
