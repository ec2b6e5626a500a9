// One path: choose runs and a model, compare, see where, learn which effect is missing, add it, watch the error fall.
import { api } from "./api.js";
import { chip, el, renderKeyed } from "./dom.js";
import { chooseForm, ownRuns, rolesOf, usedRuns } from "./improve-choose.js";
import { compareStep, whereStep } from "./improve-compare.js";
import { playBox } from "./improve-play.js";
import { sealBox } from "./improve-seal.js";
import { addedStep, watchStep } from "./improve-watch.js";
import { inText, namedBy, whichStep } from "./improve-which.js";
import { busyBox, follow } from "./jobs.js";

const STEPS = [["choose", "Choose"], ["compare", "Compare"], ["where", "Where"], ["which", "Which"], ["add", "Add"], ["watch", "Watch"]];
const SHOWN_RUNS = 200;

export function improvePanel(state) {
  const root = document.getElementById("improve-body");
  const panel = new Improve(root, state);
  const load = () => panel.load().catch((error) => console.warn(error.message));
  state.on("campaigns benches-listed", (change) => { if (!change || change.stateBefore !== state.campaigns.get(change.id)?.state) load(); });
  state.on("runs", () => panel.offer(state.runs ?? []));
  state.on("benches", () => panel.seals.draw());
}

class Improve {
  constructor(root, state) {
    this.root = root;
    this.state = state;
    // `said`: what somebody has set by hand; `roles`: what every run is used for.
    this.view = { models: [], runs: [], modelId: null, said: new Map(), roles: new Map(), mode: "structure" };
    this.effects = new Map(); // what the service knows of each, by name
    this.charts = new Map();
    this.busy = null;
    this.round = 0; // answers of an earlier choice are not shown
    this.asked = 0;
    this.answered = 0; // nor is a list that was asked for before the one that is shown
    this.parts = new Map(STEPS.map(([key, title], k) => [key, el("section", { class: "step", id: `improve-${key}`, hidden: key !== "choose", "aria-label": title, data: { step: key } },
      el("h3", {}, el("span", { class: "step-number", text: String(k + 1) }), title), el("div", { class: "step-body" }))]));
    this.track = el("ol", { class: "stages steps", "aria-label": "Steps" });
    this.named = []; // by diagnoses, for whoever plays the sealed game
    this.seals = sealBox(state, this.titleOf, () => this.named);
    this.form = chooseForm(this.view, { chosen: () => this.compare(), changed: () => this.chooseAnew() });
  }

  titleOf = (effect) => this.effects.get(effect)?.title ?? effect.replaceAll("_", " ");

  shownOver = (effect) => this.effects.get(effect)?.shows_over ?? ["soc"];

  unitOf = (effect, parameter) => this.effects.get(effect)?.parameters.find(({ name }) => name === parameter)?.unit ?? "1";

  async load() {
    this.naming ??= this.name();
    this.asked += 1;
    const asked = this.asked;
    const [models, runs] = await Promise.all([api.models(), api.runs({ limit: SHOWN_RUNS })]);
    if (asked < this.answered) return;
    this.answered = asked;
    // A model may have been loaded from a file while the list was under way.
    const chosen = this.view.models.find((model) => model.id === this.view.modelId && !models.some((each) => each.id === model.id));
    this.view.models = chosen ? [chosen, ...models] : models;
    this.takeRuns(runs);
    if (!this.view.modelId && models.length) this.view.modelId = models[0].id;
    if (!this.root.contains(this.track)) {
      this.fill("choose", this.form.node);
      renderKeyed(this.root, "improve", () => [this.track, this.seals.node, ...this.parts.values()]);
    }
    this.drawChoose();
    this.seals.draw();
  }

  /** What effects are called, and what else there is to know of them; the first question after the service's start takes it seconds, and nothing waits for it. */
  async name() {
    try {
      for (const each of await api.effects()) this.effects.set(each.name, each);
      this.seals.draw();
    } catch (error) {
      this.naming = null;
      console.warn(error.message);
    }
  }

  /** Runs that the page has heard of otherwise; only a finished one can be used. */
  offer(runs) {
    const known = new Set(this.view.runs.map((run) => run.id));
    const fresh = runs.filter((run) => run.n_samples && run.ended_utc && !known.has(run.id));
    if (!fresh.length || !this.root.contains(this.track)) return;
    this.takeRuns([...fresh, ...this.view.runs]);
    this.drawChoose();
  }

  takeRuns(runs) {
    this.view.runs = runs.filter((run) => run.n_samples && run.ended_utc);
  }

  fill(step, content) {
    for (const chart of this.charts.get(step) ?? []) chart.dispose();
    this.charts.set(step, []);
    const part = this.parts.get(step);
    part.hidden = !content;
    part.lastChild.replaceChildren(...[content].flat().filter(Boolean));
    this.drawTrack();
    return part;
  }

  keep = (step) => (chart) => this.charts.get(step).push(chart);

  clearFrom(step) {
    for (const [key] of STEPS.slice(STEPS.findIndex(([each]) => each === step))) this.fill(key, null);
  }

  drawTrack() {
    const open = STEPS.filter(([key]) => !this.parts.get(key).hidden).map(([key]) => key);
    renderKeyed(this.track, `${open.join()} ${this.busy?.step}`, () => STEPS.map(([key, title], k) => {
      const [tone, word] = this.busy?.step === key ? ["active", "running"] : open.includes(key) ? ["good", { choose: "chosen", watch: "shown" }[key] ?? "done"] : ["muted", "waiting"];
      return el("li", { class: "stage", data: { tone, stage: key } }, el("a", { class: "stage-name", href: `#improve-${key}`, text: `${k + 1} ${title}` }), el("span", { class: "stage-state" }, chip(tone, word)));
    }));
  }

