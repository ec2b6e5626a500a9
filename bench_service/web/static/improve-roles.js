// What each run is used for: as somebody has said, else as usual.

/** The roles of the table, and what they are called in it. */
export const ROLES = [["", "not used"], ["judge", "look at it"], ["train", "learn from it"]];

const beganAt = (run) => Date.parse(run.started_utc ?? run.created_utc);

export function ownRuns(view) {
  return (view.models.find((model) => model.id === view.modelId)?.train ?? []).map((run) => run.run_id);
}

/** Runs by what they are used for. */
export function usedRuns(view) {
  const known = view.runs.filter((run) => view.roles.get(run.id)).map((run) => run.id);
  const own = new Set(ownRuns(view));
  const judge = known.filter((id) => view.roles.get(id) === "judge");
  const train = known.filter((id) => view.roles.get(id) === "train");
  // A change is looked for in every new run, also in those that the model is refitted to later.
  const looked = view.mode === "change" ? [...judge, ...train.filter((id) => !own.has(id))] : judge;
  return { judge, train, looked };
}

export function rolesOf(view) {
  const model = view.models.find((each) => each.id === view.modelId);
  return new Map([...(model ? proposed(view, model) : first(view)), ...view.said]);
}

/** Where nothing is known of a cell, one that has the same capacity on the same bench is taken for it. */
function sameCell(a, b) {
  return a.cell_id || b.cell_id ? a.cell_id === b.cell_id : a.bench === b.bench && a.capacity_Ah === b.capacity_Ah;
}

/** No model yet: of the newest run's cell the first run is learned from, the others judge. */
function first(view) {
  const newestFirst = [...view.runs].sort((a, b) => beganAt(b) - beganAt(a));
  const mates = newestFirst.filter((run) => sameCell(run, newestFirst[0]));
  const oldest = mates.at(-1);
  return view.runs.map((run) => [run.id, run === oldest ? "train" : mates.includes(run) ? "judge" : ""]);
}

/** What a model's runs are used for: what it was made from, what judged it, and for a change what came after both. */
function proposed(view, model) {
  const [own, judged] = [new Set(ownRuns(view)), new Set((model.validate ?? []).map((run) => run.run_id))];
  const mine = view.runs.filter((run) => own.has(run.id));
  const made = Math.max(...mine.map(beganAt), -Infinity);
  const campaign = model.campaign_id;
  const later = view.mode !== "change" ? [] : view.runs.filter((run) => !own.has(run.id) && !judged.has(run.id) && !(campaign && run.campaign_id === campaign)
    && beganAt(run) > made && mine.some((each) => sameCell(each, run)));
  const mates = (run) => (judged.size ? judged.has(run.id) : campaign && run.campaign_id === campaign);
  return view.runs.map((run) => {
    if (own.has(run.id)) return [run.id, view.mode === "structure" ? "train" : ""];
    return [run.id, (later.length ? later.includes(run) : mates(run)) ? "judge" : ""];
  });
}
