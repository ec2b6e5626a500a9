// The sealed game: an effect is hidden in a simulated cell; it is looked for along the steps, then the seal is opened.
import { api } from "./api.js";
import { el, renderKeyed } from "./dom.js";
import { inText, sizeText } from "./improve-which.js";

const SHOWN_OF_HASH = 12;

/** A notice for each bench with a seal; `draw()` after news of benches. `named()` is what diagnoses have named, `{effect, words}` each. */
export function sealBox(state, titleOf, named) {
  const node = el("div", { class: "seals" });
  const draw = () => {
    const benches = [...state.benches.values()].filter((bench) => bench.seal);
    const found = named();
    renderKeyed(node, JSON.stringify([benches.map(({ name, seal }) => [name, seal]), found, benches.map(({ seal }) => titleOf(seal.opened?.effect ?? ""))]),
      () => benches.map((bench) => (bench.seal.opened ? opened(bench, titleOf, found) : closed(bench))));
  };
  return { node, draw };
}

const hash = (sha256) => el("code", { title: sha256, text: `${sha256.slice(0, SHOWN_OF_HASH)}…` });

function closed({ name, seal }) {
  const message = el("p", { class: "form-message", role: "alert" });
  const button = el("button", { type: "button", text: "Open the seal", on: { click: async () => {
    button.disabled = true;
    try {
      await api.openSeal(name); // the news of it come over the live feed
    } catch (error) {
      message.textContent = error.message;
      button.disabled = false;
    }
  } } });
  return el("div", { class: "notice seal", data: { tone: "active", seal: name } },
    el("strong", { text: `An effect is hidden in the cell of bench ${name}` }),
    el("span", {}, "Find it along the steps below, then open the seal. Its SHA-256 is ", hash(seal.sha256), "."),
    el("div", { class: "form-end" }, button, message));
}

function opened({ name, seal: { sha256, opened: told } }, titleOf, found) {
  const right = found.find(({ effect }) => effect === told.effect);
  const all = found.map(({ effect, words }) => `${inText(titleOf(effect))} (${words})`).join(", ");
  return el("div", { class: "notice seal", role: "status", data: { tone: !found.length ? "neutral" : right ? "good" : "warn", seal: name } },
    el("strong", { text: `The seal of bench ${name} is open: ${inText(titleOf(told.effect))}, ${sizeText(told.value, told.unit)} where the cell had ${sizeText(told.before, told.unit)}` }),
    el("span", { text: right ? `That is what the diagnosis named: ${right.words}.` : found.length ? `The diagnosis named something else: ${all}.` : "No diagnosis has named an effect yet." }),
    el("span", { class: "about" }, hash(sha256), ` is the SHA-256 of “${told.contents}”.`));
}
