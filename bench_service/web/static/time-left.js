// How long a run still takes, and when it ends by the clock on the wall.
import { api } from "./api.js";
import { duration, localMoment } from "./format.js";

const SEEN_S = 4; // of wall time before the pace that was seen is believed

export class TimeLeft {
  #runId = null;
  #length_s = NaN;
  #first = null;
  #only_s = NaN; // how long the only step of a protocol lasts

  /** "2 h 10 min left, done at 18:32", or what is known of it. */
  words(bench) {
    const { live, run_id: runId } = bench;
    if (!runId) return "";
    if (runId !== this.#runId) this.#begin(runId);
    if (bench.state === "paused") {
      this.#first = null; // the wait is no pace
      return "Held: the profile waits, the finish moves with it.";
    }
    if (Number.isFinite(this.#only_s) && live?.run_id === runId && Number.isFinite(live.step_time_s) && !bench.lock_step) return left(this.#only_s - live.step_time_s);
    const share = live?.run_id === runId ? live.progress : NaN;
    if (!Number.isFinite(share)) return "";
    const now_s = performance.now() / 1000;
    this.#first ??= { share, at_s: now_s };
    const left_s = this.#left(bench, share, now_s);
    if (!Number.isFinite(left_s)) return "";
    return left(left_s);
  }

  #begin(runId) {
    this.#runId = runId;
    this.#length_s = NaN;
    this.#first = null;
    this.#only_s = NaN;
    this.#learn(runId).catch(() => {});
  }

  /** How long a protocol takes nobody knows before, but where it is one step that ends by its time: the pace that is seen has to do. */
  async #learn(runId) {
    const { profile_id: profileId, protocol_id: protocolId } = await api.run(runId);
    const length_s = profileId ? (await api.profile(profileId)).duration_s : NaN;
    const only_s = protocolId ? onlyTime((await api.protocol(protocolId)).document) : NaN;
    if (runId === this.#runId) [this.#length_s, this.#only_s] = [length_s, only_s];
  }

  /** By the pace that was seen, for benches that are not paced by the wall; before that by the length of the profile. */
  #left(bench, share, now_s) {
    const seen_s = now_s - this.#first.at_s;
    const played = share - this.#first.share;
    if (seen_s >= SEEN_S && played > 0) return ((1 - share) * seen_s) / played;
    return bench.lock_step ? NaN : (1 - share) * this.#length_s;
  }
}

const left = (left_s) => `${duration(Math.max(0, left_s))} left, done at ${localMoment(new Date(Date.now() + 1000 * left_s))}`;

function onlyTime({ steps }) {
  const until = steps.length === 1 && !steps[0].steps ? Object.entries(steps[0].until ?? {}) : [];
  return until.length === 1 && until[0][0] === "time_s" && typeof until[0][1] === "number" ? until[0][1] : NaN;
}
