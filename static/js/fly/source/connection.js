/**
 * A flight's WebSocket: the one module that opens it and keeps it open.
 *
 * It answers frames with credit, reconnects after a loss and asks for the missed frames, drops a silent
 * connection, and measures age, latency and loss.
 *
 * createConnection(flight, on) -> Connection     on: what to call for each message, and
 *     on.hello(hello, again)       again: the page already shows this flight
 *     on.frames(frames, message)   new samples, oldest first, each once
 *     on.reset({seq, t, since, held})  the next frame, seq, does not follow the last one; the record has since..seq-1
 *     on.gap(first, last)          samples first..last were not sent: the server has them in the flight's record
 *     on.link(link)                "connecting" | "open" | "silent" (a heartbeat is missing) | "lost" | "over"
 *     on.screens({screens, leader})    the screens of the flight; the id of this one is SCREEN
 *     on.over(reason)              the flight has ended; nothing follows
 *   link, retryIn(wall) -> s       while lost, the time until the next attempt
 *   loggedOut    lost because the login expired: it does not reconnect
 *   figures(wall) -> {age, latency, lost, unwritten, problem, utc}
 *     age      s since the newest sample was taken; NaN before the first
 *     latency  ms from due to here, above the quickest message of the last minute plus half a
 *              round trip; NaN before the first
 *     lost     samples the server could not record
 *     unwritten, problem   samples that wait for the server's disk, and why it takes none at present
 */

const INNER = ["alarm", "marker", "transport", "live"]; // messages of which only their content is of interest
const DRAWN = 4; // messages of frames that are credited at once: a quarter of what the server gives
const BEAT = 1000; // ms between the server's heartbeats
const LATE = 600; // ms that a heartbeat may be late
const SILENCE = 3500; // ms without any message before the link is lost
const LISTEN = 250; // ms between checks of both
const WAITS = [250, 500, 1000, 2000, 4000]; // ms before each next attempt
const NO_SUCH_FLIGHT = 4404;
const SESSION_OVER = 4401;
export const SCREEN = Math.random().toString(36).slice(2); // as it names itself to the server
const WINDOW = 30_000; // ms; the quickest message of this window and the one before counts

