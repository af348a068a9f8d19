/**
 * Plugin for Open MCT: the flights of a Forewarn server as telemetry, historical and live.
 *
 *     const { Forewarn } = await import(`${url}/openmct/forewarn.js`);
 *     openmct.install(Forewarn({ url, token }));
 *
 * A value that is not known is a word (STALE, INVALID), never a number. The file stands alone: another server's page loads it.
 */

const NAMESPACE = "forewarn";
const PART = 2000; // samples per answer of the server
const MOST_PARTS = 50; // per request: 100,000 samples, the newest of the interval
const LOOK = 3000; // ms between looks at the lists; what was read of a flight counts as long
const SILENCE = 2500; // ms without a message; the server sends one each second
const WAITS = [250, 500, 1000, 2000, 4000]; // ms before each next attempt
const OVERLAP = 50; // samples before the first live one, which a request may just have missed
const RUNNING = ["running", "ending"];
const FOLDERS = {
  flights: { name: "Forewarn", holds: ["running", "ended"] },
  running: { name: "In progress", query: "progress=running&limit=1000" },
  ended: { name: "Ended", query: "progress=ended&progress=interrupted&progress=failed&limit=20" },
};
const VIOLATIONS = {
  warning: { cssClass: "is-limit--red", name: "CRITICAL" },
  caution: { cssClass: "is-limit--yellow", name: "WARNING" },
  advisory: { cssClass: "is-limit--cyan", name: "WATCH" },
};
const STATES = ["OK", "NOT CALIBRATED", "NOT ASSESSED", "WARMING UP", "ENDED", "INVALID", "NOT APPLICABLE", "LIMITS UNKNOWN", "STALE", "ALERT", "EXCEEDING"];
const HEADLINES = ["OK", "NO ALERT", "EXCEEDED", "NOT CALIBRATED", "NOT ASSESSED", "WARMING UP", "NO DATA", "ENDED", "CAUTION", "INVALID", "STALE", "ALERT", "ALARM", "EXCEEDING"];
const CAUSES = { between_manoeuvres: "NOT ASSESSED", ready: "NOT ASSESSED", not_applicable: "NOT APPLICABLE", limits_unknown: "LIMITS UNKNOWN" };

const words = (key) => key.replaceAll("_", " ").toUpperCase();

function levelOf(word) {
  if (["EXCEEDING", "ALERT"].includes(word)) return "warning";
  if (["STALE", "INVALID", "NOT APPLICABLE", "LIMITS UNKNOWN", "NO DATA"].includes(word)) return "caution";
  return word === "OK" ? "none" : "advisory";
}

const inWord = (value) => ({ value, level: levelOf(value) });
const unassessed = ({ state, cause }) => inWord(CAUSES[cause] ?? words(state));

/** Limits of a channel in its unit at a time [s]: [low, high], infinite where there is none. */
function limitsAt({ own, held }, { key }, t) {
  const inForce = held.length === 0 ? own : held.findLast((each) => each.t === null || each.t <= t)?.limits;
  const given = inForce?.[key] ?? {};
  return typeof given === "number" ? [-given, given] : [given.low ?? -Infinity, given.high ?? Infinity];
}

/** Where a channel exceeds its limit, which itself counts: "lwr", "upr" or "". */
function sideOf(flight, c, { t, y }) {
  const [low, high] = limitsAt(flight, flight.channels[c], t);
  if (y[c] === null) return "";
  return y[c] <= low ? "lwr" : y[c] >= high ? "upr" : "";
}

function stateOf(flight, frame) {
  if (frame.state !== "stale" && flight.channels.some((_, c) => sideOf(flight, c, frame))) return "EXCEEDING";
  if (frame.state !== "ok") return unassessed(frame).value;
  return frame.alert ? "ALERT" : flight.validity === "checked" ? "OK" : "NOT CALIBRATED";
}

/**
 * The telemetry points of a flight.
 *
 * of(frame) -> {value, level, side}     limits() -> [low, high] now, in the unit shown
 * states: of an enumeration.   live: without history.   timed: by the server's clock, also while samples are late
 */
