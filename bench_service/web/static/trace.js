// The live traces of a bench: what was stored of the run so far, then what the feed brings.
import { api } from "./api.js";

const MAX_POINTS = 4000;
const FILL_POINTS = 3000;

function thin(points) {
  // Halve the older half: the newest part keeps its full resolution.
  const half = points.length >> 1;
  return points.filter((_, index) => index >= half || index % 2 === 0);
}

export class Trace {
  constructor(bench) {
    this.bench = bench;
    this.clear(null);
  }

  clear(runId) {
    this.runId = runId;
    this.run = null; // the stored record, once asked for
    this.points = []; // {t, v, i, soc, std}
    this.filled = false;
  }

  /** Add a live reading; readings between runs carry no run and leave the last run's traces standing. */
  push(live) {
    if (!live.run_id || !Number.isFinite(live.time_s)) return false;
    if (live.run_id !== this.runId) this.clear(live.run_id);
    const last = this.points.at(-1);
    if (last && live.time_s <= last.t) return false;
    this.points.push({ t: live.time_s, v: live.voltage_V, i: live.current_A, soc: live.soc, std: live.soc_std });
    if (this.points.length > MAX_POINTS) this.points = thin(this.points);
    return true;
  }

  /** Fetch what is stored of the bench's present run, or of its last one. */
  async fill(runId) {
    const run = runId ? await api.run(runId) : (await api.runs({ bench: this.bench, limit: 1 }))[0];
    if (!run) return;
    const [samples, observer] = await Promise.all([
      api.samples(run.id, FILL_POINTS),
      api.observer(run.id, FILL_POINTS).catch(() => null), // a run without an observer has no such stream
    ]);
    if (this.runId !== run.id) {
      if (this.points.length && !runId) return; // a run began while we asked for the last one
      this.clear(run.id);
    }
    this.run = run;
    this.filled = true;
    const stored = merge(samples?.columns ?? {}, observer?.columns?.time_s?.length ? observer.columns : counted(this.points));
    const end = stored.at(-1)?.t ?? -Infinity;
    this.points = [...stored, ...this.points.filter((point) => point.t > end)];
  }
}

/** Where no observer ran, the charge count of the live readings is the only SoC there is. */
function counted(points) {
  const known = points.filter((point) => Number.isFinite(point.soc));
  return { time_s: known.map((point) => point.t), soc: known.map((point) => point.soc) };
}

function merge(samples, observer) {
  const points = (samples.time_s ?? []).map((t, k) => ({ t, v: samples.voltage_V?.[k], i: samples.current_A?.[k] }));
  const times = observer.time_s ?? [];
  let k = 0;
  for (const point of points) {
    while (k + 1 < times.length && times[k + 1] <= point.t) k += 1;
    if (!times.length || times[k] > point.t) continue;
    const share = k + 1 < times.length ? (point.t - times[k]) / (times[k + 1] - times[k]) : 0;
    point.soc = between(observer.soc, k, share);
    point.std = between(observer.soc_std, k, share);
  }
  return points;
}

function between(values, k, share) {
  return share > 0 ? values?.[k] + share * (values?.[k + 1] - values?.[k]) : values?.[k];
}