  /** Once the comparison has begun, a run that is new gets no use by itself. */
  drawChoose() {
    if (!this.started) this.view.roles = rolesOf(this.view);
    this.form.draw();
  }

  /** Another model or question: what was said of the runs holds, but not of those that the model was made from. */
  chooseAnew() {
    this.started = false;
    this.round += 1;
    for (const id of ownRuns(this.view)) this.view.said.delete(id);
    this.clearFrom("compare");
    this.drawChoose();
    this.watch();
  }

  /** Work with a bar in its step; what goes wrong is said there, in the service's words. */
  async work(step, title, ask) {
    const round = this.round;
    const box = busyBox(title);
    this.busy = { step };
    this.fill(step, box.node).scrollIntoView({ block: "nearest" });
    try {
      const answer = await ask(box.update);
      return round === this.round ? answer : null;
    } catch (error) {
      if (round === this.round) this.fill(step, el("p", { class: "form-message", role: "alert", text: `${title}: ${error.message}` }));
      return null;
    } finally {
      box.end();
      if (this.busy?.step === step) this.busy = null;
      this.drawTrack();
    }
  }

  async compare() {
    this.started = true;
    this.round += 1;
    this.clearFrom("compare");
    this.watch();
    const { looked } = usedRuns(this.view);
    const found = await this.work("compare", "Simulating the runs with the model", async () => {
      const compared = await api.compare({ model_id: this.view.modelId, run_ids: looked });
      await this.naming;
      return compared;
    });
    if (!found) return;
    this.fill("compare", compareStep(found, this.view.runs, this.unitOf, this.keep("compare"))).scrollIntoView({ block: "start" });
    const where = await this.work("where", "Looking where the error is", () => api.where(found.id));
    const ask = el("button", { type: "button", class: "primary", text: this.view.mode === "change" ? "Find out what has changed" : "Find out what is missing", on: { click: () => this.diagnose() } });
    this.profiles = where?.profiles ?? [];
    if (where) this.fill("where", [whereStep(where, this.keep("where")), el("div", { class: "form-end" }, ask)]);
  }

  async diagnose() {
    const { train, looked } = usedRuns(this.view);
    const own = ownRuns(this.view);
    const learned = this.view.mode === "change" ? own : train;
    const body = { model_id: this.view.modelId, run_ids: looked, mode: this.view.mode, train_run_ids: learned.filter((id) => !looked.includes(id)) };
    this.clearFrom("which");
    this.watch();
    const found = await this.work("which", "Holding every known effect against the error", async (update) => {
      const result = await follow(await api.diagnose(body), update);
      await this.naming;
      return api.diagnosis(result.diagnosis_id);
    });
    if (!found) return;
    const named = namedBy(found.result);
    if (named) this.named = [...this.named.filter(({ effect }) => effect !== named.effect), named];
    this.seals.draw();
    this.fill("which", whichStep(found, this.titleOf, this.keep("which"), { add: (effect) => this.add(effect), addNote: this.addNote(), profiles: this.profiles ?? [], shownOver: this.shownOver, play: () => playBox(this.state, found.id, (run) => this.useAlso(run)) })).scrollIntoView({ block: "start" });
  }

  /** Why nothing can be added now; empty where it can. */
  addNote() {
    const { judge, train } = usedRuns(this.view);
    if (!judge.length) return "A run to judge the result is missing: set one to “look at it” above.";
    if (train.length) return "";
    return this.view.mode === "change" ? "A run after the change to refit to is missing: set one to “refit to it” above." : "A run to refit to is missing: set one to “refit to it” above.";
  }

  async add(effect) {
    const { judge, train } = usedRuns(this.view);
    const parent = this.view.modelId;
    for (const button of this.parts.get("which").querySelectorAll("button[data-effect]")) button.disabled = true;
    const added = await this.work("add", `Adding ${inText(this.titleOf(effect))} and refitting`, async (update) =>
      follow(await api.addEffect(parent, { effect, train_run_ids: train, validate_run_ids: judge }), update));
    for (const button of this.parts.get("which").querySelectorAll("button[data-effect]")) button.disabled = false;
    if (!added) return;
    this.fill("add", addedStep(added, this.titleOf, { next: (id) => this.goOn(id) }));
    await this.watch(added.model);
    this.parts.get("add").scrollIntoView({ block: "start" });
  }

  /** A run that has just been played joins those that are looked at, and the question is asked again. */
  async useAlso(run) {
    this.offer([run]);
    for (const uses of [this.view.said, this.view.roles]) uses.set(run.id, "judge");
    this.drawChoose();
    await this.compare();
    if (!this.parts.get("where").hidden) await this.diagnose();
  }

  /** Another version with the same runs, so that the errors can be compared. */
  async goOn(modelId) {
    this.view.models = await api.models().catch(() => this.view.models);
    this.view.modelId = modelId;
    this.form.draw();
    await this.compare();
  }

  async watch(modelId = this.view.modelId) {
    const round = this.round;
    const chain = modelId ? await api.chain(modelId).catch(() => null) : null;
    await this.naming;
    if (round !== this.round) return;
    const worth = chain && chain.models.length > 1;
    this.fill("watch", worth ? watchStep(chain, this.titleOf, this.keep("watch"), { goOn: (id) => this.goOn(id) }) : null);
  }
}
