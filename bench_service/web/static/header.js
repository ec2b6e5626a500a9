// Service and connection state, the banner for old values, and the STOP buttons that are always in sight.
import { stopBench } from "./actions.js";
import { el, setText } from "./dom.js";
import { duration, percent } from "./format.js";
import { inMotion, wordFor } from "./words.js";

const MOST_STOPS = 3;

export function header(state, { reconnect }) {
  const service = document.getElementById("service");
  const banner = document.getElementById("offline-banner");
  const bannerText = el("span");
  banner.append(el("strong", { text: "Disconnected, values are old. " }), bannerText,
    el("button", { class: "small", type: "button", text: "Try now", on: { click: reconnect } }));
  const draw = () => {
    drawService(state, service);
    drawBanner(state, banner, bannerText);
  };
  state.on("link health tick", draw);
  draw();
}

function serviceWords(state) {
  if (state.link.state === "connecting" && !state.failed) return ["neutral", "Connecting …"];
  if (!state.connected) return ["bad", "Disconnected"];
  if (!state.health) return ["warn", "Live, health unknown"];
  const storage = state.health.storage ?? { state: "ok", damaged_runs: 0 };
  if (storage.state !== "ok") return ["bad", "Live, nothing can be stored"];
  if (storage.damaged_runs) return ["warn", `Live, ${storage.damaged_runs} run${storage.damaged_runs > 1 ? "s" : ""} damaged`];
  if (state.health.status !== "ok") return ["warn", `Live, service ${state.health.status}`];
  if (state.health.recorder && state.health.recorder !== "running") return ["bad", `Live, recorder ${state.health.recorder}`];
  return ["good", "Live, service ok"];
}

function drawService(state, node) {
  const [tone, word] = serviceWords(state);
  node.firstElementChild.dataset.tone = tone;
  setText(node.lastElementChild, word);
  node.title = state.health ? `recorder ${state.health.recorder ?? "?"}, storage ${state.health.storage?.state ?? "?"}, version ${state.health.version ?? "?"}` : "";
}

function drawBanner(state, banner, text) {
  const down = !state.connected && (state.everConnected || state.failed);
  document.body.classList.toggle("stale", Boolean(down));
  banner.hidden = !down;
  if (!down) return;
  const why = state.link.reason ? `The service says: ${state.link.reason}. ` : "";
  const age = state.lastHeard ? `Last word from the service ${duration((Date.now() - state.lastHeard) / 1000)} ago. ` : "";
  const wait_s = state.link.retryAt ? Math.ceil((state.link.retryAt - Date.now()) / 1000) : 0;
  const next = wait_s > 0 ? `Next try in ${wait_s} s. ` : "Trying again … ";
  setText(text, `${why}${age}Benches keep to their limits by themselves, and go to rest if the service itself is gone. ${next}`);
}

/** STOP in a place that never scrolls away: of the selected bench always, of every other one while it moves. */
export function stopButtons(state) {
  const box = document.getElementById("stops");
  const entries = new Map();
  const all = el("button", { id: "stop-all", class: "stop", type: "button", on: { click: () => {
    for (const [name, bench] of state.benches) if (bench.state !== "offline") stopBench(state, name);
  } } }, el("span", { class: "stop-sign", "aria-hidden": "true" }), "STOP all");
  const draw = () => {
    const moving = [...state.benches.values()].filter(inMotion).length;
    // Beyond a handful one button for all of them is what a hand finds.
    const many = moving > MOST_STOPS;
    for (const [name, bench] of state.benches) {
      const shown = name === state.selected || (inMotion(bench) && !many);
      if (shown && !entries.has(name)) entries.set(name, addEntry(state, box, name));
      if (!shown && entries.has(name)) {
        entries.get(name).node.remove();
        entries.delete(name);
      }
      if (shown) drawEntry(entries.get(name), bench);
    }
    if (moving > 1 && !all.isConnected) box.append(all);
    if (moving < 2) all.remove();
    document.body.classList.toggle("has-stops", entries.size > 0);
  };
  state.on("benches live select", draw);
}

function addEntry(state, box, name) {
  const text = el("span", { class: "stop-text" });
  const button = el("button", {
    class: "stop", type: "button", "aria-label": `STOP ${name}`, on: { click: () => stopBench(state, name) },
  }, el("span", { class: "stop-sign", "aria-hidden": "true" }), `STOP ${name}`);
  const node = el("div", { class: "stop-entry" }, text, button);
  box.append(node);
  return { node, text, button };
}

function drawEntry(entry, bench) {
  const [, word] = wordFor("bench", bench.state);
  const progress = inMotion(bench) ? bench.live?.progress : null;
  entry.button.dataset.moves = String(inMotion(bench));
  setText(entry.text, Number.isFinite(progress) ? `${word}, ${percent(progress, 0)}` : word);
}
