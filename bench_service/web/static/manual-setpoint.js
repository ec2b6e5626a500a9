// One current for some minutes, started by hand: a protocol of one step, so that every limit and STOP are those of any run.
import { el } from "./dom.js";
import { fixed } from "./format.js";
import { typed } from "./protocol-model.js";

const MOST_MIN = 60;

/** Fields as those of a standard test; `document()` is the protocol. */
export function manualFields(bench) {
  const [low_A, high_A] = bench?.limits?.current_A ?? [NaN, NaN];
  const current = el("input", { id: "manual-current", inputmode: "decimal", autocomplete: "off" });
  const minutes = el("input", { id: "manual-minutes", inputmode: "decimal", autocomplete: "off", value: "5" });
  const field = (title, input) => el("div", { class: "field" }, el("label", { for: input.id, text: title }), input);
  const values = () => [typed(current.value), typed(minutes.value)];
  const wrong = () => {
    const [current_A, for_min] = values();
    const found = [];
    if (typeof current_A !== "number" || current_A === 0) found.push("Type a current: positive charges, negative discharges.");
    else if (current_A < low_A || current_A > high_A) found.push(`${fixed(current_A, 3)} A leaves the bench's limits ${fixed(low_A, 2)} … ${fixed(high_A, 2)} A.`);
    if (!(for_min > 0 && for_min <= MOST_MIN)) found.push(`Type for how many minutes, ${MOST_MIN} at most.`);
    return found;
  };
  const document = () => {
    const [current_A, for_min] = values();
    const step = { step: "constant_current", name: "manual", current_A, until: { time_s: typeof for_min === "number" ? 60 * for_min : for_min } };
    return { schema: "bench-protocol-1", name: `Manual ${fixed(current_A, 3)} A`, steps: [step] };
  };
  const limits = Number.isFinite(low_A) ? `, ${fixed(low_A, 2)} … ${fixed(high_A, 2)}` : "";
  return { nodes: [field(`Current / A${limits}`, current), field(`For at most / min, up to ${MOST_MIN}`, minutes)], values, wrong, document };
}

export const MANUAL_ABOUT = "Stay at the bench. The current flows until the time is over, somebody stops it, or a limit of the bench is reached; then the output goes off.";
