/** The recorded demonstration: a simulated flight that fails, played without a server's help, unless the live one flies. */

import { guarantee } from "../fly/alarms/alarm_panel.js";
import { showLiveFlight } from "../fly/live_flight.js";
import { may } from "../lib/api.js";
import { demonstration } from "../lib/demonstration.js";
import { button, errorLine, failure, formatted, h, link } from "../lib/dom.js";
import { magnitudeIn } from "../lib/numbers.js";
import { createRecordedFlight } from "./recorded_flight.js";

const RECORDING = new URL("recording.json", import.meta.url);

export function show(element, { api, navigate }) {
  let flight = { close: () => {} };
  let view = { close: () => {} };
  let closed = false;
  const { latest } = demonstration;
  if (latest?.phase === "ready") navigate(`#/fly/${latest.flight}`);
  else load();

  async function load() {
    try {
      const response = await fetch(RECORDING);
      const recording = await response.json();
      if (!closed) play(recording);
    } catch (error) {
      if (!closed) element.replaceChildren(failure(error, load));
    }
  }

  function play(recording) {
    view.close();
    const story = createStory(recording, { again: () => play(recording), api });
    flight = createRecordedFlight(recording, api, { moved: story.moved, ended: story.end });
    view = showLiveFlight(element, { id: recording.hello.flight, api: flight.api, over: () => {}, recorded: { Socket: flight.Socket, beside: story.element } });
  }

  return {
    close: () => {
      closed = true;
      view.close();
      flight.close();
    },
  };
}

/** What happens in the flight, in words that light up as it happens; at its end what comes next. */
function createStory({ hello, messages }, { again, api }) {
  const alarms = messages.map(({ message }) => message.alarm).filter(Boolean);
  const [alert, exceeded] = ["risk", "limit"].map((wanted) => alarms.find(({ kind }) => kind === wanted));
  const channel = hello.channels.find(({ key }) => key === exceeded.exceedance.channel);
  const limit = magnitudeIn(channel, exceeded.exceedance.limit);
  const steps = [
    [0, "Simulated F-16 in a rudder doublet"],
    [alert.t, `Alert: ${channel.symbol} is about to exceed ${limit}`],
    [exceeded.t, `${channel.symbol} exceeds ${limit}, ${(exceeded.t - alert.t).toFixed(2)} s after the alert`],
  ].map(([t, text]) => ({ t, item: h("li", {}, h("span", { class: "story-time" }, `${t.toFixed(2)} s`), formatted(text)) }));
  const promise = h("p", { class: "hint", hidden: true }, guarantee(hello));
  const next = h("div", { class: "row", hidden: true });
  const refused = errorLine();
  const element = h("div.story", h("ol", steps.map(({ item }) => item)), promise, next, refused.element);

  function moved(t) {
    for (const step of steps) step.item.toggleAttribute("data-done", t >= step.t - 1e-6);
  }

  /** Live means trained and flown on this machine; it is offered where nothing prepares it yet. */
  function end() {
    const live = button("Train and fly it live", prepare, { class: "button button-small" });
    const isIdle = demonstration.latest === null && may("POST /demonstration");
    next.replaceChildren(button("Replay", again, { class: "button button-small button-primary" }), ...(isIdle ? [live] : []), link("What next", "#/"));
    next.lastChild.classList.add("button-small");
    next.hidden = promise.hidden = false;

    async function prepare() {
      live.disabled = true;
      if (await refused.attempt(() => demonstration.start(api))) live.remove();
      live.disabled = false;
    }
  }

  return { element, moved, end };
}
