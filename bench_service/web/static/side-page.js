// What every page beside the benches' own has: the live link, the header, and the benches' stops.
import { confirmRest } from "./actions.js";
import { api } from "./api.js";
import { header, stopButtons } from "./header.js";
import { LiveLink } from "./live.js";

const TICK_MS = 1000;

/** `onEvent(event)` for each event; `onBench(name)` after a bench has changed; `onLive()` each time that the link is there. */
export function sidePage(state, { onEvent = () => {}, onBench = () => {}, onLive = () => {} } = {}) {
  const heard = (message) => {
    state.lastHeard = Date.now();
    if (message.type === "bench") state.mergeBench(message);
    else if (message.type === "live") state.mergeLive(message);
    else if (message.type === "event") onEvent(message);
  };
  const changed = (change) => {
    state.link = { retryAt: null, reason: "", ...change };
    if (change.state !== "connecting") state.failed = change.state === "down";
    if (change.state === "live") {
      state.everConnected = true;
      state.lastHeard = Date.now();
      api.health().then((health) => { state.health = health; state.tell("health"); }, () => {});
      api.benches().then((benches) => { state.setBenches(benches); api.learnStopPorts(benches.map((bench) => bench.name)); }, () => {});
      onLive();
    }
    state.tell("link");
  };
  const link = new LiveLink(heard, changed);
  state.on("benches", (change) => {
    if (!change) return;
    confirmRest(state, change.name);
    onBench(change.name);
  });
  header(state, { reconnect: () => link.open() });
  stopButtons(state);
  link.open();
  setInterval(() => state.tell("tick"), TICK_MS);
}