export function pointsOf(flight) {
  const risk = (frame) => (frame.p_value === null ? unassessed(frame) : { value: frame.p_value, level: frame.alert ? "warning" : "none", side: frame.alert ? "upr" : "" });
  const state = (frame) => ({ value: STATES.indexOf(stateOf(flight, frame)), level: levelOf(stateOf(flight, frame)) });
  const channelOf = (channel, c) => {
    const { symbol, label, display_unit: unit, display_factor: factor, display_decimals: decimals, largest } = channel;
    const of = (frame) => {
      const side = sideOf(flight, c, frame);
      return frame.y[c] === null ? inWord("NO DATA") : { value: frame.y[c] * factor, level: side ? "warning" : "none", side };
    };
    const limits = () => limitsAt(flight, channel, Infinity).map((end) => end * factor);
    return { key: `channel-${c}`, name: label === symbol ? symbol : `${symbol} ${label}`, unit, decimals, of, limits, beyond: (largest ?? 1e6) * factor };
  };
  return [
    { key: "risk", name: "Risk", decimals: 3, of: risk, limits: () => [0, flight.alertAbove] },
    { key: "state", name: "State", states: STATES, of: state },
    { key: "headline", name: "Headline", states: HEADLINES, live: true, timed: true },
    { key: "alarms", name: "Alarms", isText: true },
    ...(flight.mode === "live" ? [{ key: "age", name: "Age of the newest sample", unit: "s", decimals: 1, live: true, timed: true }] : []),
    ...flight.channels.map(channelOf),
  ];
}

/** Risk above which the monitors alert; NaN where those of a set differ. */
function alertLevel({ monitors, monitor_set: set }) {
  const levels = new Set((set?.conditions ?? monitors.slice(0, 1)).map(({ alert_above: level }) => level));
  return levels.size === 1 ? [...levels][0] : NaN;
}

const utcAt = ({ zero }, t) => Math.round(zero + t * 1000);

/** Data of a point. A word is given once, not for each sample. before: the value before them. */
function dataOf(flight, point, frames, before = undefined) {
  const data = [];
  for (const frame of frames) {
    const datum = point.of(frame);
    if (typeof datum.value === "string" && datum.value === before) continue;
    data.push({ utc: utcAt(flight, frame.t), t: frame.t, ...datum });
    before = datum.value;
  }
  return data;
}

function alarmOf(flight, { id, t, kind, level, raised, p_value: risk, reason, exceedance, acknowledged, by }) {
  const channel = flight.channels.find(({ key }) => key === exceedance?.channel);
  const exceeds = channel && `${channel.symbol} exceeds its limit, ${(exceedance.value * channel.display_factor).toPrecision(3)} ${channel.display_unit}`;
  const value = [words(kind), exceeds ?? reason ?? risk?.toFixed(3)].filter(Boolean).join(": ") + (acknowledged ? `, acknowledged by ${by}` : "");
  return { utc: utcAt(flight, t) || Date.parse(raised), t, id, value, level: acknowledged ? "none" : level };
}

/** At most `size` data: the least and the largest of each interval, or a word where it has no number. */
function minmax(data, size) {
  if (!(data.length > size)) return data;
  const n = Math.ceil(data.length / Math.max(1, Math.floor(size / 2)));
  const parts = Array.from({ length: Math.ceil(data.length / n) }, (_, k) => data.slice(k * n, (k + 1) * n));
  return parts.flatMap((part) => {
    const numbers = part.filter(({ value }) => typeof value === "number").sort((a, b) => a.value - b.value);
    return [...new Set([numbers[0] ?? part[0], numbers.at(-1) ?? part[0]])].sort((a, b) => a.utc - b.utc);
  });
}

function violationOf({ level, side }) {
  const violation = VIOLATIONS[level];
  return violation && { ...violation, cssClass: `${side ? `is-limit--${side} ` : ""}${violation.cssClass}` };
}

/** Open MCT reads both ends; one without a limit is where no value is. */
function limitsOf({ limits, beyond = 1 }) {
  const [low = NaN, high = NaN] = limits?.() ?? [];
  if (Number.isNaN(high) || (low === -Infinity && high === Infinity)) return undefined;
  const [least, greatest] = [Math.max(low, -beyond), Math.min(high, beyond)];
  return { CRITICAL: { low: { color: "red", value: least }, high: { color: "red", value: greatest } } };
}

