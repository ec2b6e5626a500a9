// One path: choose runs and a model, compare, see where, learn which effect is missing, add it, watch the error fall.
import { api } from "./api.js";
import { chip, el, renderKeyed } from "./dom.js";
import { readAddress, writeAddress } from "./improve-address.js";
import { chooseForm } from "./improve-choose.js";
import { compareStep, whereStep } from "./improve-compare.js";
import { promise } from "./improve-forecast.js";
import { playBox } from "./improve-play.js";
import { ownRuns, rolesOf, usedRuns } from "./improve-roles.js";
import { sealBox } from "./improve-seal.js";
import { addedStep, watchStep } from "./improve-watch.js";
import { inText, namedBy, whichStep } from "./improve-which.js";
import { busyBox, follow } from "./jobs.js";

const STEPS = [["choose", "Choose"], ["compare", "Compare"], ["where", "Where"], ["which", "Which"], ["add", "Add"], ["watch", "Watch"]];
const SHOWN_RUNS = 200;

/** Gives `load()`, which asks anew what models and runs there are. */
export function improvePanel(state) {
  const root = document.getElementById("improve-body");
  const panel = new Improve(root, state);
  state.on("benches", () => panel.seals.draw());
  return { load: () => panel.load().catch((error) => console.warn(error.message)) };
}

class Improve {
  constructor(root, state) {
    this.root = root;
    this.state = state;
    // `said`: what somebody has set by hand; `roles`: what every run is used for.
    this.place = readAddress(); // where somebody wants to go on; null once that is so
    this.found = {}; // what of the steps stands in the address
    this.view = { models: [], runs: [], modelId: null, said: new Map(), roles: new Map(), mode: this.place.mode === "change" ? "change" : "structure" };
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
    this.form = chooseForm(this.view, { chosen: () => this.compare(), changed: () => this.chooseAnew(), said: () => this.remember({}), fit: (job) => this.fitted(job) });
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
    const place = this.place;
    this.place = null;
    if (!this.view.modelId && models.length) this.view.modelId = models.find((model) => model.id === place?.model)?.id ?? models[0].id;
    if (place) await this.fetchRuns([...(place.look ?? []), ...(place.train ?? [])]);
    if (!this.root.contains(this.track)) {
      this.fill("choose", this.form.node);
      renderKeyed(this.root, "improve", () => [this.track, this.seals.node, ...this.parts.values()]);
    }
    if (place?.look || place?.train) {
      const usual = rolesOf(this.view);
      for (const { id } of this.view.runs) {
        const role = place.train?.includes(id) ? "train" : place.look?.includes(id) ? "judge" : "";
        if (role !== usual.get(id)) this.view.said.set(id, role);
      }
    }
    this.drawChoose();
    this.seals.draw();
    if (place) await this.goBackTo(place);
  }

  /** Runs that the address names and the list has not. */
  async fetchRuns(ids) {
    const known = new Set(this.view.runs.map((run) => run.id));
    const more = await Promise.all(ids.filter((id) => !known.has(id)).map((id) => api.run(id).catch(() => null)));
    this.takeRuns([...more.filter(Boolean), ...this.view.runs]);
  }

  /** The steps that an address tells of; what is no longer there is left out. */
  async goBackTo({ model, comparison, diagnosis, added, doing, job, effect }) {
    if (job && doing === "fit") return this.fitted({ id: job });
    if (!model || model !== this.view.modelId) return this.watch();
    const found = comparison && await api.comparison(comparison).catch(() => null);
    if (found) {
      this.started = true;
      await this.naming;
      this.found = { comparison };
      await this.showComparison(found);
      const named = diagnosis && await api.diagnosis(diagnosis).catch(() => null);
      if (named) {
        this.found = { comparison, diagnosis };
        this.showDiagnosis(named);
      }
      const child = added && await api.model(added).catch(() => null);
      if (child?.metrics?.effect) {
        this.found = { comparison, diagnosis, added };
        this.showAdded({ model: child.id, ...child.metrics });
      }
    }
    if (job && found && doing === "which") await this.diagnosed({ id: job });
    else if (job && found && doing === "add" && effect) await this.addedBy({ id: job }, effect);
    else await this.watch(added);
  }

  /** Keep in the address what has been found; what comes after it in the path is no longer so. */
  remember(found) {
    this.found = found;
    const said = this.view.said.size || this.started;
    const { judge, train } = usedRuns(this.view);
    writeAddress({ model: this.view.modelId, mode: this.view.mode === "change" ? "change" : "", ...(said ? { look: judge, train } : {}), ...found });
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

  /** Only a finished run can be used. */
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
      const [tone, word] = this.busy?.step === key ? ["active", "running"] : open.includes(key) && (key !== "choose" || this.view.modelId) ? ["good", { choose: "chosen", watch: "shown" }[key] ?? "done"] : ["muted", "waiting"];
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
    this.remember({});
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
    this.remember({});
    this.watch();
    const { looked } = usedRuns(this.view);
    const found = await this.work("compare", "Simulating the runs with the model", async () => {
      const compared = await api.compare({ model_id: this.view.modelId, run_ids: looked });
      await this.naming;
      return compared;
    });
    if (!found) return;
    this.remember({ comparison: found.id });
    await this.showComparison(found);
  }

