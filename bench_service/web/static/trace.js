// The live traces of a bench: what is stored of its run, then only what is new, then what the feed brings before it is stored.
import { api } from "./api.js";

const FILL_POINTS = 2000;
const MOST_POINTS = 8000; // beyond it everything anew, thinned by the service: its extremes and steps stay
const COLUMNS = "seq,time_s,voltage_V,current_A,charge_Ah";

export class Trace {
  constructor(bench) {
    this.bench = bench;
    this.window_s = Infinity;
    this.clear(null);
  }

  clear(runId) {
    this.runId = runId;
    this.run = null; // the stored record, once asked for
    this.points = []; // {t, v, i, soc, std}
    this.seq = this.observerSeq = -1; // the last stored row that is in `points`
    this.observed = { time_s: [], soc: [], soc_std: [] };
  }

  /** Add a live reading; readings between runs carry no run and leave the last run's traces standing. */
  push(live) {
    if (!live.run_id || !Number.isFinite(live.time_s)) return false;
    if (live.run_id !== this.runId) this.clear(live.run_id);
    const last = this.points.at(-1);
    if (last && live.time_s <= last.t) return false;
    this.points.push({ t: live.time_s, v: live.voltage_V, i: live.current_A, soc: live.soc, std: live.soc_std });
    return true;
  }

  /** Another window: what was thinned for the whole run is too coarse for its last minutes. */
  async show(window_s) {
    this.window_s = window_s;
    if (this.runId) await this.fill(this.runId, { anew: true });
  }

  /** Fetch what is stored of the bench's present run, or of its last one: all of it once, then what is new. */
  async fill(runId, { anew = false } = {}) {
    const fresh = anew || this.seq < 0 || (runId && runId !== this.runId) || this.points.length > MOST_POINTS;
    if (!fresh && runId) return this.goOn();
    const run = runId ? await api.run(runId) : (await api.runs({ bench: this.bench, limit: 1 }))[0];
    if (!run) return undefined;
    const parts = [await api.samples(run.id, { points: FILL_POINTS, columns: COLUMNS })];
    const end = parts[0].columns.time_s?.at(-1);
    if (parts[0].decimated && Number.isFinite(this.window_s)) {
      parts.push(await api.samples(run.id, { from_s: Math.max(0, end - this.window_s), points: FILL_POINTS, columns: COLUMNS }));
    }
    const observer = run.model_id ? await observed(run.id, { points: FILL_POINTS }) : null;
    if (this.runId !== run.id) {
      if (this.points.length && !runId) return undefined; // a run began while we asked for the last one
      this.clear(run.id);
    }
    this.run = run;
    this.observed = observer ?? this.observed;
    this.observerSeq = observer?.seq?.at(-1) ?? -1;
    this.seq = parts[0].columns.seq?.at(-1) ?? -1;
    const [whole, detail = []] = parts.map(({ columns }) => this.points_of(columns));
    const stored = [...whole.filter((point) => !detail.length || point.t < detail[0].t), ...detail];
    this.join(stored);
    return undefined;
  }

  /** What has been stored since the last look. */
  async goOn() {
    const runId = this.runId;
    const [{ columns }, observer] = await Promise.all([
      api.samples(runId, { after_seq: this.seq, points: FILL_POINTS, columns: COLUMNS }),
      this.run.model_id ? observed(runId, { after_seq: this.observerSeq, points: FILL_POINTS }) : null,
    ]);
    if (runId !== this.runId || !columns.seq?.length || columns.seq[0] <= this.seq) return;
    for (const name of Object.keys(this.observed)) this.observed[name].push(...(observer?.[name] ?? []));
    this.observerSeq = observer?.seq?.at(-1) ?? this.observerSeq;
    this.seq = columns.seq.at(-1);
    const added = this.points_of(columns);
    // A reading of the feed that is stored by now gives way to what is stored.
    this.points = this.points.filter((point) => point.stored || point.t > added.at(-1).t);
    const live = this.points.filter((point) => !point.stored);
    this.points = [...this.points.filter((point) => point.stored), ...added, ...live];
  }

  join(stored) {
    const end = stored.at(-1)?.t ?? -Infinity;
    this.points = [...stored, ...this.points.filter((point) => point.t > end)];
  }

  /** Stored rows; where no observer runs, the charge that was counted is the only SoC there is. */
  points_of(columns) {
    const { run } = this;
    const points = (columns.time_s ?? []).map((t, k) => ({ t, v: columns.voltage_V[k], i: columns.current_A[k], stored: true,
      soc: run.initial_soc + columns.charge_Ah[k] / run.capacity_Ah }));
    if (this.observed.time_s.length) addObserved(points, this.observed);
    return points;
  }
}

async function observed(runId, part) {
  const columns = await api.observer(runId, { ...part, columns: "seq,time_s,soc,soc_std" }).then((found) => found.columns, () => null);
  return columns?.time_s?.length ? columns : null; // a run without an observer has no such stream
}

function addObserved(points, { time_s: times, soc, soc_std: std }) {
  let k = 0;
  for (const point of points) {
    while (k + 1 < times.length && times[k + 1] <= point.t) k += 1;
    if (times[k] > point.t) continue;
    const share = k + 1 < times.length ? (point.t - times[k]) / (times[k + 1] - times[k]) : 0;
    point.soc = between(soc, k, share);
    point.std = between(std, k, share);
  }
}

function between(values, k, share) {
  return share > 0 ? values[k] + share * (values[k + 1] - values[k]) : values[k];
}
