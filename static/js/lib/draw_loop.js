/**
 * One animation loop for everything that moves on the page, capped at 30 frames a second.
 *
 * A hidden page draws nothing. After the page was held up, by work or in a hidden tab, waiting messages
 * are let in before it draws, so that they do not count as missing. Benchmarks read the cost of each turn.
 *
 * Exports
 *   addDrawer(draw) -> remove    draw(wall) is called each turn, wall in `performance.now()` ms
 *   loopStats() -> {turns, total, worst}    turns drawn and their time [ms] since the last call
 */

const INTERVAL = 1000 / 30;
const HELD_UP = 100; // ms since the last turn
const LET_IN = 50; // ms for waiting messages
const drawers = new Set();
let due = 0;
let last = 0;
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
  drawOrLetIn();
}

function drawOrLetIn() {
  const begin = performance.now();
  const heldUp = begin - last > HELD_UP;
  last = begin;
  if (heldUp) {
    due = begin + LET_IN;
    setTimeout(drawOrLetIn, LET_IN);
    return;
  }
  for (const draw of drawers) draw(begin);
  const cost = performance.now() - begin;
  stats.turns += 1;
  stats.total += cost;
  stats.worst = Math.max(stats.worst, cost);
}
