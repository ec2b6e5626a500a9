// One run as the plot needs it: the part that is looked at, thinned by the service, and what is new while the run goes on.
import { api } from "./api.js";

const WANTED = ["seq", "time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "setpoint_A", "flags", "charge_Ah", "energy_Wh", "step_count", "cycle_count"];
const OBSERVED = "seq,time_s,soc,soc_std,innovation_V";
const COUNTED = ["charge_Ah", "energy_Wh"];
const MOST_NEWS = 4; // times the points of a picture: then everything anew
export const ENDED = ["completed", "stopped", "fault", "interrupted"];

export class RunData {
  constructor(run) {
    this.run = run;
    this.samples = {};
    this.observer = {};
    this.compared = null; // {time_s, measured_V, model_V, residual_mV} of a model of choice
    this.end_s = 0;
    this.damage = run.damage ?? null;
    this.asked = 0;
  }

  get goesOn() {
    return !ENDED.includes(this.run.state);
  }

  get name() {
    return this.run.label ?? this.run.name ?? `run ${this.run.id.slice(0, 8)}`;
  }

  /** Load the rows between two times; null leaves an end open. An answer that a later question has overtaken is dropped. */
  async load({ from, to }, points) {
    this.asked += 1;
    const asked = this.asked;
    if (!this.columns) await this.learn();
    const part = { from_s: from ?? undefined, to_s: to ?? undefined, points };
    const [samples, observer] = await Promise.all([this.ask("samples", { ...part, columns: this.columns }), this.observed(part)]);
    if (asked !== this.asked) return false;
    Object.assign(this, { samples, observer, part: { from, to }, points });
    this.note(samples);
    return true;
  }

  /** Which columns there are, and how long the run is. */
  async learn() {
    const names = await this.ask("samples", { points: 2 });
    this.end_s = Math.max(this.end_s, names.time_s?.at(-1) ?? 0);
    this.columns = WANTED.filter((name) => name in names || COUNTED.includes(name)).join(",");
    if (!names.time_s) this.columns = undefined; // nothing stored yet: asked again
  }

  /** What was stored since the last look; true where there is something new. */
  async news() {
    if (!this.samples.seq?.length || this.samples.seq.length > MOST_NEWS * this.points) return this.load(this.part ?? {}, this.points);
    const asked = this.asked;
    const after = (columns) => ({ after_seq: columns.seq?.at(-1) ?? -1, points: this.points, to_s: this.part.to ?? undefined });
    const [samples, observer] = await Promise.all([
      this.ask("samples", { ...after({ seq: [Math.max(this.seen, this.samples.seq.at(-1))] }), columns: this.columns }), this.observed(after(this.observer)),
    ]);
    if (asked !== this.asked || !samples.seq?.length) return false;
    append(this.samples, samples);
    append(this.observer, observer);
    this.note(samples);
    return true;
  }

  note(samples) {
    this.seen = samples.seq?.at(-1) ?? this.seen ?? -1;
    this.end_s = Math.max(this.end_s, samples.time_s?.at(-1) ?? 0);
  }

  async observed(part) {
    return this.run.model_id ? this.ask("observer", { ...part, columns: OBSERVED }) : {};
  }

  async ask(stream, part) {
    const answer = await api[stream](this.run.id, { ...part, damaged: this.damage ? "include" : undefined }).catch((error) => {
      if (error.code !== "damaged" || this.damage) throw error;
      this.damage = error.message;
      return api[stream](this.run.id, { ...part, damaged: "include" });
    });
    return answer?.columns ?? {};
  }
}

function append(columns, more) {
  for (const [name, values] of Object.entries(more)) columns[name] = [...(columns[name] ?? []), ...values];
}
