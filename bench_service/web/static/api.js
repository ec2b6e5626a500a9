// The public REST API, as any other client uses it.

const BASE = "/api/v1";

const BUSY = new Set([0, 429, 502, 503, 504]);

/** An answer that is not the asked one: `code`, `message`, `where` from the service, `status` 0 where none came; `unanswered` is worth asking again. */
export class ApiError extends Error {
  constructor(status, code, message, where = null) {
    super(message);
    Object.assign(this, { status, code, where: Array.isArray(where) ? where : [], unanswered: BUSY.has(status) });
  }
}

async function request(method, path, body, timeout_s) {
  const options = { method, headers: { Accept: "application/json" }, signal: AbortSignal.timeout(timeout_s * 1000) };
  if (body instanceof Blob) {
    options.headers["Content-Type"] = body.type;
    options.body = body;
  } else if (body !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  let response;
  try {
    response = await fetch(path, options);
  } catch (error) {
    const late = error.name === "TimeoutError";
    throw new ApiError(0, late ? "timeout" : "unreachable",
      late ? `The service did not answer within ${timeout_s} s.` : "The service cannot be reached.");
  }
  const payload = await response.json().catch(() => null);
  if (response.ok) return payload;
  const told = payload?.error;
  throw new ApiError(response.status, told?.code ?? "http", told?.message ?? `HTTP ${response.status}`, told?.where);
}

const get = (path, timeout_s = 15) => request("GET", BASE + path, undefined, timeout_s);
const post = (path, body, timeout_s = 15) => request("POST", BASE + path, body, timeout_s);
const patch = (path, body, timeout_s = 15) => request("PATCH", BASE + path, body, timeout_s);
const query = (values) => new URLSearchParams(Object.entries(values).filter(([, v]) => v !== undefined)).toString();
const id = encodeURIComponent;
const list = (payload, name) => (Array.isArray(payload) ? payload : payload?.[name] ?? []);

// Ways past the service, bench by bench: url and token of the stop port of its control process.
const stopPorts = new Map();
const LOCAL = new Set(["127.0.0.1", "localhost", "[::1]"]);
const DIRECT_MS = 400;

/** Learn the stop ports while the service answers; they are on its own machine only. */
async function learnStopPorts(names) {
  if (!LOCAL.has(location.hostname)) return;
  await Promise.all(names.map(async (name) => {
    try { stopPorts.set(name, await get(`/benches/${id(name)}/stop-port`)); } catch { stopPorts.delete(name); }
  }));
}

/** Past the service; true where the control process has taken the stop. */
async function stopDirectly(name) {
  const port = stopPorts.get(name);
  if (!port) return false;
  try {
    // Plain text with the token inside: a browser sends it at once, without asking first.
    const options = { method: "POST", body: `${port.token}\nstopped on the page`, signal: AbortSignal.timeout(DIRECT_MS) };
    return (await fetch(`${port.url}/stop`, options)).ok;
  } catch {
    return false;
  }
}

export const api = {
  learnStopPorts,
  health: () => request("GET", "/healthz", undefined, 4),
  benches: async () => list(await get("/benches"), "benches"),
  /** `filter`: q, retired, limit, cursor; gives `{cells, next_cursor}`. */
  cells: (filter = {}) => get(`/cells?${query(filter)}`),
  cell: (cellId) => get(`/cells/${id(cellId)}`),
  addCell: (body) => post("/cells", body),
  changeCell: (cellId, body) => patch(`/cells/${id(cellId)}`, body, 60),
  retireCell: (cellId) => post(`/cells/${id(cellId)}/retire`),
  reuseCell: (cellId) => post(`/cells/${id(cellId)}/reuse`),
  cellEvents: async (cellId) => list(await get(`/cells/${id(cellId)}/events?limit=200`), "events"),
  // The bench's control process begins anew with the limits of both.
  putCell: (name, cellId) => request("PUT", `${BASE}/benches/${id(name)}/cell`, { cell_id: cellId }, 60),
  modelsOf: async (cellId) => list(await get(`/models?${query({ cell_id: cellId, limit: 200 })}`), "models"),
  diagnosesOf: async (cellId) => list(await get(`/diagnoses?${query({ cell_id: cellId, limit: 200 })}`), "diagnoses"),
  modelUrl: (modelId) => `${BASE}/models/${id(modelId)}/document`,
  standing: (name) => get(`/benches/${id(name)}/standing`),
  // A stop is worth a quick verdict: the person at the bench needs to know whether to use the emergency stop.
  stopBench: async (name) => (await stopDirectly(name)) || post(`/benches/${id(name)}/stop`, undefined, 5),
  openSeal: (name) => post(`/benches/${id(name)}/seal/open`),
  acknowledge: (name) => post(`/benches/${id(name)}/acknowledge`),
  runs: async (filter) => list(await get(`/runs?${query(filter)}`), "runs"),
  run: (runId) => get(`/runs/${id(runId)}`),
  /** `part`: from_s, to_s, after_seq, points, columns; all may be left out. */
  samples: (runId, part) => get(`/runs/${id(runId)}/samples?${query(part)}`, 60),
  observer: (runId, part) => get(`/runs/${id(runId)}/observer?${query(part)}`, 60),
  incremental: (runId, part) => get(`/runs/${id(runId)}/incremental?${query(part)}`, 60),
  describeRun: (runId, body) => patch(`/runs/${id(runId)}`, body),
  runEvents: async (runId) => list(await get(`/runs/${id(runId)}/events`), "events"),
  pauseBench: (name) => post(`/benches/${id(name)}/pause`, undefined, 5),
  skipStep: (name) => post(`/benches/${id(name)}/skip`, undefined, 5),
  standardTests: async () => list(await get("/standard-tests"), "standard_tests"),
  protocols: async () => list(await get("/protocols?limit=200"), "protocols"),
  protocol: (protocolId) => get(`/protocols/${id(protocolId)}`, 60),
  addProtocol: (body) => post("/protocols", body, 60),
  previewProtocol: (body) => post("/protocols/preview", body, 60),
  runSteps: async (runId) => list(await get(`/runs/${id(runId)}/steps`), "steps"),
  runCycles: async (runId) => list(await get(`/runs/${id(runId)}/cycles`), "cycles"),
  resumeBench: (name) => post(`/benches/${id(name)}/resume`, undefined, 5),
  profiles: async () => list(await get("/profiles?limit=200"), "profiles"),
  profile: (profileId, points) => get(`/profiles/${id(profileId)}?${query({ points })}`, 60),
  addProfile: (text, name) => request("POST", `${BASE}/profiles?${query({ name })}`, new Blob([text], { type: "text/csv" }), 60),
  exportUrl: (runId, format, damaged) => `${BASE}/runs/${id(runId)}/export?format=${format}${damaged ? "&damaged=include" : ""}`,
  campaigns: async () => list(await get("/campaigns"), "campaigns"),
  startCampaign: (body) => post("/campaigns", body),
  estimateCampaign: (body) => post("/campaigns/estimate", body),
  stopCampaign: (campaignId) => post(`/campaigns/${id(campaignId)}/stop`, undefined, 5),
  /** `part`: from_s, to_s, points; the first look waits for the simulation. */
  comparisonSeries: (comparisonId, part = {}) => get(`/comparisons/${id(comparisonId)}/series?${query(part)}`, 60),
  models: async () => list(await get("/models?limit=200"), "models"),
  model: (modelId) => get(`/models/${id(modelId)}`),
  fit: (body) => post("/models", body, 60),
  importModel: (document, name) => post(`/models/import?${query({ name })}`, document, 60),
  chain: (modelId) => get(`/models/${id(modelId)}/chain`),
  addImport: (name) => post("/imports", { name }),
  importOf: (importId) => get(`/imports/${id(importId)}`),
  putImport: (importId, file) => request("PUT", `${BASE}/imports/${id(importId)}/content`, new Blob([file], { type: "application/octet-stream" }), 3600),
  lookImport: (importId, choices) => post(`/imports/${id(importId)}/look`, choices),
  storeImport: (importId, body) => post(`/imports/${id(importId)}/run`, body),
  mappings: async () => list(await get("/mappings"), "mappings"),
  saveMapping: (mapping) => post("/mappings", mapping),
  formats: async () => list(await get("/formats"), "formats"),
  effects: async () => list(await get("/effects", 60), "effects"),
  addEffect: (modelId, body) => post(`/models/${id(modelId)}/effects`, body, 60),
  // The first work of a worker loads the libraries; on a busy machine that alone takes seconds.
  compare: (body) => post("/comparisons", body, 300),
  comparison: (comparisonId) => get(`/comparisons/${id(comparisonId)}`),
  where: (comparisonId) => get(`/comparisons/${id(comparisonId)}/where`, 300),
  trend: (body) => post("/trends", body, 60),
  trendUrl: (jobId) => `${BASE}/trends/${id(jobId)}/table`,
  reportUrl: (kind, name, format) => `${BASE}/${kind}/${id(name)}/report?format=${format}`,
  diagnose: (body) => post("/diagnoses", body, 60),
  experiment: (diagnosisId, bench) => post(`/diagnoses/${id(diagnosisId)}/experiment`, { bench }, 60),
  startRun: (body) => post("/runs", body, 60),
  diagnosis: (diagnosisId) => get(`/diagnoses/${id(diagnosisId)}`),
  job: (jobId) => get(`/jobs/${id(jobId)}`),
  cancelJob: (jobId) => post(`/jobs/${id(jobId)}/cancel`, {}),
  events: async (limit) => list(await get(`/events?${query({ limit })}`), "events"),
};
