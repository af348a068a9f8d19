/**
 * Puts a flight's frames into the ring buffer: their flags, and the newest state.
 *
 * createIntake({ring, channels, strips, dt}) -> Intake     series: channels, risk, margin, forecasts of the strips,
 *     risk by the first monitor for display where a strip has one beside its own
 *   push(frames) -> how many were stored;   insert(frames, complete)    earlier ones; complete: the sample after them follows
 *   status -> {state, alert}          of the newest frame, or as set by setStatus;   sensor -> as the newest frame has it
 */

import { stripState } from "../../lib/states.js";
import { MARGIN, marginAt, single } from "../strips.js";
import { BROKEN, FLAG } from "./ring_buffer.js";

const NO_DATA = { state: "none", alert: false };

export function createIntake({ ring, channels, strips, dt }) {
  const placeOf = new Map(channels.map(({ key }, k) => [key, k]));
  const forecasting = strips.filter(({ risk, forecast }) => !risk && forecast !== null);
  const isMargined = strips.some(({ key }) => key === MARGIN);
  const first = channels.length + 2; // series of forecasts
  const isCompared = strips.some(({ beside }) => beside !== null);
  const row = new Float64Array(first + forecasting.length + (isCompared ? 1 : 0));
  let status = NO_DATA;
  let sensor = {};
  let seq = null;

  function push(frames) {
    const before = ring.count();
    for (const frame of frames) store(frame);
    return ring.count() - before;
  }

  /** Values of a frame as the ring buffer holds them; the same array each time. */
  function rowOf(frame) {
    for (let k = 0; k < channels.length; k++) row[k] = number(frame.y[k]);
    row[channels.length] = riskOf(frame);
    if (isCompared) row[row.length - 1] = riskOf(frame.display?.[0]);
    row[channels.length + 1] = isMargined ? marginOf(frame.y, frame.t) : NaN;
    forecasting.forEach(({ key }, k) => {
      row[first + k] = key === MARGIN ? marginOf(frame.y_hat, frame.t) : valueOf(frame.y_hat, key);
    });
    return row;
  }

  const riskOf = (assessment) => (assessment?.state === "ok" ? number(assessment.p_value) : NaN);

  const valueOf = (values, key) => number(values?.[placeOf.get(key)]);

  function marginOf(values, t) {
    return marginAt(strips, t, ({ key }) => single(valueOf(values, key))).high;
  }

  function store(frame) {
    const stored = ring.push(frame.t, rowOf(frame), flagsOf(frame));
    status = { state: stripState(frame), alert: frame.alert === true && frame.state === "ok" };
    if (!stored) return;
    seq = frame.seq ?? null;
    sensor = frame.sensor ?? {};
  }

  function insert(frames, complete) {
    const at = ring.after(frames[0].t);
    const end = at < ring.count() ? ring.time(at) : Infinity;
    const fits = frames.filter(({ t }) => t < end);
    if (fits.length === 0) return;
    let before = at > ring.first() ? ring.time(at - 1) : -Infinity;
    const rows = fits.map((frame) => {
      const flags = stateFlags(frame) | gapFlag(before, frame.t);
      before = frame.t;
      return { t: frame.t, row: Float64Array.from(rowOf(frame)), flags };
    });
    const follows = at < ring.count() ? ring.flags(at, at + 1) & ~BROKEN : 0;
    const isInserted = ring.insert(at, rows, follows | (complete ? gapFlag(before, end) : FLAG.thinned));
    if (isInserted && end === Infinity) seq = fits.at(-1).seq ?? null;
  }

  function gapFlag(before, t) {
    return Number.isFinite(before) && Number.isFinite(t) && t - before > 1.5 * dt ? FLAG.gap : 0;
  }

  function flagsOf(frame) {
    const n = ring.count();
    const thinned = n > 0 && seq !== null && frame.seq != null && frame.seq > seq + 1;
    return stateFlags(frame) | (thinned ? FLAG.thinned : n > 0 ? gapFlag(ring.time(n - 1), frame.t) : 0);
  }

  function stateFlags(frame) {
    const alert = frame.alert === true && frame.state === "ok" ? FLAG.alert : 0;
    return (FLAG[stripState(frame)] ?? 0) | alert;
  }

  return {
    push,
    insert,
    get status() {
      return status;
    },
    get sensor() {
      return sensor;
    },
    setStatus: (given) => {
      status = given;
    },
    clear: () => {
      status = NO_DATA;
      sensor = {};
      seq = null;
    },
  };
}

function number(value) {
  return typeof value === "number" ? value : NaN;
}
