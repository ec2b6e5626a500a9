// Numbers with units, durations and times as a person reads them.
import { el } from "./dom.js";

export const MISSING = "–";
export const BAND = 1.96; // standard deviations on either side: 95 % of a normal distribution
const MINUS = "\u2212";
const THIN = "\u202f"; // narrow no-break space between a number and its unit, and between thousands

/** Fixed decimals with a true minus sign; a dash where there is no number. */
export function fixed(value, digits) {
  if (!Number.isFinite(value)) return MISSING;
  const text = Math.abs(value).toFixed(digits);
  return (value < 0 && Number(text) !== 0 ? MINUS : "") + text;
}

/** So many significant digits at the most, without trailing zeros and with a true minus sign. */
export function rounded(value, digits) {
  return String(Number(value.toPrecision(digits))).replace("-", MINUS);
}

export function quantity(value, digits, unit) {
  return Number.isFinite(value) ? `${fixed(value, digits)}${THIN}${unit}` : MISSING;
}

export function count(value) {
  if (!Number.isFinite(value)) return MISSING;
  return String(Math.round(value)).replace(/\B(?=(\d{3})+$)/g, THIN);
}

export function percent(fraction, digits = 1) {
  return quantity(fraction * 100, digits, "%");
}

/** A probability: none is ever certain, and what is a rival by its shape alone is not ruled out. */
export function confidence(share) {
  if (share < 0.005) return `below 1${THIN}%`;
  return share > 0.999 ? `above 99.9${THIN}%` : percent(share, 0);
}

/** Seconds as "12.3 s", "4 min 05 s", "2 h 03 min" or "3 d 4 h". */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return MISSING;
  if (seconds > 0 && seconds < 10) return `${seconds.toFixed(1)}${THIN}s`;
  const s = Math.round(seconds);
  if (s < 60) return `${s}${THIN}s`;
  const two = (n) => String(n).padStart(2, "0");
  if (s < 3600) return `${Math.floor(s / 60)}${THIN}min ${two(s % 60)}${THIN}s`;
  if (s < 86400) return `${Math.floor(s / 3600)}${THIN}h ${two(Math.floor((s % 3600) / 60))}${THIN}min`;
  return `${Math.floor(s / 86400)}${THIN}d ${Math.floor((s % 86400) / 3600)}${THIN}h`;
}

/** Seconds of test time as "12:30", or "3:05:00" from an hour on or where `hours` asks for it. */
export function clock(seconds, hours = false) {
  const sign = seconds < 0 ? MINUS : "";
  const s = Math.round(Math.abs(seconds));
  const two = (n) => String(n).padStart(2, "0");
  const h = Math.floor(s / 3600);
  const rest = `${two(Math.floor((s % 3600) / 60))}:${two(s % 60)}`;
  return sign + (h || hours ? `${h}:${rest}` : rest);
}

const TIME = new Intl.DateTimeFormat(undefined, { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" });
const DAY_TIME = new Intl.DateTimeFormat(undefined, {
  year: "numeric", month: "short", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23",
});
const MOMENT = new Intl.DateTimeFormat(undefined, { hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
const DAY_MOMENT = new Intl.DateTimeFormat(undefined, { weekday: "short", month: "short", day: "2-digit", hour: "2-digit", minute: "2-digit", hourCycle: "h23" });

/** A <time> element: local on the page, UTC on hover; of today the time alone, unless `dated`. Text without a zone is UTC: records are. */
export function timeElement(iso, dated = false) {
  if (!iso) return el("span", { text: MISSING });
  const date = new Date(/Z|[+-]\d\d:?\d\d$/.test(iso) ? iso : `${iso}Z`);
  if (Number.isNaN(date.getTime())) return el("span", { text: String(iso) });
  const today = !dated && date.toDateString() === new Date().toDateString();
  const utc = `${date.toISOString().replace("T", " ").slice(0, 19)} UTC`;
  return el("time", { datetime: date.toISOString(), title: utc, text: (today ? TIME : DAY_TIME).format(date) });
}

// Where a run that was brought in from a file stands in place of a bench.
export const IMPORTED = "import";

/** When a run began; of one that came from a file the service only knows when it was brought in. */
export function startElement(run) {
  const at = run.started_utc ?? run.created_utc;
  return run.bench === IMPORTED ? el("span", {}, "brought in ", timeElement(at, true)) : timeElement(at);
}

export function localTime(date) {
  return TIME.format(date);
}

/** A moment to come: the time of day, with the day where it is not today. */
export function localMoment(date) {
  const today = date.toDateString() === new Date().toDateString();
  return (today ? MOMENT : DAY_MOMENT).format(date);
}

/** What a current does to the cell; `restBelow_A` is what counts as none. */
export function currentWord(current_A, restBelow_A) {
  if (!Number.isFinite(current_A)) return "";
  if (Math.abs(current_A) <= restBelow_A) return "at rest";
  return current_A > 0 ? "charging" : "discharging";
}
