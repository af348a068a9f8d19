/**
 * Play, pause, step, seek, speed, loop, next alert and event: buttons, a slider and keys.
 *
 * createTransportBar(element, {act, end}) -> TransportBar
 *     act(action, value) -> Promise    asks the server; rejects with the reason
 *     end()                            ends the flight; null where it cannot be ended
 *   show(transport, isLed)    the server's state; its newest samples may not have arrived yet.   isLed: by another screen
 *   moved(t), arrived()  time of the newest sample drawn [s], null for none; the samples after the last seek are drawn
 *   steers()             whether this user can steer the flight
 *   t                    time shown [s]: of the newest sample drawn, or the one sought
 *   mark([{t, level}])   drawn above the slider; "To the next event" steps through them
 *   setUsable(boolean)   false while there is no connection
 *   keys                 {key: act} for the page's shortcuts
 */

import { may, needs } from "../../lib/api.js";
import { dayClock, formatTime, secondsText } from "../../lib/clock.js";
import { errorLine, h, put } from "../../lib/dom.js";

const STEER = "POST /flights/{}/transport";
const KEYS = { " ": "space", ",": "comma", ".": "period" }; // in words
const SPEEDS = [0.1, 0.2, 0.5, 1, 2, 5, 10];

export function createTransportBar(element, { act, end }) {
  element.classList.add("transport");
  let transport = { playing: false, speed: 1, loop: false, start: 0, duration: null, seekable: true };
  let isLed = false;
  let drawn = null; // time of the newest sample drawn
  let marked = []; // times of the marks, rising
  let dragging = false;
  let wanted = null; // next time to seek to, while a seek is in progress
  let seeking = false;
  let sought = null; // shown until its samples arrive

  /** [name, text, label, key, act] */
  const commands = [
    ["start", "|◀", "To the start", "0", () => seek(transport.start)],
    ["back", "◀|", "One sample back", ",", () => send("step", -1)],
    ["play", "▶", "Play", " ", toggle],
    ["step", "|▶", "One sample on", ".", () => send("step", 1)],
    ["next_alert", "▲▶", "To the next alert", "n", () => send("next_alert")],
    ["next_event", "◆▶", "To the next event", "j", toNextEvent],
    ["loop", "Loop", "Loop", "o", () => send("loop", !transport.loop)],
  ];
  const titled = (label, key) => `${label} (key ${KEYS[key] ?? key.toUpperCase()})`;
  const buttons = commands.map(([name, text, label, key, onclick]) =>
    h("button.button.button-small", { type: "button", "aria-label": label, title: titled(label, key), onclick, "data-action": name }, text),
  );
  const [play, event, loop] = ["play", "next_event", "loop"].map((wanted) => buttons[commands.findIndex(([name]) => name === wanted)]);
  const speed = h("select", { class: "speed", "aria-label": "Speed", title: "Speed (keys [ and ])", onchange: () => send("speed", Number(speed.value)) });
  for (const factor of SPEEDS) speed.append(h("option", { value: factor }, `${factor}×`));
  const slider = h("input", { type: "range", class: "scrub", min: 0, max: 1, step: "any", "aria-label": "Time in the flight" });
  const marks = h("div", { class: "scrub-marks", "aria-hidden": "true" });
  const track = h("div", { class: "scrub-track" }, marks, slider);
  const time = h("span", { class: "transport-time" });
  const failure = errorLine("transport-error");
  const stop = h("button", { type: "button", class: "button button-small", title: "End this flight; its record is kept", onclick: end, hidden: end === null, ...needs("POST /flights/{}/end") }, "End flight");
  element.append(...buttons, speed, track, time, stop, failure.element);

  slider.addEventListener("input", () => {
    dragging = true;
    seek(Number(slider.value));
  });
  slider.addEventListener("change", () => {
    dragging = false;
  });

  /** A live source cannot be steered, nor can what another screen leads, nor a shared flight by a viewer. */
  const steers = () => transport.seekable && !isLed && may(STEER);

  async function send(action, value) {
    if (!steers()) return;
    if (await failure.attempt(() => act(action, value))) return; // the change arrives by the stream, in order
    sought = null;
    showTime();
  }

  /** One seek at a time; meanwhile only the newest request is kept. */
  async function seek(t) {
    if (!steers()) return;
    wanted = sought = t;
    showTime();
    if (seeking) return;
    seeking = true;
    while (wanted !== null) {
      const target = wanted;
      wanted = null;
      await send("seek", target);
    }
    seeking = false;
  }

  function toggle() {
    return send(transport.playing ? "pause" : "play");
  }

  function shownTime() {
    return sought ?? drawn ?? transport.start;
  }

  function toNextEvent() {
    if (!steers()) return Promise.resolve();
    const later = marked.find((t) => t > shownTime() + 1e-6);
    if (later !== undefined) return seek(later);
    failure.show("No event follows. Seek back to find one.");
    return Promise.resolve();
  }

  function faster(by) {
    const at = SPEEDS.findIndex((factor) => factor >= transport.speed - 1e-9);
    const factor = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, at + by))];
    if (factor !== transport.speed) send("speed", factor);
  }

  function show(now, isLedNow = false) {
    [transport, isLed] = [now, isLedNow];
    const { playing, duration } = now;
    put(play, playing ? "❚❚" : "▶");
    const label = playing ? "Pause" : "Play";
    play.setAttribute("aria-label", label);
    play.title = titled(label, " ");
    play.dataset.playing = String(playing);
    loop.setAttribute("aria-pressed", String(now.loop));
    if (![...speed.options].some((option) => Number(option.value) === now.speed)) {
      speed.append(h("option", { value: now.speed }, `${now.speed}×`));
    }
    speed.value = String(now.speed);
    slider.min = String(now.start);
    slider.max = String(now.start + (duration ?? 1));
    for (const part of [...buttons, speed, track]) part.hidden = !steers();
    event.hidden = !steers() || marked.length === 0;
    showTime();
  }

  function moved(t) {
    if (t === drawn) return;
    drawn = t;
    showTime();
  }

  function arrived() {
    if (wanted === null) sought = null;
    showTime();
  }

  function showTime() {
    const { start, duration } = transport;
    const t = sought ?? drawn;
    const unit = dayClock() === null ? " s" : "";
    const words = t === null ? "–" : `${sought === null ? "" : "→ "}${formatTime(t, 0.01)}`;
    put(time, duration === null ? `${words}${unit}` : `${words} / ${secondsText(start + duration)}`);
    time.title = sought === null ? "Time of the newest sample shown" : "Seeking: its samples have not arrived yet";
    slider.setAttribute("aria-valuetext", t === null ? "no sample shown" : secondsText(t));
    if (!dragging && sought === null) slider.value = String(drawn ?? start);
  }

  function mark(times) {
    const { start, duration } = transport;
    marked = times.map(({ t }) => t).sort((a, b) => a - b);
    event.hidden = !steers() || marked.length === 0;
    marks.replaceChildren(
      ...times
        .filter(() => duration > 0)
        .map(({ t, level }) =>
          h("span", { class: "scrub-mark", "data-level": level, style: `left:${(100 * (t - start)) / duration}%` }, level === "alert" ? "▲" : "◆"),
        ),
    );
  }

  const keys = {
    ...Object.fromEntries(commands.map(([, , , key, act]) => [key, act])),
    "[": () => faster(-1),
    "]": () => faster(1),
  };

  return {
    show,
    steers,
    moved,
    arrived,
    mark,
    seek,
    keys,
    get t() {
      return shownTime();
    },
    setUsable: (usable) => {
      if (!usable) sought = null;
      showTime();
      for (const part of [...buttons, speed, slider, stop]) part.disabled = !usable;
      failure.show("");
    },
  };
}
