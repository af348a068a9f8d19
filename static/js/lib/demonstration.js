/**
 * The live demonstration of this server, as it is prepared and once it flies.
 *
 * demonstration.latest        {phase, step, share, elapsed, remaining, flight, problem}; null where none was started
 * demonstration.follow(api)   asks the server, again and again until it flies or failed;   start(api) trains and flies it
 */

import { ApiError } from "./api.js";
import { button, h, put } from "./dom.js";
import { remember, remembered } from "./storage.js";

const EVERY = 1000; // ms
const ENDED = ["ready", "failed"];
const DISMISSED = "forewarn.demonstration"; // banner
const WORDS = {
  preparing: "getting ready",
  compiling: "compiling the numerical kernels (only at the first start)",
  training: "training a small monitor",
};
const listeners = new Set();
let timer = 0;

export const demonstration = {
  latest: null,
  follow,
  start: async (api) => {
    show(await api.post("/demonstration"), api);
  },
  ended,
  subscribe: (listener) => {
    listeners.add(listener);
    return () => listeners.delete(listener);
  },
};

/** Until it flies; ApiError where it failed. */
async function ended() {
  while (!ENDED.includes(demonstration.latest.phase))
    await new Promise((resolve) => {
      const unsubscribe = demonstration.subscribe(() => resolve(unsubscribe()));
    });
  if (demonstration.latest.phase === "failed") throw new ApiError(demonstration.latest.problem, 0);
}

async function follow(api) {
  clearTimeout(timer);
  try {
    show(await api.get("/demonstration"), api);
  } catch {
    timer = setTimeout(follow, EVERY, api); // the page says elsewhere that the server does not answer
  }
}

function show(progress, api) {
  demonstration.latest = progress;
  for (const listener of listeners) listener(progress);
  clearTimeout(timer);
  if (progress !== null && !ENDED.includes(progress.phase)) timer = setTimeout(follow, EVERY, api);
}

function progressWords({ phase, elapsed, remaining }) {
  const left = remaining === null ? "estimating the time left" : remaining < 5 ? "almost done" : `about ${coarse(remaining)} left`;
  return `Live demonstration: ${WORDS[phase] ?? phase} · ${clock(elapsed)} elapsed · ${left}`;
}

function clock(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** To the nearest 5 s, and to half a minute beyond two: an estimate has no more digits. */
function coarse(seconds) {
  if (seconds < 120) return `${5 * Math.ceil(seconds / 5)} s`;
  return `${Math.ceil(seconds / 30) / 2} min`;
}

export function createDemonstrationBar(element, { navigate }) {
  const words = h("span.preparing-words", { role: "status" });
  const bar = h("progress.preparing-bar", { max: 1, "aria-label": "Live demonstration" });
  const watch = button("Watch it", () => navigate(address()), { class: "button button-small button-primary", hidden: true });
  const dismiss = button("×", () => leave(demonstration.latest), { class: "button button-small", "aria-label": "Dismiss" });
  element.append(words, bar, watch, dismiss);
  let left = remembered(DISMISSED); // as keyOf has it
  demonstration.subscribe(draw);

  const address = () => `#/fly/${demonstration.latest?.flight}`;
  const keyOf = ({ phase, flight }) => (ENDED.includes(phase) ? `${phase} ${flight}` : "preparing");

  function leave(progress) {
    left = keyOf(progress);
    if (progress.phase === "ready") remember(DISMISSED, left);
    element.hidden = true;
  }

  function draw(progress) {
    if (progress?.phase === "ready" && location.hash === address()) leave(progress);
    if (progress !== null && keyOf(progress) !== left) left = null;
    element.hidden = progress === null || left !== null;
    if (element.hidden) return;
    const isOver = ENDED.includes(progress.phase);
    element.dataset.phase = progress.phase;
    bar.hidden = isOver;
    bar.value = progress.share;
    watch.hidden = progress.phase !== "ready";
    if (progress.phase === "ready") put(words, "The live demonstration is ready.");
    else if (progress.phase === "failed") put(words, `◆ The live demonstration stopped: ${progress.problem}`);
    else put(words, progressWords(progress));
  }

  return {
    goneTo: (hash) => {
      if (demonstration.latest?.phase === "ready" && hash === address()) leave(demonstration.latest);
    },
  };
}
