/**
 * A recorded flight that plays once by the page's clock: it stands in for the server's socket and its routes.
 *
 * createRecordedFlight(recording, api, {moved, ended}) -> {Socket, api, close()}
 *     recording: as tests/support/demonstration_recording.py writes it
 *     api: the server's, for whatever is not of this flight.   moved(t): after each sample.   ended(): the last one was played
 */

const TICK = 20; // ms
const BEAT = 1000; // ms between heartbeats

const SIMULATED = { dataset: null, reason: "the recorded demonstration has no simulated flights", quantiles: [0, 1], band: null, forecast: null };

export function createRecordedFlight({ hello, messages, headlines, frames }, api, { moved, ended }) {
  const times = frames.whole.t;
  const alarms = new Map(); // by id, as last sent
  const transport = { ...hello.transport, playing: true, seekable: false };
  let socket = null;
  let began = 0; // ms
  let seq = -1; // of the newest frame sent
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
    began = performance.now();
    timers = [setInterval(tick, TICK), setInterval(beat, BEAT)];
    beat();
  }

  function beat() {
    send({ type: "heartbeat", server_time: serverTime(), sent: performance.now(), lost: 0, unwritten: 0, problem: "", conflated: 0 });
  }

  function tick() {
    if (!transport.playing) return;
    const now = times[0] + (performance.now() - began) / 1000;
    while (times[seq + 1] <= now + 1e-9) play();
    if (seq < times.length - 1) return;
    transport.playing = false;
    send({ type: "transport", transport });
    ended();
  }

  function play() {
    seq += 1;
    send({ type: "frames", seq, conflated: 0, frames: [{ ...frameOf(seq), seq, sent: performance.now() }] });
    for (; messages[sentMessages]?.seq <= seq; sentMessages++) pass(messages[sentMessages].message);
    sendHeadline();
    moved(times[seq]);
  }

  function frameOf(k) {
    const whole = Object.fromEntries(Object.entries(frames.whole).map(([key, values]) => [key, values[k]]));
    const sparse = Object.entries(frames.sparse).map(([key, values]) => [key, values.find(([at]) => at === k)?.[1]]);
    return { reason: "", cause: null, ...whole, ...Object.fromEntries(sparse.filter(([, value]) => value !== undefined)) };
  }

  function pass(message) {
    if (message.type === "alarm") sendAlarm({ ...message.alarm, raised: serverTime() });
    else send(message);
  }

  function sendAlarm(alarm) {
    alarms.set(alarm.id, alarm);
    send({ type: "alarm", alarm });
    return alarm;
  }

  /** As the server decided it, with its alarms open or acknowledged. */
  function sendHeadline() {
    const pair = headlines.findLast((each) => each.seq <= seq)?.pair;
    if (pair === undefined) return;
    const isOpen = [...alarms.values()].some(({ acknowledged }) => acknowledged === null);
    const text = JSON.stringify({ type: "status", ...pair[isOpen ? 0 : 1] });
    if (text !== headline) send(JSON.parse(text));
    headline = text;
  }

  function acknowledge(id) {
    const alarm = sendAlarm({ ...alarms.get(id), acknowledged: serverTime(), by: "you" });
    sendHeadline();
    return alarm;
  }

  const here = `/flights/${hello.flight}/alarms/`;
  const stand = {
    ...api,
    get: async (asked) => {
      if (asked === "/limit-sets") return [];
      return asked.startsWith("/monitors/") ? SIMULATED : api.get(asked); // the server does not have the recorded monitor
    },
    post: async (asked, body) => (asked.startsWith(here) ? acknowledge(asked.slice(here.length).split("/")[0]) : api.post(asked, body)),
  };

  function close() {
    timers.forEach(clearInterval);
    socket = null;
  }

  return { Socket, api: stand, close };
}
