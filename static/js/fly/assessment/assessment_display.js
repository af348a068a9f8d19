/**
 * The monitor's assessments of a flight, sample by sample, on the strips, the gauge and the alarm line.
 *
 * createAssessmentDisplay(panels, {hello, api, path, alarm, events, address}) -> Display     path: of the flight
 *   onFrames(frames)           newest last; returns the newest that is shown, or null
 *   restart(t, showLimits) -> Promise<frames | null>    after a seek or a loop: draws what lies before t [s]
 *   forget()                   clears the strips: the samples shown were lost
 *   setAssessment({state, reason, cause}, quiet)    as the server says it, without a sample
 *   setHeadline({status, level, beside})     as the server decided it
 *   setLinked(boolean)         whether the server is heard: false from the first missed heartbeat on
 *   useAuthority()             the alarm authority in hello changed
 *   lose(), resume()           the connection; after it the newest sample counts again
 *   refresh(wall) -> Headline      draws the gauge; returns the headline for every view, stale where samples stopped
 *   withdrawal, cause, reason  cause of the newest invalid sample; why it is stale, empty without a reason; why there is no
 *                              assessment now, without the word of its state
 *   newest                     the newest frame; null for none
 */

import { createFlightChart } from "../../charts/live/flight_chart.js";
import { createTimeline } from "../../charts/live/timeline.js";
import { createSimulated } from "../../charts/simulated.js";
import { keepWindow } from "../../lib/address.js";
import { createComparison } from "../../lib/comparison.js";
import { reasonOf, shownState } from "../../lib/states.js";
import { alertLevel } from "../flight_monitors.js";
import { headlineOf, isStale } from "../headline.js";
import { windowOf } from "../panels.js";
import { createStarts } from "../source/manoeuvre_starts.js";
import { createRestOfCard } from "./rest_of_card.js";
import { createRiskAhead } from "./risk_ahead.js";
import { createRiskGauge } from "./risk_gauge.js";

const MOST = 5000; // samples before a point that is sought
const PAGE = 10_000; // frames that the server sends at once
const READING = 1000; // ms that reading the source may take
const LOST = { state: "stale", reason: "connection lost", cause: null };
const ALARMED = ["stale", "invalid"]; // cautions, which are listed as alarms

