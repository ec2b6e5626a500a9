// The selected bench: state, readings, latched fault, the last command's answer.
import { acknowledge } from "./actions.js";
import { cellName } from "./cell-fields.js";
import { chip, el, renderKeyed, setText } from "./dom.js";
import { BAND, MISSING, currentWord, duration, fixed, localTime, percent, quantity } from "./format.js";
import { holdButton, holdKey, stepWords } from "./run-control.js";
import { liveChart } from "./live-chart.js";
import { TimeLeft } from "./time-left.js";
import { benchWord, inMotion, isUnverified } from "./words.js";

const OLD_AFTER_S = 3; // readings come several times a second while a bench is connected

export function benchPanel(state, traces) {
  const root = document.getElementById("bench-section");
  let parts = null;
  const draw = () => {
    const bench = state.bench;
    if (!bench) return drawEmpty(state, root);
    if (parts?.name !== bench.name) parts = build(state, traces, root, bench.name);
    drawState(state, parts, bench);
    drawReadings(parts, bench);
    drawAge(state, parts, bench);
  };
  state.on("benches select answers link", draw);
  state.on("live", ({ name }) => {
    if (name !== state.selected || !parts) return;
    drawTimeLeft(state, parts, state.bench);
    drawReadings(parts, state.bench);
    drawAge(state, parts, state.bench);
  });
  state.on("tick", () => state.bench && parts && drawAge(state, parts, state.bench));
}

function drawEmpty(state, root) {
  if (!state.loaded) return;
  renderKeyed(root, "empty", () => el("p", { class: "empty" },
    "The service knows no bench. Name one in ", el("code", { text: "bench.toml" }), " and restart the service."));
}

function build(state, traces, root, name) {
  const parts = {
    name, chip: el("span", { role: "status" }), about: el("p", { class: "about" }), hardware: el("div"), reason: el("div"),
    answer: el("p", { class: "answer", role: "status" }), age: el("p", { class: "age" }), readings: readings(),
    hold: el("div", { class: "form-end" }), left: el("p", { class: "time-left", hidden: true }), timeLeft: new TimeLeft(),
  };
  root.dataset.key = name;
  root.setAttribute("aria-label", `Bench ${name}`);
  root.replaceChildren(
    el("div", { class: "bench-side" },
      el("header", { class: "bench-head" }, el("h2", { text: name }), parts.chip), parts.about, parts.hardware, parts.reason, parts.left, parts.hold, parts.readings.node, parts.age, parts.answer),
    liveChart(state, traces, name));
  return parts;
}

function readings() {
  const names = [["voltage", "Voltage", "V"], ["current", "Current", "A"], ["soc", "State of charge", "%"],
    ["temperature", "Cell temperature", "°C"], ["ambient", "Ambient", "°C"]];
  const cells = {};
  const node = el("dl", { class: "readings" }, names.map(([key, title, unit]) => {
    const cell = { value: el("span", { class: "number", text: MISSING }), note: el("span", { class: "note" }), mark: el("span", { class: "gauge-mark" }) };
    cell.gauge = el("span", { class: "gauge", hidden: true }, cell.mark);
    cells[key] = cell;
    return el("div", { class: `reading ${key}`, data: { reading: key } }, el("dt", { text: title }),
      el("dd", {}, cell.value, el("span", { class: "unit", text: unit }), cell.note, cell.gauge));
  }));
  return { node, ...cells };
}

function drawState(state, parts, bench) {
  const [tone, word] = benchWord(state, bench);
  renderKeyed(parts.chip, word, () => chip(tone, word));
  const device = bench.capabilities ? [bench.capabilities.name, bench.capabilities.serial].filter(Boolean).join(" ") : "";
  setText(parts.about, [bench.cell ? `cell ${cellName(bench.cell)}` : "", device, quantity(bench.capacity_Ah, 2, "Ah"), bench.lock_step ? "lock-step (simulated time)" : bench.commissioning?.state === "simulated" ? "simulated" : "", bench.url]
    .filter((text) => text && text !== MISSING).join(" · "));
  renderKeyed(parts.reason, JSON.stringify([bench.state, bench.reason]), () => reason(state, bench));
  drawTimeLeft(state, parts, bench);
  renderKeyed(parts.hardware, JSON.stringify(bench.commissioning ?? null), () => hardware(bench));
  const answer = state.answers.get(bench.name);
  setText(parts.answer, answer ? `${localTime(answer.at)} ${answer.text}` : "");
  parts.answer.dataset.tone = answer ? { true: "good", false: "bad", null: "neutral" }[answer.ok] : "";
}

function drawTimeLeft(state, parts, bench) {
  renderKeyed(parts.hold, holdKey(bench), () => holdButton(state, bench));
  const text = inMotion(bench) ? [stepWords(bench.live), parts.timeLeft.words(bench)].filter(Boolean).join(" · ") : "";
  parts.left.hidden = !text;
  setText(parts.left, text);
}

