// What the page knows. Views subscribe to a topic; only main.js and actions.js write.

const MAX_EVENTS = 100;
const TROUBLE = ["fault", "offline"];
const MOVES = ["running", "paused", "stopping"];

export class State {
  #listeners = new Map();

  constructor() {
    this.link = { state: "connecting", retryAt: null };
    this.everConnected = false;
    this.failed = false; // the last attempt to connect failed
    this.loaded = false; // the first answers are in: an empty list is then really empty
    this.health = null; // last /healthz answer, null before the first and while none comes
    this.lastHeard = null; // ms since epoch of the last frame or answer
    this.benches = new Map();
    this.heard = new Map(); // bench -> ms since epoch of its last reading
    this.answers = new Map(); // bench -> what came of the last command
    this.selected = null;
    this.campaigns = new Map();
    this.shownCampaign = null; // null: the newest
    this.runs = null;
    this.listedRuns = null; // those of the list, which may be searched
    this.moreRuns = false;
    this.events = null;
  }

  on(topics, listener) {
    for (const topic of topics.split(" ")) {
      if (!this.#listeners.has(topic)) this.#listeners.set(topic, []);
      this.#listeners.get(topic).push(listener);
    }
  }

  tell(topic, detail) {
    for (const listener of this.#listeners.get(topic) ?? []) listener(detail);
  }

  get bench() {
    return this.benches.get(this.selected) ?? null;
  }

  /** Benches in trouble first, then those that move; among equals as they are configured. */
  get benchesWorstFirst() {
    const rank = (bench) => [TROUBLE, MOVES].findIndex((states) => states.includes(bench.state)) >>> 0;
    return [...this.benches.values()].sort((a, b) => rank(a) - rank(b));
  }

  get connected() {
    return this.link.state === "live";
  }

  setBenches(benches) {
    this.benches = new Map(benches.map((bench) => [bench.name, bench]));
    if (!this.benches.has(this.selected)) this.selected = this.benchesWorstFirst[0]?.name ?? null;
    for (const bench of benches) if (bench.live && !this.heard.has(bench.name)) this.heard.set(bench.name, Date.now());
    this.tell("benches");
  }

  /** A frame of the feed, or an answer about one bench: it may lack what does not change (limits). Offline, `live` is null. */
  mergeBench(change) {
    const { type: _, ...bench } = change;
    const known = this.benches.get(bench.name) ?? {};
    this.benches.set(bench.name, { ...known, ...bench });
    this.tell("benches", { name: bench.name, before: known.state, runBefore: known.run_id ?? null });
  }

  mergeLive({ type: _, bench: name, ...live }) {
    const bench = this.benches.get(name);
    if (!bench) return;
    bench.live = live;
    this.heard.set(name, Date.now());
    this.tell("live", { name, live });
  }

  setCampaigns(campaigns) {
    this.campaigns = new Map(campaigns.map((campaign) => [campaign.id, campaign]));
    this.tell("campaigns");
  }

  mergeCampaign({ type: _, ...campaign }) {
    const known = this.campaigns.get(campaign.id);
    this.campaigns.set(campaign.id, { ...known, ...campaign });
    this.tell("campaigns", { id: campaign.id, stageBefore: known?.stage, stateBefore: known?.state });
  }

  get campaignsNewestFirst() {
    return [...this.campaigns.values()].sort((a, b) => String(b.created_utc).localeCompare(String(a.created_utc)));
  }

  get campaign() {
    return this.campaigns.get(this.shownCampaign) ?? this.campaignsNewestFirst[0] ?? null;
  }

  addEvent({ type: _, ...event }) {
    if (event.id !== undefined && this.events?.some((known) => known.id === event.id)) return;
    this.events = [event, ...(this.events ?? [])].slice(0, MAX_EVENTS);
    this.tell("events");
  }

  /** The result of a command to a bench: {"ok", "text"}, shown until the next command. */
  setAnswer(name, answer) {
    this.answers.set(name, { at: new Date(), ...answer });
    this.tell("answers", { name });
  }
}
