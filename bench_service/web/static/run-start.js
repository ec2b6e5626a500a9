// Starts a run of a stored profile: what it will do, how long it takes and what speaks against it is said before.
import { api } from "./api.js";
import { Chart, line, timeTicks } from "./charts.js";
import { el, setText } from "./dom.js";
import { clock, duration, fixed, localMoment, quantity } from "./format.js";

const PREVIEW_POINTS = 4000;
const DAY_S = 86400;

/** `started(run)` after the service took it. */
export function runStart(state, root, started) {
  const view = { profile: null, points: null, chart: null };
  const message = el("p", { class: "form-message", role: "alert" });
  const told = el("p", { class: "hint", id: "start-told", role: "status" });
  const wrong = el("ul", { class: "form-message", id: "start-wrong" });
  const profile = el("select", { id: "start-profile", name: "profile_id" });
  const file = el("input", { id: "start-file", type: "file", accept: ".csv,text/csv", class: "visually-hidden" });
  const dt = input("dt_s", "number", 1, { min: 0.001, max: 3600, step: "any", required: true });
  const soc = input("initial_soc", "number", "", { min: 0, max: 100, step: "any", required: true });
  const name = input("name", "text", "", { maxlength: 200 });
  const operator = input("operator", "text", "", { maxlength: 200 });
  const model = el("select", { id: "start-model", name: "model_id" }, el("option", { value: "", text: "none, charge is counted" }));
  const submit = el("button", { class: "primary", type: "submit", id: "start-submit", text: "Start run" });
  const preview = el("div", { class: "plot run-preview", role: "img", "aria-label": "Current of the profile and counted state of charge over test time", hidden: true });
  const form = el("form", { novalidate: true, "aria-label": "Start a run" },
    el("div", { class: "fields" }, field("Profile", profile), el("div", { class: "field" }, el("span", { class: "about", text: "or a CSV file with time_s,current_A" }), file, el("label", { class: "file-button", for: "start-file", text: "Upload a profile" })),
      field("Sample period / s", dt), field("SoC now / %", soc), field("Live observer", model), field("Run name", name), field("Operator", operator)),
    preview, told, wrong, el("div", { class: "form-end" }, submit, message));
  const details = el("details", { class: "run-start", id: "start-details" }, el("summary", { text: "Start a run of a stored profile" }), form);
  root.replaceChildren(details);

  const bench = () => state.bench;
  const check = () => {
    const found = bench();
    const profile_ = view.profile;
    setText(told, found && profile_ ? words(found, profile_) : "");
    const against = found && profile_ && view.points ? objections(found, profile_, view.points, soc.valueAsNumber / 100) : [];
    wrong.replaceChildren(...against.map((text) => el("li", { text })));
    submit.disabled = !profile_ || !found || found.state !== "idle";
    submit.title = found && found.state !== "idle" ? `${found.name} is ${found.state}` : "";
    drawPreview(view, preview, found, soc.valueAsNumber / 100);
  };
  const choose = async () => {
    Object.assign(view, { profile: null, points: null });
    message.textContent = "";
    if (profile.value) {
      const asked = profile.value;
      const got = await api.profile(asked, true).catch((error) => { message.textContent = error.message; return null; });
      if (profile.value !== asked) return;
      if (got) Object.assign(view, { profile: got, points: { time_s: got.time_s, current_A: got.current_A } });
    }
    check();
  };
  const list = async (chosen) => {
    const [profiles, models] = await Promise.all([api.profiles().catch(() => []), api.models().catch(() => [])]);
    profile.replaceChildren(...profiles.map((each) => el("option", { value: each.id, text: `${each.name}, ${duration(each.duration_s)}`, selected: each.id === chosen })));
    model.replaceChildren(model.firstElementChild, ...models.map((each) => el("option", { value: each.id, text: `${each.name} (${each.structure})` })));
    if (!profiles.length) profile.append(el("option", { value: "", text: "no profile is stored yet" }));
    await choose();
  };
  details.addEventListener("toggle", () => { if (details.open) { list(profile.value); believe(bench(), soc).then(check); } });
  profile.addEventListener("change", choose);
  form.addEventListener("input", check);
  file.addEventListener("change", async () => {
    const [chosen] = file.files;
    file.value = "";
    if (!chosen) return;
    message.textContent = "";
    try {
      await list((await api.addProfile(await chosen.text(), chosen.name.replace(/\.csv$/i, "") || "profile")).id);
    } catch (error) {
      message.textContent = error.message;
    }
  });
  state.on("benches", check);
  state.on("select", () => { if (details.open) believe(bench(), soc).then(check); });
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    message.textContent = "";
    const missing = [dt, soc].find((control) => !control.checkValidity());
    if (missing) { message.textContent = `${missing === dt ? "Sample period" : "SoC now"}: ${missing.validationMessage}`; missing.focus(); return; }
    submit.disabled = true;
    try {
      const order = { bench: bench().name, profile_id: view.profile.id, dt_s: dt.valueAsNumber, initial_soc: soc.valueAsNumber / 100, name: name.value.trim() || undefined, model_id: model.value || undefined };
      const run = await api.startRun(order);
      if (operator.value.trim()) await api.describeRun(run.id, { operator: operator.value.trim() }).catch((error) => { message.textContent = error.message; });
      details.open = false;
      started(run);
    } catch (error) {
      message.textContent = error.message;
    }
    check();
  });
}

function input(name, type, value, more) {
  return el("input", { id: `start-${name}`, name, type, value, autocomplete: "off", ...more });
}

