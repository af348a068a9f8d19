/**
 * The server's REST interface: paths below /api/v1, JSON both ways, errors as one sentence; and who may use it.
 *
 * api.watchJob(id, changed) -> {ended: Promise<job>, close()}     by server-sent events; changed(job) now and at each
 *     change; `ended` resolves with the ended job (done, failed, cancelled, interrupted), or rejects with an ApiError
 * may("POST /flights/{}/end")    by the server's own table; true until it has answered. It checks every request itself
 * needs(route) -> attributes     hide an element whose request the role does not allow
 *
 * `path` is "/monitors", or as in a Location header "/api/v1/jobs/3f9a".
 */

import { capital } from "./numbers.js";

const BASE = "/api/v1";
const JSON_TYPE = "application/json";
const ENDED = ["done", "failed", "cancelled", "interrupted"];
const ROLE = "urn:forewarn:role";
const NO_ANSWER = "The server does not answer. Check that `forewarn serve` is running, then try again.";

export class ApiError extends Error {
  /** status: 0 where there was no answer */
  constructor(message, status, problem = {}) {
    super(message);
    this.name = "ApiError";
    this.status = status;
    this.kind = problem.type ?? "about:blank";
    this.problem = problem;
  }
}

async function call(method, path, body, type = JSON_TYPE) {
  const headers = { Accept: `${JSON_TYPE}, application/problem+json` };
  if (body !== undefined) headers["Content-Type"] = type;
  const content = type === JSON_TYPE && body !== undefined ? JSON.stringify(body) : body;
  let response;
  try {
    response = await fetch(address(path), { method, headers, body: content });
  } catch {
    throw noAnswer();
  }
  if (!response.ok) throw await problemOf(response);
  return response.status === 204 ? null : response.json();
}

export function address(path) {
  return path.startsWith(BASE) ? path : BASE + path;
}

export function noAnswer() {
  return new ApiError(NO_ANSWER, 0);
}

async function problemOf(response) {
  const problem = await response.json().catch(() => ({}));
  return refusal(response.status, { title: response.statusText, ...problem });
}

export function refusal(status, problem) {
  if (problem.type === ROLE) {
    return new ApiError(`This needs the role ${problem.needed}; you are logged in as ${problem.role}.`, status, problem);
  }
  if (status === 401) {
    return new ApiError("This server needs a token. Open /login and enter it.", 401, problem);
  }
  return new ApiError(sentence(problem.detail || problem.title || "no reason given"), status, problem);
}

const sentence = (text) => capital(/[.!?]$/.test(text) ? text : `${text}.`);

export function reason(error) {
  if (error instanceof ApiError) return error.message;
  return `The page failed: ${error?.message ?? error}. Reload it.`;
}

function watchJob(id, changed = () => {}) {
  const source = new EventSource(`${BASE}/jobs/${id}/events`);
  const ended = new Promise((resolve, reject) => {
    source.addEventListener("message", (event) => {
      const job = JSON.parse(event.data);
      changed(job);
      if (!ENDED.includes(job.status)) return;
      source.close();
      resolve(job);
    });
    source.addEventListener("error", () => {
      if (source.readyState !== EventSource.CLOSED) return; // it reconnects by itself
      api.get(`/jobs/${id}`).then((job) => {
        changed(job);
        if (ENDED.includes(job.status)) resolve(job);
        else reject(noAnswer());
      }, reject);
    });
  });
  return { ended, close: () => source.close() };
}

export const api = {
  get: (path) => call("GET", path),
  post: (path, body = {}) => call("POST", path, body),
  put: (path, body) => call("PUT", path, body),
  delete: (path) => call("DELETE", path),
  upload: (path, file) => call("POST", path, file, "application/octet-stream"),
  watchJob,
};

let me = null;

export async function loadMe(api) {
  try {
    me = await api.get("/me");
  } catch {
    me = null; // the view reports that the server does not answer
  }
  return me;
}

export function may(route) {
  const [method, path] = route.split(" ");
  return me === null || me.allowed.includes(`${method} /api/v1${path}`);
}

export function asksForToken() {
  return me !== null && me.name !== "local";
}

export function needs(route) {
  return may(route) ? {} : { "data-refused": true };
}
