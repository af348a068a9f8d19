/**
 * One animation loop for everything that moves on the page, capped at 30 frames a second.
 *
 * A hidden page draws nothing. What each turn costs is kept, so that a benchmark can ask.
 *
 * Exports
 *   addDrawer(draw) -> remove    draw(wall) is called each turn, wall in `performance.now()` ms
 *   loopStats() -> {turns, total, worst}    turns drawn and their time [ms] since the last call
 */

const INTERVAL = 1000 / 30;
const drawers = new Set();
let due = 0;
let running = false;
let stats = { turns: 0, total: 0, worst: 0 };

/** @param {(wall: number) => void} draw @returns {() => void} */
export function addDrawer(draw) {
  drawers.add(draw);
  if (!running) {
    running = true;
    requestAnimationFrame(turn);
  }
  return () => drawers.delete(draw);
}

export function loopStats() {
  const since = stats;
  stats = { turns: 0, total: 0, worst: 0 };
  return since;
}

function turn(stamp) {
  running = drawers.size > 0;
  if (!running) return;
  requestAnimationFrame(turn);
  if (stamp < due - 2) return; // 2 ms of grace: a 60 Hz screen then gives exactly every second frame
  due = Math.max(due + INTERVAL, stamp);
  const begin = performance.now();
  for (const draw of drawers) draw(begin);
  const cost = performance.now() - begin;
  stats.turns += 1;
  stats.total += cost;
  stats.worst = Math.max(stats.worst, cost);
}
