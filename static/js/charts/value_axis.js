/**
 * The value axis of one strip: a round range that follows the data without jumping.
 *
 * It widens as soon as a value does not fit. It narrows only after the values have needed much less
 * for some seconds. Limits are always in view.
 *
 * Exports
 *   createValueAxis({limit, factor, leastHeight, narrowAfter}) -> {fit(low, high, wall), low, high, step, moving, roomy}
 *     limit: magnitude shown on both sides, or null.   factor 1: multiplies the numbers shown.   leastHeight 0.02: least height shown, in the unit.
 *     narrowAfter 4000: [ms] before a range that is too wide narrows.   roomy: it is too wide.
 *     fit takes the least and greatest visible value (low > high: none) and the wall clock [ms].
 *   createRiskAxis(scale) -> the same for risk, 0..1, "sqrt" (small risks stay legible) or "linear"
 *   axisTicks(axis) -> number[]    roundStep(least) -> number, of 1, 2, 5, 10, ...
 *   Both axes have share(value) -> 0 at the bottom .. 1 at the top; outside the range beyond.
 */

const ROOMY = 0.45; // share of the range below which it is
const EASE = 60; // [ms] time constant of the way to a new range

/** @param {{limit?: number | null, factor?: number, leastHeight?: number, narrowAfter?: number}} options */
export function createValueAxis({ limit = null, factor = 1, leastHeight = 0.02, narrowAfter = 4000 }) {
  let target = range(limit === null ? 0 : -limit, limit ?? 0);
  let roomySince = null;
  let last = NaN;
  const axis = {
    low: target.low,
    high: target.high,
    step: target.step,
    factor,
    moving: false,
    roomy: false,
    fit,
    share,
    setLimit: (given) => {
      limit = given;
      target = range(target.low, target.high);
      axis.moving = true;
    },
  };

  function range(low, high) {
    const margin = limit === null ? 0 : 1.15 * limit;
    if (limit !== null) [low, high] = [Math.min(low, -margin), Math.max(high, margin)];
    if (high - low < leastHeight)
      [low, high] = [(low + high - leastHeight) / 2, (low + high + leastHeight) / 2];
    const step = roundStep((factor * (high - low)) / 3) / factor;
    return {
      low: low === -margin && limit !== null ? low : Math.floor(low / step + 1e-6) * step,
      high: high === margin && limit !== null ? high : Math.ceil(high / step - 1e-6) * step,
      step,
    };
  }

  function fit(low, high, wall) {
    if (low <= high) {
      const margin = 0.05 * (high - low);
      if (low < target.low || high > target.high) {
        const wider = range(
          Math.min(low - margin, target.low),
          Math.max(high + margin, target.high),
        );
        target = wider;
        roomySince = null;
      } else {
        const tight = range(low - margin, high + margin);
        const roomy = tight.high - tight.low < ROOMY * (target.high - target.low);
        if (!roomy) roomySince = null;
        else if (roomySince === null) roomySince = wall;
        else if (wall - roomySince > narrowAfter) {
          target = tight;
          roomySince = null;
        }
      }
    }
    const way = Number.isNaN(last) ? 1 : 1 - Math.exp(-Math.max(0, wall - last) / EASE);
    last = wall;
    const near = 0.002 * (target.high - target.low);
    axis.low = approach(axis.low, target.low, way, near);
    axis.high = approach(axis.high, target.high, way, near);
    axis.step = target.step;
    axis.roomy = roomySince !== null;
    axis.moving = axis.low !== target.low || axis.high !== target.high;
  }

  function share(value) {
    return (value - axis.low) / (axis.high - axis.low);
  }

  return axis;
}

/** @param {"sqrt" | "linear"} scale */
export function createRiskAxis(scale) {
  const share = scale === "sqrt" ? (value) => Math.sqrt(Math.max(0, value)) : (value) => value;
  return { low: 0, high: 1, step: 0.5, moving: false, fit: () => {}, share };
}

export function axisTicks(axis) {
  const ticks = [];
  const first = Math.ceil(axis.low / axis.step - 1e-6);
  const last = Math.floor(axis.high / axis.step + 1e-6);
  for (let k = first; k <= last && ticks.length < 9; k++) ticks.push(k * axis.step);
  return ticks;
}

/** Least of 1, 2, 5, 10, ... that is not below `least`. */
export function roundStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  const digit = [1, 2, 5, 10].find((candidate) => candidate * power >= least * (1 - 1e-9));
  return (digit ?? 10) * power;
}

function approach(from, to, way, near) {
  const next = from + (to - from) * way;
  return Math.abs(to - next) < near ? to : next;
}