/** The flights of a server over REST. */
function createServer({ url, token }) {
  const cache = new Map(); // promises of flights and parts, which many points share

  async function get(path) {
    const headers = token ? { Authorization: `Bearer ${token}` } : {};
    const answer = await fetch(`${url}/api/v1${path}`, { headers, cache: "no-store" });
    if (answer.ok) return answer.json();
    throw new Error(await answer.json().then(({ detail }) => detail).catch(() => `status ${answer.status}`));
  }

  /** isFinal(result): whether it does not change any more; else it counts for a while [ms]. */
  function cached(key, read, isFinal, lasts) {
    const known = cache.get(key);
    if (known && (known.isFinal || Date.now() - known.read < lasts)) return known.promise;
    const entry = { read: Date.now(), isFinal: false, promise: read() };
    cache.delete(key);
    cache.set(key, entry);
    if (cache.size > 2 * MOST_PARTS) cache.delete(cache.keys().next().value);
    entry.promise.then((result) => (entry.isFinal = isFinal(result)), () => cache.delete(key));
    return entry.promise;
  }

  const flight = (id, lasts = LOOK) => cached(id, () => read(id), ({ isOver }) => isOver, lasts);

  async function read(id) {
    const status = await get(`/flights/${id}`);
    const { created, head, mode, monitors, live, limits_held: held } = status;
    const { dictionary } = await get(`/monitors/${monitors[0].id}`);
    const channels = dictionary?.channels ?? (await get("/catalog")).channels;
    const { limits: own, validity } = monitors[0];
    const name = `${created.slice(0, 16).replace("T", " ")} ${status.name}`;
    const flight = { id, name, mode, head, created: Date.parse(created), channels, own, held: held ?? [], validity, alertAbove: alertLevel(status), zero: NaN, isOver: !RUNNING.includes(status.progress) };
    if (live?.time_zero) flight.zero = Date.parse(live.time_zero);
    else if (head >= 0) flight.zero = flight.created - 1000 * (await frames(id, 0, 0))[0].t;
    return Object.assign(flight, { points: pointsOf(flight) });
  }

  async function frames(id, first, last) {
    const { frames } = await get(`/flights/${id}/assessments?first=${first}&last=${last}`);
    return frames.filter(({ t }) => t !== null);
  }

  const part = ({ id, isOver }, k) => cached(`${id} ${k}`, () => frames(id, k * PART, (k + 1) * PART - 1), ({ length }) => isOver || length === PART, 1000);

  /** Frames from start to end [ms UTC], or the newest of them. Times of a live flight rise: its parts are found by bisection. */
  async function history(flight, start, end, isLatest = false) {
    if (flight.head < 0) return [];
    const newest = Math.floor(flight.head / PART) + (flight.isOver ? 0 : 1);
    const last = flight.mode === "live" ? await partAt(flight, end, newest) : newest;
    const first = isLatest ? last - 2 : Math.max(last - MOST_PARTS + 1, flight.mode === "live" ? await partAt(flight, start, last) : 0);
    const asked = Array.from({ length: last - Math.max(0, first) + 1 }, (_, k) => part(flight, Math.max(0, first) + k));
    return (await Promise.all(asked)).flat().filter(({ t }) => utcAt(flight, t) >= start && utcAt(flight, t) <= end);
  }

  /** The last part that begins at this time or before. */
  async function partAt(flight, utc, last) {
    let [low, high] = [0, last];
    while (low < high && utc < Infinity) {
      const k = Math.ceil((low + high) / 2);
      const [first] = await frames(flight.id, k * PART, k * PART);
      if (first && utcAt(flight, first.t) <= utc) low = k;
      else high = k - 1;
    }
    return high;
  }

  return { get, flight, history };
}

/**
 * The link to a flight, shared by all of its points, from the first listener to the last.
 *
 * on(key, callback) -> off()     key: of a point, for arrays of data; "stale"; "limits", for the flight
 */
