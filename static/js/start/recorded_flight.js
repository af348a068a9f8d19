/**
 * A recorded flight that plays by the page's clock: it stands in for the server's socket and its routes.
 *
 * createRecordedFlight(recording, api, ended) -> {Socket, api, moved(listener), close()}     moved(t): after each sample
 *     recording: as tests/support/demonstration_recording.py writes it
 *     api: the server's, for whatever is not of this flight.   ended(): the last sample was played
 */

import { ApiError } from "../lib/api.js";

const TICK = 20; // ms
const CALM = ["none", "advisory"];
const BEAT = 1000; // ms between heartbeats

const SIMULATED = { dataset: null, reason: "the recorded demonstration has no simulated flights", quantiles: [0, 1], band: null, forecast: null };

export function createRecordedFlight(recording, api, ended) {
  const { hello, messages, headlines, frames } = recording;
  const times = frames.whole.t;
  const last = times.length - 1;
  const alarms = new Map(); // by id, as last sent
  const transport = { ...hello.transport, playing: true };
  const clock = { t: times[0], wall: 0 };
  const listeners = new Set();
  let socket = null;
  let seq = -1; // of the newest frame sent; rises whatever the transport does
  let index = -1; // of its sample
  let sentMessages = 0;
  let headline = "";
  let timers = [];

  /** Credit and resume mean nothing here: nothing is ever held back. */
  function Socket() {
    const listeners = {};
    socket = { readyState: Socket.CONNECTING, listeners, addEventListener: (type, listener) => (listeners[type] = listener), send: () => {}, close };
    timers.push(setTimeout(open, 0));
    return socket;
  }
  Socket.CONNECTING = 0;
  Socket.OPEN = 1;

  const send = (message) => socket?.listeners.message?.({ data: JSON.stringify(message) });
  const serverTime = () => new Date().toISOString();

  function open() {
    if (socket === null) return;
    socket.readyState = Socket.OPEN;
    send({ ...hello, transport, server_time: serverTime() });
    clock.wall = performance.now();
    timers = [setInterval(tick, TICK), setInterval(beat, BEAT)];
    beat();
  }

  function beat() {
    send({ type: "heartbeat", server_time: serverTime(), sent: performance.now(), lost: 0, unwritten: 0, problem: "", conflated: 0 });
  }

  function now() {
    return transport.playing ? clock.t + ((performance.now() - clock.wall) / 1000) * transport.speed : clock.t;
  }

  function tick() {
    if (!transport.playing) return;
    while (index < last && times[index + 1] <= now() + 1e-9) play(index + 1);
    if (index < last) return;
    if (transport.loop) {
      seek(times[0]);
      return;
    }
    change({ playing: false });
    ended();
  }

  function frame(k) {
    const whole = Object.fromEntries(Object.entries(frames.whole).map(([key, values]) => [key, values[k]]));
    const sparse = Object.entries(frames.sparse).map(([key, values]) => [key, values.find(([at]) => at === k)?.[1]]);
    return { reason: "", cause: null, sent: null, ...whole, ...Object.fromEntries(sparse.filter(([, value]) => value !== undefined)) };
  }

  function play(k) {
    index = k;
    seq += 1;
    send({ type: "frames", seq, conflated: 0, frames: [{ ...frame(k), seq, sent: performance.now() }] });
    for (; messages[sentMessages]?.seq <= k; sentMessages++) pass(messages[sentMessages].message);
    sendHeadline();
    for (const listener of listeners) listener(times[k]);
  }

  function pass(message) {
    if (message.type === "alarm") {
      const alarm = { ...message.alarm, raised: serverTime() };
      alarms.set(alarm.id, alarm);
      send({ ...message, alarm });
    } else send(message);
  }

  /** As the server decided it, with its alarms open or acknowledged. */
  function sendHeadline() {
    const pair = headlines.findLast((one) => one.seq <= index)?.pair;
    if (pair === undefined) return;
    const isOpen = [...alarms.values()].some(({ acknowledged }) => acknowledged === null);
    const decided = pair[isOpen ? 0 : 1];
    const message = { type: "status", ...(transport.playing ? decided : paused(decided)) };
    const text = JSON.stringify(message);
    if (text !== headline) send(message);
    headline = text;
  }

  /** As core/monitor/status.py decides it. */
  function paused(now) {
    if (!CALM.includes(now.level)) return { ...now, beside: [...now.beside, "paused"] };
    return { ...now, status: "paused", level: "advisory", beside: now.status === "no_alert" ? ["no_alert"] : [] };
  }

  function change(given) {
    clock.t = now();
    clock.wall = performance.now();
    Object.assign(transport, given, { position: times[Math.max(index, 0)], sample: index });
    send({ type: "transport", transport });
    sendHeadline();
  }

  function seek(t) {
    const found = times.findLastIndex((time) => time <= t + 1e-9);
    const k = Math.max(found, 0);
    Object.assign(clock, { t: times[k], wall: performance.now() });
    send({ type: "reset", seq: seq + 1, t: times[k], held: [] });
    play(k);
    change({});
  }

  const actions = {
    play: () => {
      if (index === last) seek(times[0]);
      change({ playing: true });
    },
    pause: () => {
      change({ playing: false });
      clock.t = times[Math.max(index, 0)];
    },
    step: (by) => {
      change({ playing: false });
      seek(times[Math.min(last, Math.max(0, index + by))]);
    },
    seek,
    speed: (speed) => change({ speed }),
    loop: (loop) => change({ loop }),
    next_alert: () => {
      const next = messages.find(({ message }) => message.type === "alarm" && message.alarm.t > times[index] + 1e-9);
      if (next === undefined) throw new ApiError("No alert follows.", 409);
      seek(next.message.alarm.t);
    },
  };

  function acknowledge(id) {
    const alarm = { ...alarms.get(id), acknowledged: serverTime(), by: "you" };
    alarms.set(id, alarm);
    send({ type: "alarm", alarm });
    sendHeadline();
    return alarm;
  }

  const here = `/flights/${hello.flight}/`;
  const stand = {
    ...api,
    get: async (asked) => {
      if (asked === "/limit-sets") return [];
      if (asked.startsWith("/monitors/")) return SIMULATED; // the server does not have the recorded monitor
      if (!asked.startsWith(here)) return api.get(asked);
      return { frames: times.map((_, k) => ({ ...frame(k), seq: k })) };
    },
    post: async (asked, body) => {
      if (!asked.startsWith(here)) return api.post(asked, body);
      const [kind, id] = asked.slice(here.length).split("/");
      if (kind === "alarms") return acknowledge(id);
      return actions[body.action](body.value);
    },
  };

  function close() {
    timers.forEach(clearInterval);
    socket = null;
  }

  return {
    Socket,
    api: stand,
    moved: (listener) => listeners.add(listener),
    close,
  };
}
