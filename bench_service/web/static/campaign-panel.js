// The campaign shown: its stages, its progress, and what it came to.
import { api } from "./api.js";
import { campaignForm } from "./campaign-form.js";
import { campaignResult } from "./campaign-result.js";
import { chip, el, renderKeyed, setText } from "./dom.js";
import { MISSING, duration, localMoment, percent, quantity, timeElement } from "./format.js";
import { stageTitle, wordFor } from "./words.js";

export function campaignPanel(state) {
  const body = document.getElementById("campaign-body");
  const tools = document.getElementById("campaign-tools");
  const view = { form: false, message: "" };
  let parts = null;
  const showResult = campaignResult(state, document.getElementById("campaign-result"));
  const draw = () => {
    if (!state.loaded) return;
    const campaign = view.form ? null : state.campaign;
    drawTools(state, tools, view, draw);
    if (campaign) {
      if (parts?.id !== campaign.id) parts = buildProgress(campaign, view, draw);
      renderKeyed(body, `campaign ${campaign.id}`, () => parts.nodes);
      drawProgress(parts, campaign, view);
    } else {
      drawForm(state, body, view, draw);
    }
    showResult(campaign);
  };
  state.on("campaigns benches-listed", draw);
  state.on("select", () => chooseBench(state.selected));
}

function drawForm(state, body, view, draw) {
  if (!state.benches.size) {
    renderKeyed(body, "no bench", () => el("p", { class: "empty", text: "A campaign needs a bench." }));
    return;
  }
  // Built once per list of benches: a frame of the feed must not wipe what somebody is typing.
  renderKeyed(body, `form ${[...state.benches.keys()].join(" ")}`, () => {
    const form = campaignForm(state, (campaign) => {
      Object.assign(view, { form: false, message: "" });
      state.shownCampaign = campaign?.id ?? null;
      if (campaign) state.mergeCampaign(campaign);
      draw();
    });
    // Nor must the first campaign of somebody else.
    form.addEventListener("input", () => { view.form = true; });
    return form;
  });
}

/** Who looks at another bench means that one. */
function chooseBench(name) {
  const chooser = document.getElementById("campaign-bench");
  if (!chooser) return;
  chooser.value = name;
  chooser.dispatchEvent(new Event("change", { bubbles: true })); // the form tells the length anew
}

function drawTools(state, tools, view, draw) {
  const campaigns = state.campaignsNewestFirst;
  const shown = view.form ? "new" : state.campaign?.id;
  renderKeyed(tools, JSON.stringify([shown, campaigns.map(({ id, name, state: is }) => [id, name, is])]), () => {
    if (!campaigns.length) return [];
    const choose = el("select", { id: "campaign-choose", "aria-label": "Campaign shown", on: { change: () => {
      view.form = choose.value === "new";
      state.shownCampaign = view.form ? state.shownCampaign : choose.value;
      draw();
    } } },
    campaigns.map(({ id, name, state: is }) => el("option", { value: id, text: `${name} (${wordFor("campaign", is)[1]})`, selected: id === shown })),
    el("option", { value: "new", text: "New campaign …", selected: view.form }));
    const fresh = el("button", { id: "campaign-new", type: "button", text: view.form ? "Back" : "New campaign", on: { click: () => { view.form = !view.form; draw(); } } });
    return [choose, fresh];
  });
}

/** Built once per campaign and then only changed: news come several times a second, and a button must stay a button. */
function buildProgress(campaign, view, draw) {
  const parts = {
    id: campaign.id, chip: el("span"), bar: el("progress", { max: 1, "aria-label": "Progress of the campaign" }), share: el("span", { class: "number" }),
    message: el("p", { class: "campaign-message" }), answer: el("p", { class: "form-message", role: "alert" }), stages: el("ol", { class: "stages", "aria-label": "Stages" }),
    said: el("p", { class: "visually-hidden", role: "status" }),
    stop: el("button", { id: "campaign-stop", class: "danger", type: "button", text: "Stop campaign", on: { click: () => stopCampaign(campaign.id, view, draw) } }),
  };
  parts.barBox = el("div", { class: "campaign-bar" }, parts.bar, parts.share);
  parts.nodes = [
    el("div", { class: "campaign-head" }, el("strong", { text: campaign.name }), parts.chip,
      el("span", { class: "about" }, facts(campaign), " · started ", timeElement(campaign.created_utc)), parts.stop),
    parts.barBox, parts.message, parts.answer, parts.stages, parts.said,
  ];
  return parts;
}

function facts({ bench, request = {} }) {
  return [["bench", bench], ["seed", request.seed], ["sample period", quantity(request.dt_s, request.dt_s < 1 ? 2 : 0, "s")],
    ["duration per run", duration(request.duration_s)], ["model", request.structure],
    ["without", request.without?.join(", ") || null]]
    .filter(([, value]) => value !== null && value !== undefined && value !== MISSING).map(([name, value]) => `${name} ${value}`).join(" · ");
}

function drawProgress(parts, campaign, view) {
  const [tone, word] = wordFor("campaign", campaign.state);
  renderKeyed(parts.chip, word, () => chip(tone, word));
  parts.bar.value = campaign.progress ?? 0;
  parts.barBox.dataset.tone = tone;
  setText(parts.share, percent(campaign.progress ?? 0, 0));
  setText(parts.message, campaign.state === "completed" ? "" : [campaign.message, finish(campaign)].filter(Boolean).join(" · "));
  parts.message.dataset.tone = campaign.state === "failed" ? "bad" : "";
  setText(parts.answer, view.message);
  parts.stop.hidden = campaign.state !== "running";
  const rows = campaign.stages ?? [];
  setText(parts.said, `Campaign ${word}, stage ${stageTitle(campaign.stage)}`);
  renderKeyed(parts.stages, JSON.stringify(rows), () => rows.map(stage));
}

/** What the service says of the end of a campaign that runs. */
function finish({ state: is, time_left_s: left_s, finish_utc: end }) {
  if (is !== "running" || !end || !Number.isFinite(left_s)) return "";
  return `its runs take ${duration(left_s)} more, done about ${localMoment(new Date(end))}`;
}

function stage({ name, state, detail, seconds }) {
  const [tone, word] = wordFor("stage", state);
  return el("li", { class: "stage", data: { tone, stage: name }, "aria-current": state === "running" ? "step" : null },
    el("span", { class: "stage-name", text: stageTitle(name) }),
    el("span", { class: "stage-state" }, chip(tone, word), Number.isFinite(seconds) ? el("span", { class: "about", text: duration(seconds) }) : null),
    detail ? el("span", { class: "stage-detail", text: detail }) : null);
}

async function stopCampaign(campaignId, view, draw) {
  view.message = "Stop sent …";
  draw();
  try {
    await api.stopCampaign(campaignId);
    view.message = "";
  } catch (error) {
    view.message = `Stop: ${error.message}`;
  }
  draw();
}