export function createConnection(flight, on, { Socket = WebSocket } = {}) {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const address = `${scheme}://${location.host}/api/v1/flights/${encodeURIComponent(flight)}/stream?screen=${SCREEN}`;
  const clock = createServerClock();
  const counts = { lost: 0, unwritten: 0, problem: "" };
  let socket = null;
  let seen = -1; // newest seq taken
  let drawn = 0; // messages of frames since the last credit
  let knowsFlight = false;
  let newest = null; // {taken, latency} of the newest frame; latency NaN where it came late on purpose
  let backlog = -1; // head at hello: frames up to it come late on purpose
  let heard = 0;
  let beat = 0; // when the last heartbeat came
  let listenAt = 0;
  let heldUp = false; // the page itself, when it looked last
  let retryAt = NaN;
  let timer = 0;
  let closed = false;

  const connection = { link: "connecting", loggedOut: false, attempt: 0, retryIn, figures, close };

  function setLink(link) {
    if (link === connection.link) return;
    connection.link = link;
    on.link?.(link);
  }

  function connect() {
    heard = beat = performance.now();
    drawn = 0;
    const mine = new Socket(address);
    socket = mine;
    mine.addEventListener("message", (event) => {
      if (socket !== mine) return;
      heard = performance.now();
      if (connection.link === "silent") setLink("open");
      onMessage(JSON.parse(event.data));
    });
    mine.addEventListener("close", (event) => {
      if (socket === mine) onClose(event.code);
    });
    listenLater(2 * LISTEN);
  }

  /** When the next heartbeat counts as missing. */
  const missedAt = () => Math.max(beat + BEAT, heard) + LATE;

  function listenLater(wait) {
    listenAt = performance.now() + wait;
    timer = setTimeout(listen, wait);
  }

  /**
   * A silent connection counts as lost, whatever the socket reports. After the page itself was held up,
   * it checks twice: messages may be waiting.
   */
  function listen() {
    const now = performance.now();
    heldUp = !heldUp && now - listenAt > 2 * LISTEN;
    if (!heldUp && connection.link === "open" && now >= missedAt()) setLink("silent");
    if (!heldUp && now - heard > SILENCE) {
      const silent = socket;
      onClose(0);
      shut(silent);
      return;
    }
    listenLater(connection.link === "open" ? Math.min(LISTEN, Math.max(missedAt() - now, 1)) : LISTEN);
  }

  function onClose(code) {
    clearTimeout(timer);
    socket = null;
    if (closed || connection.link === "over") return;
    if (code === NO_SUCH_FLIGHT) {
      finish("the flight has ended");
      return;
    }
    if (code === SESSION_OVER) {
      connection.loggedOut = true;
      setLink("lost");
      return;
    }
    const wait = WAITS[Math.min(connection.attempt, WAITS.length - 1)];
    connection.attempt += 1;
    retryAt = performance.now() + wait;
    setLink("lost");
    timer = setTimeout(connect, wait);
  }

  function finish(reason) {
    setLink("over");
    on.over?.(reason);
  }

  const handlers = {
    hello: (message) => {
      const again = knowsFlight;
      [knowsFlight, backlog, connection.attempt] = [true, message.head, 0];
      clock.setUtc(message.server_time);
      clock.measureRoundTrip();
      beat = heard;
      if (message.head < seen) seen = -1;
      on.hello?.(message, again);
      send({ type: "resume", seq: seen });
      setLink("open");
    },
    frames: (message) => {
      const frames = message.frames.filter((frame) => frame.seq > seen);
      const last = frames.at(-1);
      if (last !== undefined) {
        const before = seen;
        seen = last.seq;
        const { sent, taken = sent } = last;
        if (taken !== null) newest = { taken, latency: sent !== null && last.seq > backlog ? clock.latency(sent) : NaN };
        on.frames?.(frames, message);
        if (frames[0].seq > before + 1) on.gap?.(before + 1, frames[0].seq - 1);
      }
      drawn += 1;
      if (drawn < DRAWN) return;
      send({ type: "credit", n: drawn });
      drawn = 0;
    },
    reset: (message) => {
      seen = message.seq - 1;
      on.reset?.(message);
    },
    heartbeat: (message) => {
      beat = heard;
      clock.observe(message.sent);
      clock.setUtc(message.server_time);
      Object.assign(counts, { lost: message.lost, unwritten: message.unwritten, problem: message.problem });
      on.heartbeat?.(message);
    },
    end: (message) => finish(message.reason),
  };

  function onMessage(message) {
    const { type } = message;
    if (type in handlers) handlers[type](message);
    else on[type]?.(INNER.includes(type) ? message[type] : message);
  }

  function send(message) {
    if (socket?.readyState === Socket.OPEN) socket.send(JSON.stringify(message));
  }

  function retryIn(wall = performance.now()) {
    return connection.link === "lost" ? Math.max(0, (retryAt - wall) / 1000) : 0;
  }

  function figures(wall = performance.now()) {
    return {
      age: newest === null ? NaN : Math.max(0, clock.since(newest.taken, wall)) / 1000,
      latency: newest === null ? NaN : newest.latency,
      lost: counts.lost,
      unwritten: counts.unwritten,
      problem: counts.problem,
      utc: clock.utc(),
    };
  }

  function close() {
    closed = true;
    clearTimeout(timer);
    const open = socket;
    socket = null;
    if (open !== null) shut(open);
  }

  /** A browser warns about a socket that is closed before it is open. */
  function shut(socket) {
    if (socket.readyState === Socket.CONNECTING) socket.addEventListener("open", () => socket.close());
    else socket.close();
  }

  connect();
  return connection;
}

/** The server's clocks as seen from here: its monotonic milliseconds and its UTC. */
function createServerClock() {
  const quickest = [NaN, NaN]; // least (arrival - sent) of the last window and of this one
  let turned = 0;
  let half = 0; // half a round trip [ms]
  let utcOffset = NaN;

  function observe(sent) {
    const now = performance.now();
    if (now - turned > WINDOW) {
      quickest[0] = quickest[1];
      quickest[1] = NaN;
      turned = now;
    }
    const shift = now - sent;
    if (!(quickest[1] <= shift)) quickest[1] = shift;
  }

  const least = () => {
    const known = quickest.filter((value) => !Number.isNaN(value));
    return known.length > 0 ? Math.min(...known) : NaN;
  };

  const since = (sent, wall) => wall - sent - least() + half;

  return {
    observe,
    since,
    latency: (sent) => {
      observe(sent);
      return since(sent, performance.now());
    },
    setUtc: (iso) => {
      utcOffset = Date.parse(iso) - Date.now();
    },
    utc: () => (Number.isNaN(utcOffset) ? null : new Date(Date.now() + utcOffset)),
    measureRoundTrip: async () => {
      const begin = performance.now();
      try {
        await fetch("/healthz", { cache: "no-store" });
        half = Math.min(half || Infinity, (performance.now() - begin) / 2);
      } catch {
        // no answer: the socket reports it
      }
    },
  };
}