  async showComparison(found) {
    this.fill("compare", compareStep(found, this.view.runs, this, this.keep("compare"))).scrollIntoView({ block: "start" });
    const where = await this.work("where", "Looking where the error is", () => api.where(found.id));
    const ask = found.result.module ? el("p", { class: "about", text: "A diagnosis is of one cell's model: what a module's cells lack is found on tests of a cell." }) : el("button", { type: "button", class: "primary", text: this.view.mode === "change" ? "Find out what has changed" : "Find out what is missing", on: { click: () => this.diagnose() } });
    this.profiles = where?.profiles ?? [];
    if (where) this.fill("where", [whereStep(where, found.result, this.keep("where")), el("div", { class: "form-end" }, ask)]);
  }

  async diagnose() {
    const { train, looked } = usedRuns(this.view);
    const own = ownRuns(this.view);
    const learned = this.view.mode === "change" ? own : train;
    const body = { model_id: this.view.modelId, run_ids: looked, mode: this.view.mode, train_run_ids: learned.filter((id) => !looked.includes(id)) };
    this.clearFrom("which");
    this.watch();
    await this.diagnosed(null, () => api.diagnose(body));
  }

  /** A diagnosis that is under way, or begins now. */
  async diagnosed(job, begin) {
    const { comparison } = this.found;
    const found = await this.work("which", "Holding every known effect against the error", async (update) => {
      const begun = job ?? await begin();
      this.remember({ comparison, doing: "which", job: begun.id });
      const result = await follow(begun, update);
      await this.naming;
      return api.diagnosis(result.diagnosis_id);
    });
    this.remember({ comparison, diagnosis: found?.id });
    if (found) this.showDiagnosis(found);
  }

  showDiagnosis(found) {
    this.diagnosis = found;
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
    return `A run${this.view.mode === "change" ? " after the change" : ""} to refit to is missing: set one to “learn from it” above.`;
  }

  async add(effect) {
    const { judge, train } = usedRuns(this.view);
    await this.addedBy(null, effect, () => api.addEffect(this.view.modelId, { effect, train_run_ids: train, validate_run_ids: judge }));
  }

  /** An effect that is being added, or is from now on. */
  async addedBy(job, effect, begin) {
    const { comparison, diagnosis } = this.found;
    const buttons = (disabled) => { for (const button of this.parts.get("which").querySelectorAll("button[data-effect]")) button.disabled = disabled; };
    buttons(true);
    const added = await this.work("add", `Adding ${inText(this.titleOf(effect))} and refitting`, async (update) => {
      const begun = job ?? await begin();
      this.remember({ comparison, diagnosis, doing: "add", job: begun.id, effect });
      return follow(begun, update);
    });
    buttons(false);
    this.remember({ comparison, diagnosis, added: added?.model });
    if (!added) return;
    this.showAdded(added);
    await this.watch(added.model);
    this.parts.get("add").scrollIntoView({ block: "start" });
  }

  showAdded(added) {
    const record = this.diagnosis;
    const finding = record && this.found.diagnosis === record.id && record.result.findings.find(({ effect }) => effect === added.effect);
    this.fill("add", addedStep(added, this.titleOf, finding ? promise(finding, record) : null, { next: (id) => this.goOn(id) }));
  }

  /** A model that is being made: when it is there it is the one that is looked at. */
  async fitted(job) {
    const round = this.round;
    const box = busyBox("Fitting the model");
    this.remember({ ...this.found, doing: "fit", job: job.id });
    this.form.place.replaceChildren(box.node);
    this.busy = { step: "choose" };
    this.drawTrack();
    const made = await follow(job, box.update).catch((error) => error);
    box.end();
    if (this.busy?.step === "choose") this.busy = null;
    this.drawTrack();
    if (made instanceof Error) {
      this.form.place.replaceChildren(el("p", { class: "form-message", role: "alert", text: `Fitting the model: ${made.message}` }));
      return this.remember({});
    }
    this.view.models = await api.models();
    // Somebody who has gone on meanwhile is left where he is.
    if (round !== this.round) return this.form.draw();
    this.view.modelId = made.model_id;
    this.chooseAnew();
    await this.compare();
  }

  /** A run that has just been played joins those that are looked at, and the question is asked again. */
  async useAlso(run) {
    this.takeRuns([run, ...this.view.runs.filter((each) => each.id !== run.id)]);
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