export function createAssessmentDisplay(panels, { hello, api, path, alarm, events, address }) {
  const { channels, lead, dt } = hello;
  const alertAbove = alertLevel(hello);
  const timeline = createTimeline({ seconds: windowOf(hello), lead, dt, staleAfter: hello.stale_after, start: hello.transport.start });
  timeline.begin(performance.now());
  const history = createSeekHistory(api, path, hello.transport);
  const gauge = createRiskGauge(panels.gauge, timeline);
  const ahead = createRiskAhead(panels.ahead, hello.monitors);
  if (hello.monitors.length > 1) panels.ahead.append(createComparison(api, path));
  const rest = createRestOfCard(panels.rest, hello.no_rest);
  const chart = createFlightChart(panels.strips, {
    channels,
    alertAbove,
    lead,
    dt,
    timeline,
    address,
    beside: hello.monitors[1]?.name,
    panels: panels.arranged,
    simulated: hello.monitor_set ? null : createSimulated(api, hello.monitors[0].id),
    starts: createStarts({ api, source: hello.source, live: () => hello.live, start: hello.transport.start }),
  });
  panels.strips.after(chart.editor, chart.cross);
  keepWindow(address, timeline);
  let assessment = { state: null, reason: "", cause: null };
  let newest = null; // frame
  let sampled = false; // a sample was shown
  let origin = 0; // where the flight continues from, before its next sample [s]
  let decided = hello; // the server's headline
  let linked = true;
  let late = null; // the server's state for samples that arrive late

  function onFrames(frames) {
    if (frames.length === 0) return null;
    if (history.waits) {
      const wall = performance.now();
      if (history.keep(frames, wall)) timeline.heard(wall);
      return null;
    }
    chart.push(frames);
    newest = frames.at(-1);
    ahead.onFrame(newest);
    show(newest);
    return newest;
  }

  function show(frame) {
    sampled = true;
    const { state, reason, cause } = late ?? frame;
    if (state !== assessment.state || reason !== assessment.reason) setAssessment({ state, reason, cause });
    if (late !== null) {
      withdraw();
      return;
    }
    gauge.update({ ...frame, alertAbove: levelNow() });
  }

  /** Of the alarm authority, which changes with the flight condition of a monitor set; NaN where none is in use. */
  const levelNow = () => (hello.monitor_set?.case === "" ? NaN : hello.monitors[0].alert_above);

  function headlineNow(wall) {
    const blank = !sampled && assessment.state === "ok";
    return headlineOf(decided, { stale: !linked || timeline.stale(wall), alarms: alarm.open(), blank });
  }

  /** The monitor's state; without an assessment a word takes the number's place. */
  function setAssessment({ state, reason, cause = null }, quiet = false) {
    const changed = shownState({ state, cause }) !== shownState(assessment);
    assessment = { state, reason, cause };
    alarm.show({ assessment: { ...assessment, last: lastCause() } });
    if (state !== "ok") withdraw();
    if (!changed || quiet || ALARMED.includes(shownState(assessment))) return;
    const why = reason ? `: ${reason}` : "";
    const text = `monitor ${shownState(assessment).replace("_", " ")}${why}`;
    events.add({ t: newest?.t ?? origin, text });
  }

  /** Cause of the newest sample, also after it has become stale. */
  function lastCause() {
    return assessment.state === "stale" && newest !== null ? newest.cause : assessment.cause;
  }

  function withdraw() {
    gauge.update({ ...assessment, p_value: null, said: lastCause(), alertAbove: levelNow() });
    chart.setState(assessment);
  }

  async function restart(t, showLimits) {
    newest = null;
    ahead.onFrame(null);
    origin = t;
    const read = await history.readBefore(t);
    if (read === null) return null;
    chart.clear();
    showLimits();
    if (read.before.length > 0) chart.push(read.before);
    return onFrames(read.frames);
  }

  /** The server's state: stale stays until the server changes it. */
  function setServerState(given, quiet) {
    late = given.state === "stale" ? given : null;
    setAssessment(given, quiet);
  }

  function forget() {
    newest = null;
    ahead.onFrame(null);
    chart.clear();
  }

  function lose() {
    assessment = LOST;
    alarm.show({ assessment: { ...assessment, last: lastCause() } });
    withdraw();
  }

  function resume() {
    if (newest === null || late !== null || assessment.state !== newest.state) return;
    chart.push(newest); // only its state, after the loss
    show(newest);
  }

  return {
    timeline,
    chart,
    onFrames,
    restart,
    forget,
    setAssessment: setServerState,
    setHeadline: (given) => {
      decided = given;
    },
    setLinked: (isLinked) => {
      linked = isLinked;
      chart.setLinked(isLinked);
    },
    lose,
    resume,
    useAuthority: () => {
      panels.rest.hidden = Boolean(hello.no_rest);
    },
    get withdrawal() {
      return lastCause();
    },
    get cause() {
      return assessment.state === "stale" ? assessment.reason : "";
    },
    get reason() {
      return assessment.state === "ok" ? "" : reasonOf(assessment);
    },
    get newest() {
      return newest;
    },
    refresh: (wall) => {
      const headline = headlineNow(wall);
      const stale = isStale(headline);
      rest.draw(stale, linked && late === null ? chart.ahead : null, newest?.t ?? 0, sampled ? shownState(assessment) : null, hello.channels, headline);
      gauge.draw(wall, headline);
      ahead.draw(stale);
      return headline;
    },
    close: () => {
      history.close();
      chart.destroy();
    },
  };
}

/**
 * A seek in a flight: frames wait until the samples before that point have been read, so that the strips are never empty.
 *
 * waits    whether frames wait;   keep(frames, wall) -> bool     false once they have waited so long that they count as late
 * readBefore(t) -> Promise<{before, frames} | null>     before: at most MOST source samples, oldest first; frames: those
 *     that waited. Null where another seek overtook this one
 */
function createSeekHistory(api, path, { n_samples: samples, start, duration, seekable }) {
  const isOnePage = samples !== null && samples <= PAGE;
  let source = null; // all of it, where it is one page
  let waiting = null;
  let began = 0;
  let turn = 0;

  async function read(t) {
    if (isOnePage) return api.get(`${path}/source?first=0&last=${samples - 1}`);
    const index = Math.round(((t - start) / duration) * (samples - 1));
    return api.get(`${path}/source?first=${Math.max(0, index - MOST)}&last=${index}`);
  }

  async function framesBefore(t) {
    if (!seekable || t <= start) return [];
    try {
      const { frames } = source ?? (await read(t));
      if (isOnePage) source = { frames };
      const end = frames.findIndex((frame) => frame.t >= t - 1e-9);
      const before = end < 0 ? frames : frames.slice(0, end);
      return before.slice(-MOST).map(({ seq: _, ...frame }) => frame);
    } catch {
      return []; // the strips then begin at t
    }
  }

  async function readBefore(t) {
    const mine = ++turn;
    waiting = [];
    began = performance.now();
    const before = await framesBefore(t);
    if (mine !== turn) return null;
    const frames = waiting;
    waiting = null;
    return { before, frames };
  }

  return {
    get waits() {
      return waiting !== null;
    },
    keep: (frames, wall) => {
      waiting.push(...frames);
      return wall - began < READING;
    },
    readBefore,
    close: () => {
      turn += 1;
    },
  };
}