/** Hardware that nobody has looked at says so for as long as that is so. */
function hardware(bench) {
  if (!isUnverified(bench.commissioning)) return null;
  return el("div", { class: "notice", id: "not-commissioned", data: { tone: "warn" } },
    el("p", {}, el("strong", { text: "Hardware not commissioned: " }), bench.commissioning.reason ?? "no reason given"),
    el("p", {}, "Its runs say so in their data. ", el("code", { text: `bench-service commission ${bench.name}` }), " proves sign, watchdog, limits and stop."));
}

function reason(state, bench) {
  if (bench.state === "fault") {
    return el("div", { class: "notice", role: "alert", data: { tone: "bad" } },
      el("p", {}, el("strong", { text: "Fault latched: " }), bench.reason ?? "no reason given"),
      el("p", { text: "The bench stays at rest until the fault is acknowledged. Look at cell, wiring and cycler first." }),
      el("button", { id: "acknowledge", class: "primary", type: "button", text: "Acknowledge fault", on: { click: () => acknowledge(state, bench.name) } }));
  }
  if (bench.state === "offline") {
    return el("div", { class: "notice", data: { tone: "warn" } },
      el("p", {}, el("strong", { text: "Offline. " }), bench.reason ?? "The cycler does not answer."),
      el("p", { text: `Check that the cycler is on and reachable at ${bench.url ?? "its address"}; the service keeps trying.` }));
  }
  return bench.reason ? el("p", { class: "about", text: bench.reason }) : null;
}

function drawReadings({ readings: cells }, bench) {
  const live = bench.live ?? {};
  const limits = bench.limits ?? {};
  const span_A = Math.max(...(limits.current_A ?? [0, 0]).map(Math.abs));
  setText(cells.voltage.value, fixed(live.voltage_V, 4));
  setText(cells.current.value, fixed(live.current_A, 3));
  setText(cells.current.note, currentWord(live.current_A, Math.max(0.002, span_A * 2e-3)));
  setText(cells.soc.value, Number.isFinite(live.soc) ? fixed(live.soc * 100, 1) : MISSING);
  setText(cells.soc.note, socNote(bench, live));
  setText(cells.temperature.value, fixed(live.temperature_degC, 1));
  setText(cells.ambient.value, fixed(live.ambient_degC, 1));
  setText(cells.ambient.note, chamberNote(bench, live));
  gauge(cells.voltage, live.voltage_V, limits.voltage_V, 2, "V");
  gauge(cells.current, live.current_A, limits.current_A, 1, "A");
  gauge(cells.soc, live.soc, limits.soc, 0, "%", 100);
  gauge(cells.temperature, live.temperature_degC, limits.temperature_degC, 0, "°C");
}

/** What the temperature chamber around the cell is told, where there is one. */
function chamberNote(bench, live) {
  if (!bench.chamber) return "";
  if (!bench.chamber.online) return "chamber does not answer";
  return live.chamber_on ? `chamber, set to ${quantity(live.chamber_setpoint_degC, 1, "°C")}` : "chamber off";
}

function socNote(bench, live) {
  if (!Number.isFinite(live.soc)) return bench.run_id ? "no observer" : "known in a run";
  if (!Number.isFinite(live.soc_std)) return "counted, no observer";
  return `± ${percent(BAND * live.soc_std)} (95 %)`;
}

/** Where a value stands between its limits. */
function gauge(cell, value, limits, digits, unit, scale = 1) {
  const [low, high] = limits ?? [];
  const known = Number.isFinite(low) && Number.isFinite(high) && high > low;
  cell.gauge.hidden = !known;
  if (!known) return;
  const share = Number.isFinite(value) ? Math.min(1, Math.max(0, (value - low) / (high - low))) : null;
  cell.mark.hidden = share === null;
  cell.mark.style.left = `${(share ?? 0) * 100}%`;
  cell.gauge.dataset.near = String(share !== null && (share < 0.03 || share > 0.97));
  cell.gauge.title = `Limits ${fixed(low * scale, digits)} … ${fixed(high * scale, digits)} ${unit}`;
}

function drawAge(state, parts, bench) {
  const heard = state.heard.get(bench.name);
  if (!heard) {
    setText(parts.age, bench.live ? "" : "No reading yet.");
    return;
  }
  const age_s = (Date.now() - heard) / 1000;
  const old = !state.connected || age_s > OLD_AFTER_S;
  const moving = inMotion(bench);
  parts.readings.node.classList.toggle("old", old);
  parts.age.dataset.tone = old && (moving || !state.connected) ? "bad" : "";
  setText(parts.age, old ? `Last reading ${duration(age_s)} ago, at ${localTime(new Date(heard))}.` : timing(bench.live));
}

function timing(live) {
  const parts = ["Readings are live"];
  if (Number.isFinite(live?.missed_ticks)) parts.push(`missed ticks ${live.missed_ticks}`);
  if (Number.isFinite(live?.lateness_p99_s)) parts.push(`99 of 100 ticks at most ${quantity(live.lateness_p99_s * 1000, 1, "ms")} late`);
  return parts.join(" · ");
}
