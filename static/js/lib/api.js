/**
 * The server's REST interface: paths below /api/v1, JSON both ways, errors as one sentence; and who may use it.
 *
 * api.upload(path, file or FormData, progress(sent, total)) -> {ended: Promise<answer | null where cancelled>, cancel()}
 * api.watchJob(id, changed) -> {ended: Promise<job>, close()}     by server-sent events; changed(job) now and at each
 *     change; `ended` resolves with the ended job (done, failed, cancelled, interrupted), or rejects with an ApiError
 * api.watchLists({changed, lost}) -> {close()}     changed({list: revision}) now, at each change and every 2 s; lost()
 *     closed while the page is hidden: a browser allows six connections to a server
 * may("POST /flights/{}/end")    by the server's own table; true until it has answered. It checks every request itself
 * needs(route) -> attributes     hide an element whose request the role does not allow
 * beginsBy(hash) -> route | undefined     the request that a view of a form begins
 * notYours() -> words     why a view is not shown
 *
 * `path` is "/monitors", or as in a Location header "/api/v1/jobs/3f9a".
 */

import { capital } from "./numbers.js";

const BASE = "/api/v1";
const ACCEPTED = "application/json, application/problem+json";
const ENDED = ["done", "failed", "cancelled", "interrupted"];
const AGAIN = 1000; // ms before it connects again
const ROLE = "urn:forewarn:role";
const NO_ANSWER = "The server does not answer. Check that forewarn serve is running, then try again.";
const BEGUN = {
  "#/monitors/new": "POST /monitors", "#/monitors/combine": "POST /monitors/combinations", "#/monitors/sweep": "POST /sweeps",
  "#/datasets/new": "POST /datasets", "#/datasets/rollouts": "POST /datasets", "#/campaigns/new": "POST /campaigns",
};

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

const address = (path) => (path.startsWith(BASE) ? path : BASE + path);

const noAnswer = () => new ApiError(NO_ANSWER, 0);

const isLines = ({ headers }) => headers.get("Content-Type")?.startsWith("application/x-ndjson");

const linesOf = (text) => text.split("\n").filter(Boolean).map((line) => JSON.parse(line));

async function call(method, path, body) {
  const headers = { Accept: ACCEPTED, ...(body !== undefined && { "Content-Type": "application/json" }) };
  const response = await fetch(address(path), { method, headers, body: JSON.stringify(body) }).catch(() => {
    throw noAnswer();
  });
  if (response.status === 204) return null;
  if (response.ok) return isLines(response) ? linesOf(await response.text()) : response.json();
  throw refusal(response, await response.json().catch(() => ({})));
}

/** A file, or a form of files, with its progress, which fetch cannot report. */
function upload(path, file, progress = (_sent, _total) => {}) {
  const request = new XMLHttpRequest();
  const ended = new Promise((resolve, reject) => {
    request.upload.addEventListener("progress", ({ loaded, total }) => progress(loaded, total));
    request.addEventListener("abort", () => resolve(null));
    request.addEventListener("error", () => reject(noAnswer()));
    request.addEventListener("load", () => {
      if (request.status >= 200 && request.status < 300) resolve(request.response);
      else reject(refusal(request, request.response ?? {}));
    });
  });
  request.open("POST", address(path));
  request.responseType = "json";
  request.setRequestHeader("Accept", ACCEPTED);
  if (!(file instanceof FormData)) request.setRequestHeader("Content-Type", "application/octet-stream");
  request.send(file);
  return { ended, cancel: () => request.abort() };
}

function refusal({ status, statusText }, problem) {
  if (problem.type === ROLE)
    return new ApiError(`This needs the role ${problem.needed}; you are logged in as ${problem.role}.`, status, problem);
  if (status === 401) return new ApiError("This server needs a token. Open /login and enter it.", 401, problem);
  return new ApiError(sentence(problem.detail || problem.title || statusText || "no reason given"), status, problem);
}

const sentence = (text) => capital(/[.!?]$/.test(text) ? text : `${text}.`);

export function reason(error) {
  if (error instanceof ApiError) return error.message;
  return `The page failed: ${error?.message ?? error}. Reload it.`;
}

function watchJob(id, changed = (_job) => {}) {
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

function watchLists({ changed, lost }) {
  let source = null;
  let timer = 0;
  document.addEventListener("visibilitychange", open);
  open();
  return { close };

  function open() {
    if (source !== null) lost();
    shut();
    if (document.hidden) return;
    source = new EventSource(`${BASE}/events`);
    source.addEventListener("message", (event) => changed(JSON.parse(event.data)));
    source.addEventListener("error", () => {
      shut();
      lost();
      timer = setTimeout(open, AGAIN);
    });
  }

  function shut() {
    clearTimeout(timer);
    source?.close();
  }

  function close() {
    document.removeEventListener("visibilitychange", open);
    shut();
  }
}

export const api = {
  get: (path) => call("GET", path),
  post: (path, body = {}) => call("POST", path, body),
  put: (path, body) => call("PUT", path, body),
  delete: (path) => call("DELETE", path),
  upload,
  watchJob,
  watchLists,
};

let me = null;

export async function loadMe() {
  me = await api.get("/me").catch(() => null); // the view reports that the server does not answer
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

export const beginsBy = (hash) => BEGUN[hash.split("?")[0]];

export const notYours = () => `You are logged in as ${me.role}, who may not do this: ask an admin for another role.`;
