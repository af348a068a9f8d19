/**
 * A running job: its step, its progress, and a button to cancel it.
 *
 * createJobProgress({api, job, title, done, back, worded}) -> {element, close()}
 *     done(result), back() after a failure or a cancellation;   worded(words): the reason of a failure, as the page says it
 * jobList({api, kind, done}) -> Promise<{element | null, close()}>    jobs in progress, and the newest that did not finish
 */

import { needs, reason } from "./api.js";
import { button, errorLine, h } from "./dom.js";
import { moment } from "./numbers.js";

export const UNDER_WAY = ["queued", "running"];
const WORDS = {
  failed: "It failed",
  cancelled: "Cancelled",
  interrupted: "The server stopped before it finished",
};

export function createJobProgress({ api, job, title, done, back, worded = (words) => words }) {
  const bar = h("progress.progress", { "aria-label": "progress" });
  const message = h("p", { role: "status", class: "job-message" }, "waiting in the queue");
  const stop = button("Cancel", cancel, needs("POST /jobs/{}/cancel"));
  const failure = errorLine();
  const element = h(
    "section.panel.stack.job",
    { "data-job": job.id, "data-status": job.status },
    h("h2.panel-title", title),
    message,
    bar,
    failure.element,
    h("div.row", stop),
  );
  const watch = api.watchJob(job.id, changed);
  watch.ended.then(ended, failed);
  return { element, close: watch.close };

  function changed({ status, message: words, progress, total }) {
    element.dataset.status = status;
    message.textContent = status === "queued" ? "waiting in the queue" : words;
    if (total) {
      bar.max = total;
      bar.value = Math.min(progress ?? 0, total);
    } else bar.removeAttribute("value");
  }

  async function cancel() {
    stop.disabled = true;
    try {
      await api.post(`/jobs/${job.id}/cancel`);
    } catch (error) {
      if (error.status !== 409) failed(error); // 409: it has ended, as `ended` reports
    }
  }

  function ended({ status, result, error, message: words }) {
    if (status === "done") return done(result);
    const why = error ? `: ${worded(error)}` : status === "cancelled" ? ` (${words})` : "";
    return fail(`${WORDS[status] ?? status}${why}.`);
  }

  function failed(error) {
    fail(reason(error));
  }

  function fail(words) {
    bar.hidden = true;
    message.hidden = true;
    failure.show(words.replace(/([.!?])\.$/, "$1"));
    stop.replaceWith(button("Back", back, { class: "button button-primary" }));
  }
}

export async function jobList({ api, kind, done }) {
  const jobs = await api.get(`/jobs?kind=${kind}`);
  const active = jobs.filter(({ status }) => UNDER_WAY.includes(status));
  const shown = active.map((job) => {
    const back = () => progress.element.remove();
    const progress = createJobProgress({ api, job, title: titleOf(job), done: () => done(job), back });
    return progress;
  });
  const parts = [...shown.map(({ element }) => element), unfinished(jobs)].filter(Boolean);
  return {
    element: parts.length ? h("div.stack", parts) : null,
    close: () => shown.forEach(({ close }) => close()),
  };
}

/** The newest jobs that failed, and why, for a user who had left the page. */
function unfinished(jobs) {
  const lost = jobs.filter(({ status }) => ["failed", "interrupted"].includes(status)).slice(0, 5);
  if (!lost.length) return null;
  const rows = lost.map((job) =>
    h("li", `${moment(job.created)}, ${titleOf(job)}: ${job.status}, `, h("span.dim", job.error ?? "")),
  );
  return h("details.fold", h("summary", `${lost.length} that did not finish`), h("ul", rows));
}

function titleOf({ kind, request }) {
  const what = { monitor: "Training", dataset: request.files ? "Adding" : "Simulating" }[kind];
  return request.name ? `${what} “${request.name}”` : what;
}