function createLink(id, server, { url, token }, closed) {
  const listeners = new Map();
  const newest = new Map(); // datum of each point
  const states = { sample: "", headline: false }; // whether the server calls the flight stale
  let flight = null;
  let socket = null;
  let heard = 0;
  let seen = null; // newest sample
  let taken = null; // when it was taken, by the server's clock [ms]
  let newestUtc = NaN;
  let late = 0; // age that counts as stale [s]
  let attempt = 0;
  let timer = 0;
  let isClosed = false;
  const link = { isStale: true, on, newest: (key) => newest.get(key) };
  const watch = setInterval(() => socket && performance.now() - heard > SILENCE && lost(), SILENCE / 5);

  function on(key, callback) {
    if (!listeners.has(key)) listeners.set(key, new Set());
    listeners.get(key).add(callback);
    queueMicrotask(() => {
      if (key === "stale") callback(staleness(link));
      else if (newest.has(key)) callback([newest.get(key)]);
    });
    return () => {
      listeners.get(key).delete(callback);
      if (isClosed || [...listeners.values()].some(({ size }) => size > 0)) return;
      isClosed = true;
      clearInterval(watch);
      clearTimeout(timer);
      shut();
      closed();
    };
  }

  const emit = (key, value) => listeners.get(key)?.forEach((callback) => callback(value));

  function push(key, data) {
    if (data.length === 0) return;
    newest.set(key, data.at(-1));
    emit(key, data);
  }

  async function connect() {
    try {
      flight = await server.flight(id, 0);
    } catch {
      lost();
      return;
    }
    if (flight.isOver) setStale("ENDED");
    if (flight.isOver || isClosed) return;
    heard = performance.now();
    const mine = new WebSocket(`${url.replace(/^http/, "ws")}/api/v1/flights/${id}/stream${token && `?token=${encodeURIComponent(token)}`}`);
    socket = mine;
    mine.addEventListener("close", () => socket === mine && lost());
    mine.addEventListener("message", ({ data }) => {
      if (socket !== mine) return;
      heard = performance.now();
      const message = JSON.parse(data);
      handlers[message.type]?.(message);
    });
  }

  function shut() {
    const open = socket;
    socket = null;
    open?.close();
  }

  function lost() {
    if (isClosed) return;
    shut();
    setStale("STALE");
    timer = setTimeout(connect, WAITS[Math.min(attempt++, WAITS.length - 1)]);
  }

  /** word: in place of every number; empty while the flight is not stale. */
  function setStale(word) {
    link.isStale = word !== "";
    if (word) withdraw(word);
    emit("stale", staleness(link));
  }

  const decide = () => setStale(states.sample === "stale" || states.headline ? "STALE" : "");

  /** The word comes right after the newest datum, by whichever clock. */
  async function withdraw(word) {
    if (flight === null) return;
    if (Number.isNaN(newestUtc)) {
      const frames = await server.history(flight, -Infinity, Infinity, true).catch(() => []);
      newestUtc = frames.length > 0 ? utcAt(flight, frames.at(-1).t) : Date.now();
      if (!link.isStale) return;
    }
    for (const { key, states, isText, timed } of flight.points) {
      const value = states ? states.indexOf(word) : word;
      if (isText || (timed && socket) || newest.get(key)?.value === value) continue;
      push(key, [{ utc: Math.max(newestUtc, newest.get(key)?.utc ?? 0) + 1, value, level: levelOf(word) }]);
    }
  }

  const setZero = (live) => live?.time_zero && Object.assign(flight, { zero: Date.parse(live.time_zero) });

  /** Other limits or another monitor: from the next sample on. */
  async function update() {
    const fresh = await server.flight(id, 0).catch(lost);
    if (fresh) flight = Object.assign(fresh, { zero: flight.zero });
    emit("limits", flight);
  }

  const handlers = {
    hello: (message) => {
      attempt = 0;
      late = message.stale_after;
      states.sample = message.state;
      setZero(message.live);
      emit("limits", flight);
      if (message.head < seen) seen = null;
      socket.send(JSON.stringify({ type: "resume", seq: seen ?? Math.max(-1, message.head - OVERLAP) }));
      handlers.status(message);
      push("alarms", message.alarms.map((alarm) => alarmOf(flight, alarm)));
    },
    frames: ({ frames }) => {
      socket.send(JSON.stringify({ type: "credit", n: 1 }));
      const fresh = frames.filter(({ seq, t }) => seq > (seen ?? -1) && t !== null);
      if (fresh.length === 0) return;
      const { seq, t } = fresh[0];
      if (flight.mode !== "live" && seq === 0) flight.zero = flight.created - 1000 * t;
      seen = fresh.at(-1).seq;
      taken = fresh.at(-1).taken ?? null;
      if (Number.isNaN(flight.zero)) return; // of a live flight, known within a second
      newestUtc = utcAt(flight, fresh.at(-1).t);
      const heeded = flight.points.filter(({ key, of }) => of && listeners.get(key)?.size > 0);
      for (const point of heeded) push(point.key, dataOf(flight, point, fresh, newest.get(point.key)?.value));
      if (link.isStale) withdraw("STALE"); // they came late
    },
    reset: ({ t }) => {
      const back = newestUtc + 1 - utcAt(flight, t); // of a replay: its newest value stays the last
      if (flight.mode !== "live" && back > 0) flight.zero += back;
    },
    state: ({ state }) => {
      states.sample = state;
      decide();
    },
    status: ({ status, level, beside }) => {
      states.headline = [status, ...beside].includes("stale");
      push("headline", [{ utc: Date.now(), value: HEADLINES.indexOf(status === "risk" ? "ALERT" : words(status)), level }]);
      decide();
    },
    alarm: ({ alarm }) => push("alarms", [alarmOf(flight, alarm)]),
    live: ({ live }) => setZero(live),
    limits: update,
    monitor: update,
    heartbeat: ({ sent }) => {
      const age = Math.max(0, sent - taken) / 1000;
      if (taken !== null) push("age", [{ utc: Date.now(), value: age, level: age > late ? "caution" : "none" }]);
    },
  };

  connect();
  return link;
}

