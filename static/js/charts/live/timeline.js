/**
 * The time that every strip shares: the clock of the flight, and the window that follows it.
 *
 * The right edge runs by the wall clock, not by packets: when data stops it moves on, and the
 * strips show how old the last sample is. While the flight is paused or over it does not move.
 * Flight time t is in seconds; wall times are `performance.now()` in milliseconds.
 *
 * createTimeline({seconds, dt, lead, staleAfter, start}) -> Timeline, with all of TimeWindow of ../time_window.js
 *     seconds: width of the live window.   start: time of the first sample, which a live window does not begin before
 *     lead: how far forecasts reach past now.   staleAfter: age that is too great, at speed 1
 *   setRoom(seconds)                      forecasts reach so far past now, too: a live window has room for the farthest
 *   observe(t, wall)                      a sample of time t has arrived;   heard(wall)   samples that are not shown yet
 *   begin(wall)                           the page begins to listen: it calls nothing stale before SETTLED
 *   setTransport({playing, speed}, wall), playing     whether the flight's clock runs
 *   now(wall) -> t | NaN                  flight time at the right edge; NaN before any sample
 *   setAge(ageAt)                         ageAt(wall) -> s | NaN: how old the newest sample is, where more is known than when it arrived
 *   age(wall) -> s | NaN                  of the newest sample; since it arrived unless more is known
 *   staleAfter, stale(wall)               age from which on it is too great [s]; whether it is, for a flight that plays
 */

import { createTimeWindow } from "../time_window.js";

const LONGEST = 3600;
const SHORTEST = 0.25;
const INTERVALS = 3; // as played, that slow play is waited for
const SETTLED = 1000; // ms in which a page that opens, strips and scene, may be late itself
const ROOM = 0.3; // largest share of a live window after the newest time
const SILENT = 0.4; // of a live window, at most, that shows no samples: the last good ones stay in sight

export function createTimeline({ seconds = 60, dt = 0.02, lead = 0, staleAfter = 0.25, start = -Infinity } = {}) {
  let room = 0;
  const clock = { t: NaN, wall: NaN, newest: NaN, arrived: NaN, speed: 1, playing: true };
  const shown = createTimeWindow({ width: seconds, least: SHORTEST, longest: LONGEST, follow });
  const { changed } = shown;
  let settled = -Infinity;
  let ageAt = (_wall) => NaN;

  const timeline = {
    __proto__: shown,
    setRoom: (seconds) => {
      if (seconds > room) room = Math.min(seconds, ROOM * shown.width);
    },
    observe,
    heard: (wall) => {
      clock.arrived = wall;
    },
    begin: (wall) => {
      settled = wall + SETTLED;
    },
    setTransport,
    get playing() {
      return clock.playing;
    },
    now,
    setAge: (given) => {
      ageAt = given;
    },
    age: (wall) => {
      const known = ageAt(wall);
      return Number.isFinite(known) ? known : silence(wall);
    },
    get staleAfter() {
      return Math.max(staleAfter, (INTERVALS * dt) / clock.speed);
    },
    stale: (wall) => clock.playing && wall > settled && silence(wall) > timeline.staleAfter,
    reset: () => {
      Object.assign(clock, { t: NaN, wall: NaN, newest: NaN, arrived: NaN });
      shown.forget();
    },
  };

  const silence = (wall) => (wall - clock.arrived) / 1000;

  function now(wall) {
    if (!clock.playing) return clock.t;
    return clock.t + (Math.max(0, wall - clock.wall) / 1000) * clock.speed;
  }

  /** Follow the earliest arrivals; fall back slowly when samples keep coming later. */
  function observe(t, wall) {
    const late = now(wall) - t;
    const plausible = late >= 0 && late <= timeline.staleAfter * clock.speed;
    const passed = (Math.max(0, wall - clock.wall) / 1000) * clock.speed;
    const edge = plausible ? now(wall) - Math.min(0.02 * late, 0.1 * passed) : t;
    Object.assign(clock, { t: edge, wall, newest: t, arrived: wall });
  }

  function setTransport({ playing = clock.playing, speed = clock.speed }, wall = performance.now()) {
    const edge = playing ? now(wall) : clock.newest; // a pause leaves no lag behind
    const anew = !clock.playing || speed !== clock.speed;
    if (playing && anew) clock.arrived = wall; // the wait begins when play does, or its pace
    Object.assign(clock, { t: edge, wall, playing, speed });
    changed();
  }

  function follow(width, wall) {
    const edge = now(wall);
    const last = Number.isNaN(edge) ? 0 : Math.min(edge, clock.newest + SILENT * width);
    const end = Math.max(last + Math.max(lead, room), start + width);
    return { start: end - width, end, now: edge };
  }

  return timeline;
}
