// What can be drawn of a run: each signal once, with its unit, colour and how it is got from what was loaded.
import { BAND } from "./format.js";

const percent = (values) => values?.map((value) => (Number.isFinite(value) ? 100 * value : null));
const product = (a, b) => a?.map((value, k) => (Number.isFinite(value) && Number.isFinite(b?.[k]) ? value * b[k] : null));

const counted = ({ run, samples }) => samples.charge_Ah?.map((charge_Ah) => 100 * (run.initial_soc + charge_Ah / run.capacity_Ah));

/** `hold` "start": a sample stands for the interval that ends with it; "end": it holds until the next. */
export const SIGNALS = [
  sampled("voltage", "Voltage", "V", 4, "voltage", (s) => s.voltage_V),
  sampled("current", "Current", "A", 3, "current", (s) => s.current_A, "start"),
  sampled("setpoint", "Set-point", "A", 3, "neutral", (s) => s.setpoint_A, "end"),
  sampled("temperature", "Temperature", "°C", 2, "temperature", (s) => s.temperature_degC),
  sampled("ambient", "Ambient", "°C", 2, "good", (s) => s.ambient_degC),
  { key: "soc", title: "SoC", unit: "%", digits: 1, colour: "soc", of: soc },
  { key: "counted", title: "SoC, counted", unit: "%", digits: 1, colour: "neutral", of: (data) => ({ time_s: data.samples.time_s, values: counted(data) }) },
  sampled("power", "Power", "W", 2, "residual", (s) => product(s.current_A, s.voltage_V), "start"),
  sampled("charge", "Charge", "Ah", 4, "current", (s) => s.charge_Ah),
  sampled("energy", "Energy", "Wh", 3, "residual", (s) => s.energy_Wh),
  { key: "innovation", title: "Observer's innovation", unit: "mV", digits: 2, colour: "residual",
    of: ({ observer }) => ({ time_s: observer.time_s, values: observer.innovation_V?.map((v) => (Number.isFinite(v) ? 1000 * v : null)) }) },
  { key: "residual", title: "Model error", unit: "mV", digits: 2, colour: "residual",
    of: ({ compared }) => ({ time_s: compared?.time_s, values: compared?.residual_mV }) },
  sampled("step", "Step", "", 0, "ink", (s) => numbered(s.step_count), "end"),
  sampled("cycle", "Cycle", "", 0, "ink", (s) => numbered(s.cycle_count), "end"),
];

/** A run of a profile has no steps: all its numbers are 0. */
function numbered(counts) {
  return counts?.some((count) => count > 0) ? counts : undefined;
}

const BY_KEY = new Map(SIGNALS.map((signal) => [signal.key, signal]));
export const signalOf = (key) => BY_KEY.get(key) ?? null;

/** Signals that at least one of the runs has anything of. */
export function offered(runs) {
  return SIGNALS.filter((signal) => runs.some((data) => signal.of(data).values?.some(Number.isFinite)));
}

function sampled(key, title, unit, digits, colour, pick, hold) {
  return { key, title, unit, digits, colour, hold, of: ({ samples }) => ({ time_s: samples.time_s, values: pick(samples) }) };
}

/** The observer's, with its 95 % band; where none ran, the counted one. */
function soc(data) {
  const { observer } = data;
  if (!observer.time_s?.length) return { time_s: data.samples.time_s, values: counted(data), note: "counted" };
  const half = observer.soc_std?.map((std) => (Number.isFinite(std) ? 100 * BAND * std : null));
  return { time_s: observer.time_s, values: percent(observer.soc), half };
}

/** Charge counted at times of another stream, for drawing it over charge. */
export function chargeAt({ samples }, times) {
  let k = 0;
  return times?.map((t) => {
    while (k + 1 < samples.time_s.length && samples.time_s[k + 1] <= t) k += 1;
    return samples.charge_Ah[k];
  });
}

const GAP = 64;
const SUSPECT = 128;
const PAUSED = 256;

/** Stretches in which ticks were missed, the run was held, or samples are suspect. */
export function stretches({ samples: { time_s, flags } }) {
  const found = [];
  let open = null;
  (flags ?? []).forEach((flag, k) => {
    if (flag & GAP && k > 0) found.push({ from: time_s[k - 1], to: time_s[k], kind: "gap" });
    const kind = flag & PAUSED ? "paused" : flag & SUSPECT ? "suspect" : null;
    if (open && kind === open.kind) open.to = time_s[k];
    else open = kind ? { from: time_s[Math.max(0, k - 1)], to: time_s[k], kind } : null;
    if (open && !found.includes(open)) found.push(open);
  });
  return found;
}