let stamp = 0;

/** Open MCT takes only answers later than the last one, by the time system's key. */
function staleness({ isStale }) {
  stamp = Math.max(stamp + 1, Date.now());
  return { isStale, utc: stamp, timestamp: stamp };
}

const idOf = (key) => ({ namespace: NAMESPACE, key });
const isOurs = ({ identifier }) => identifier.namespace === NAMESPACE;
const isPoint = (object) => isOurs(object) && object.type === "forewarn.point";

/** The folders of flights, looked at again and again; the indicator shows whether the server answers. */
function createFolders(openmct, server, url) {
  const held = {}; // ids of flights by folder
  let listeners = [];
  const indicator = openmct.indicators.simpleIndicator();
  indicator.text("Forewarn");
  indicator.iconClass("icon-connectivity");
  openmct.indicators.add(indicator);
  let timer = setTimeout(look);
  openmct.on("destroy", () => clearTimeout(timer));

  async function read(folder) {
    const list = server.get(`/flights?${FOLDERS[folder].query}`).then((flights) => flights.map(({ id }) => id));
    const problem = await list.then(() => "", ({ message }) => message);
    indicator.text(problem ? "Forewarn: NOT CONNECTED" : "Forewarn: connected");
    indicator.description(problem ? `${url}: ${problem}. The lists of flights may be out of date.` : url);
    indicator.statusClass(problem ? "s-status-error" : "s-status-on");
    held[folder] = problem ? (held[folder] ?? []) : await list;
    return held[folder];
  }

  async function look() {
    for (const folder of new Set(["running", ...Object.keys(held)])) {
      const known = held[folder];
      const after = await read(folder);
      const before = known ?? after;
      const changes = { add: after.filter((id) => !before.includes(id)), remove: before.filter((id) => !after.includes(id)) };
      for (const [event, ids] of Object.entries(changes)) {
        const told = listeners.filter((each) => each.folder === folder && each.event === event);
        for (const { callback, context } of told) ids.forEach((id) => callback.call(context, idOf(`flight-${id}`)));
      }
    }
    timer = setTimeout(look, LOOK);
  }

  const on = ({ identifier }, event, callback, context) => listeners.push({ folder: identifier.key, event, callback, context });

  function off({ identifier }, event, callback, context) {
    listeners = listeners.filter((each) => each.folder !== identifier.key || each.event !== event || each.callback !== callback || each.context !== context);
  }

  return { read, on, off };
}

/** Metadata of a point; registers the formats of its numbers. */
function valuesOf({ telemetry }, { name, unit, decimals, states, isText }) {
  const format = (digits) => {
    const key = `forewarn.${digits}`;
    if (!telemetry.getFormatter(key)) telemetry.addFormat({ key, parse: Number, format: (value) => (typeof value === "number" ? value.toFixed(digits) : value), validate: () => true });
    return key;
  };
  const shown = states ? { format: "enum", enumerations: states.map((string, value) => ({ string, value })) } : { format: isText ? "string" : format(decimals) };
  return [
    { key: "utc", name: "Time", format: "utc", hints: { domain: 1 } },
    { key: "value", name, unit: unit || undefined, ...shown, hints: { range: 1 } },
    { key: "t", name: "Flight time", unit: "s", format: format(2) },
    ...(isText ? [{ key: "id", name: "Number", format: "string", useToUpdateInPlace: true }] : []),
  ];
}

