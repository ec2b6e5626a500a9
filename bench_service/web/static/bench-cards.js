// The chooser: one card per bench, shown where there is more than one.
import { chip, el, renderKeyed, setText } from "./dom.js";
import { quantity } from "./format.js";
import { benchWord } from "./words.js";

export function benchCards(state, { select }) {
  const box = document.getElementById("bench-cards");
  const readings = new Map();
  const draw = () => {
    // A card keeps its place, so that a hand finds it; what is wrong is told by its colour and word.
    const benches = [...state.benches.values()];
    box.hidden = benches.length < 2;
    const key = JSON.stringify([state.selected, state.connected, benches.map((bench) => [bench.name, bench.state])]);
    renderKeyed(box, key, () => benches.map((bench) => card(state, bench, readings, select)));
    for (const bench of benches) drawReading(readings.get(bench.name), bench.live);
  };
  state.on("benches select link", draw);
  state.on("live", ({ name, live }) => drawReading(readings.get(name), live));
}

function card(state, bench, readings, select) {
  const [tone, word] = benchWord(state, bench);
  const reading = el("span", { class: "card-reading" });
  readings.set(bench.name, reading);
  return el("button", {
    class: "bench-card", type: "button", id: `card-${bench.name}`, data: { tone },
    "aria-pressed": String(bench.name === state.selected), on: { click: () => select(bench.name) },
  }, el("strong", { text: bench.name }), chip(tone, word), reading);
}

/** Air of the temperature chamber and its set point, where the bench has one. */
function chamberWords(live) {
  if (live.chamber_on === undefined) return "";
  const air = quantity(live.ambient_degC, 1, "°C");
  return live.chamber_on ? `chamber ${air} → ${quantity(live.chamber_setpoint_degC, 1, "°C")}` : `chamber ${air}, off`;
}

function drawReading(node, live) {
  if (!node) return;
  const parts = live ? [quantity(live.voltage_V, 3, "V"), quantity(live.current_A, 2, "A"), quantity(live.temperature_degC, 1, "°C"), chamberWords(live)].filter(Boolean) : [];
  setText(node, parts.length ? parts.join("  ") : "no reading yet");
}