function field(title, control) {
  return el("div", { class: "field" }, el("label", { for: control.id, text: title }), control);
}

/** Where the cell stands as far as its last run tells. */
async function believe(bench, soc) {
  if (!bench || soc.value) return;
  const [run] = await api.runs({ bench: bench.name, limit: 1 }).catch(() => []);
  if (!run) return;
  const counted = await api.samples(run.id, { points: 2, columns: "charge_Ah" }).then(({ columns }) => columns.charge_Ah?.at(-1) ?? NaN, () => NaN);
  const now = run.initial_soc + counted / run.capacity_Ah;
  if (Number.isFinite(now) && !soc.value) soc.value = String(Math.round(1000 * Math.min(1, Math.max(0, now))) / 10);
}

function words(bench, { duration_s: length_s, charge_Ah: [net_Ah], n_points: n }) {
  const charge = `${n} rows, ${quantity(net_Ah, 3, "Ah")} net`;
  if (bench.lock_step) return `${duration(length_s)} of test time (${fixed(length_s / 3600, 2)} h), in lock-step as fast as the machine can. ${charge}.`;
  const done = localMoment(new Date(Date.now() + 1000 * length_s));
  const hours = length_s > DAY_S ? `${duration(length_s)}, ${fixed(length_s / 3600, 1)} h` : `${fixed(length_s / 3600, 2)} h (${duration(length_s)})`;
  return `Takes ${hours} of real time: started now, it is done at ${done}. ${charge}.`;
}

/** What the service would refuse, said while one still types. */
function objections({ limits = {}, capacity_Ah }, profile, { current_A: currents }, initial) {
  const found = [];
  const [low_A, high_A] = limits.current_A ?? [-Infinity, Infinity];
  const [least_A, most_A] = [Math.min, Math.max].map((pick) => currents.reduce((a, b) => pick(a, b)));
  if (least_A < low_A || most_A > high_A) found.push(`Current ${fixed(least_A, 2)} … ${fixed(most_A, 2)} A leaves the bench's limits ${fixed(low_A, 2)} … ${fixed(high_A, 2)} A.`);
  const [low, high] = limits.soc ?? [0, 1];
  const ends = profile.charge_Ah.slice(1).map((charge_Ah) => initial + charge_Ah / capacity_Ah);
  if (Number.isFinite(initial) && (ends[0] < low - 1e-9 || ends[1] > high + 1e-9)) {
    found.push(`Counted state of charge ${fixed(100 * ends[0], 1)} … ${fixed(100 * ends[1], 1)} % leaves the bench's limits ${fixed(100 * low, 0)} … ${fixed(100 * high, 0)} %.`);
  }
  if (Number.isFinite(limits.duration_s) && profile.duration_s > limits.duration_s) found.push(`${duration(profile.duration_s)} is longer than the bench allows, ${duration(limits.duration_s)}.`);
  return found;
}

function drawPreview(view, node, bench, initial) {
  node.hidden = !view.points;
  if (!view.points) return;
  view.option = (colours) => previewOption(colours, view.points, bench, initial);
  if (view.chart) view.chart.redraw();
  else view.chart = new Chart(node, (colours) => view.option(colours));
}

function previewOption(colours, { time_s, current_A }, bench, initial) {
  const text = { color: colours["ink-2"], fontSize: 12 };
  const end = time_s.at(-1);
  const customValues = timeTicks(0, end);
  let charge_As = 0;
  const soc = time_s.map((t, k) => {
    if (k) charge_As += current_A[k - 1] * (t - time_s[k - 1]);
    return [t, 100 * (initial + charge_As / 3600 / (bench?.capacity_Ah ?? NaN))];
  });
  const axis = (name, position) => ({ type: "value", scale: true, splitNumber: 3, position, name, nameTextStyle: { color: colours.ink, fontSize: 12, align: position }, axisLabel: text, axisLine: { lineStyle: { color: colours.line } }, splitLine: { show: position === "left", lineStyle: { color: colours.line, opacity: 0.5 } } });
  const known = soc.every(([, value]) => Number.isFinite(value));
  return {
    textStyle: { fontFamily: colours.font }, grid: { left: 56, right: 56, top: 28, bottom: 42 },
    xAxis: { type: "value", min: 0, max: end, name: `test time / ${end >= 3600 ? "h:min:s" : "min:s"}`, nameLocation: "middle", nameGap: 22, nameTextStyle: text, splitLine: { show: false }, axisLine: { onZero: false, lineStyle: { color: colours.line } }, axisTick: { customValues }, axisLabel: { ...text, customValues, formatter: (value) => clock(value, end >= 3600), hideOverlap: true } },
    yAxis: [axis("Current / A", "left"), { ...axis("SoC / %", "right"), show: known }],
    series: [
      { ...line("Current", colours.current, 0, thinned(time_s.map((t, k) => [t, current_A[k]]))), step: "end", yAxisIndex: 0 },
      { ...line("SoC", colours.soc, 0, known ? thinned(soc) : []), yAxisIndex: 1, lineStyle: { width: 1.6, color: colours.soc, type: [6, 3] } },
    ],
  };
}

/** A long profile is drawn of each so-many-th row and the row before it: a sketch, not data. */
function thinned(rows) {
  const every = Math.ceil((2 * rows.length) / PREVIEW_POINTS);
  return every < 2 ? rows : rows.filter((_, k) => k % every === 0 || k % every === every - 1 || k === rows.length - 1);
}