/** url: of the server, by default that of this file.   token: of a viewer; none where the server asks for none. */
export function Forewarn({ url = new URL(import.meta.url).origin, token = "" } = {}) {
  return function install(openmct) {
    const address = { url: url.replace(/\/+$/, ""), token };
    const server = createServer(address);
    const folders = createFolders(openmct, server, address.url);
    const links = new Map();

    /** A point's key is FLIGHT.POINT. */
    const keysOf = ({ identifier }) => identifier.key.split(".");

    function listen(object, event, callback) {
      const [id] = keysOf(object);
      if (!links.has(id)) links.set(id, createLink(id, server, address, () => links.delete(id)));
      return links.get(id).on(event, callback);
    }

    async function find(object) {
      const [id, key] = keysOf(object);
      const flight = await server.flight(id);
      const point = flight.points.find((each) => each.key === key);
      if (!point) throw new Error(`flight ${id} has no point ${key}`);
      return { flight, point };
    }

    async function get(identifier) {
      const { key } = identifier;
      const location = (parent) => `${NAMESPACE}:${parent}`;
      if (key in FOLDERS) return { identifier, name: FOLDERS[key].name, type: "folder", location: FOLDERS[key].holds ? "ROOT" : location("flights") };
      if (key.startsWith("flight-")) {
        const { name, isOver } = await server.flight(key.slice(7));
        const type = openmct.types.listKeys().includes("LadTable") ? "LadTable" : "folder"; // a table of the newest values
        return { identifier, name, type, location: location(isOver ? "ended" : "running") };
      }
      const { flight, point } = await find({ identifier });
      return { identifier, name: point.name, type: "forewarn.point", location: location(`flight-${flight.id}`), telemetry: { values: valuesOf(openmct, point) } };
    }

    async function load({ identifier: { key } }) {
      if (FOLDERS[key]?.holds) return FOLDERS[key].holds.map(idOf);
      if (key in FOLDERS) return (await folders.read(key)).map((id) => idOf(`flight-${id}`));
      const { id, points } = await server.flight(key.slice(7));
      return points.map((point) => idOf(`${id}.${point.key}`));
    }

    async function read({ flight, point }, start, end, isLatest) {
      if (point.isText) return (await server.get(`/flights/${flight.id}/alarms`)).map((alarm) => alarmOf(flight, alarm)).filter(({ utc }) => utc >= start && utc <= end);
      if (point.live) return [links.get(flight.id)?.newest(point.key)].filter(Boolean);
      return dataOf(flight, point, await server.history(flight, start, end, isLatest));
    }

    async function request(object, { start = -Infinity, end = Infinity, size = undefined, strategy = "", signal = undefined }) {
      const data = await read(await find(object), start, end, strategy === "latest");
      signal?.throwIfAborted();
      if (strategy === "minmax") return minmax(data, size);
      return data.slice(-(size ?? (strategy === "latest" ? 1 : data.length)) || data.length);
    }

    openmct.types.addType("forewarn.point", { name: "Forewarn telemetry", description: "A value of a flight that Forewarn watches", cssClass: "icon-telemetry" });
    openmct.objects.addRoot(idOf("flights"));
    openmct.objects.addProvider(NAMESPACE, { get });
    openmct.composition.addProvider({ appliesTo: (object) => isOurs(object) && !isPoint(object), load, on: folders.on, off: folders.off });
    openmct.telemetry.addProvider({
      supportsRequest: isPoint,
      request,
      supportsSubscribe: isPoint,
      supportsBatching: isPoint,
      subscribe: (object, callback) => listen(object, keysOf(object)[1], callback),
      supportsLimits: isPoint,
      getLimitEvaluator: () => ({ evaluate: (datum, value) => (value && value.key !== "value" ? undefined : violationOf(datum)) }),
      getLimits: (object) => ({ limits: async () => limitsOf((await find(object)).point) }),
      subscribeToLimits: (object, callback) => listen(object, "limits", ({ points }) => callback(limitsOf(points.find(({ key }) => key === keysOf(object)[1])))),
      supportsStaleness: isPoint,
      isStale: async (object) => staleness(links.get(keysOf(object)[0]) ?? { isStale: true }),
      subscribeToStaleness: (object, callback) => listen(object, "stale", callback),
    });
  };
}
