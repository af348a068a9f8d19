/** The start page: five jobs, each with a button that works at once. */

import { may, needs } from "../lib/api.js";
import { isSimulated } from "../lib/catalog.js";
import { demonstration } from "../lib/demonstration.js";
import { button, errorLine, h, link } from "../lib/dom.js";
import { fittingMonitor, startFlight } from "../lib/monitors.js";

const EXAMPLE = "example-flight.csv";
const CAPTION = "Warned 0.80 s before the limit: lateral acceleration of a simulated F-16 in a rudder doublet.";

export function show(element, { api, navigate }) {
  let closed = false;
  const go = (hash) => closed || navigate(hash);
  const drawing = h("div");
  const picture = h("figure.start-picture", drawing, h("figcaption", CAPTION));
  shipped("picture.svg").then((file) => file.text()).then((text) => (drawing.innerHTML = text), () => picture.remove());

  const jobs = [
    job({
      title: "Watch a simulated flight",
      text: "See Forewarn warn before a manoeuvre exceeds its limit.",
      action: ["Watch a flight", watch],
      more: link("Flights and settings", "#/fly"),
    }),
    job({
      title: "Score a recording",
      text: "Replay a flight from a file and see when a monitor would have warned.",
      action: ["Score an example", score, needs("POST /recordings/{}/scorings")],
      more: link("Open your own file", "#/recordings"),
    }),
    job({
      title: "Connect a live source",
      text: "Send telemetry over HTTP, WebSocket, UDP or MQTT and get a risk for each sample.",
      action: ["Set up a live flight", connect, needs("POST /flights")],
    }),
    job({
      title: "Plan a build-up",
      text: "Clear points of growing amplitude one by one, each from those flown before it.",
      action: ["Open an example plan", () => go("#/campaigns/new?name=Example+build-up"), needs("POST /campaigns")],
      more: link("Your campaigns", "#/campaigns"),
    }),
    job({
      title: "Train a monitor for your aircraft",
      text: "Choose aircraft, manoeuvre and limits; Forewarn simulates, trains and tests it.",
      action: ["Train a monitor", () => go("#/monitors/new"), needs("POST /monitors")],
      more: link("Your monitors", "#/monitors"),
    }),
  ];
  const promise = "Forewarn watches a flight-test manoeuvre as it is flown, and warns a set time before it exceeds a safety limit. It states how often it may miss.";
  const head = h("header.start-head", h("div.stack", h("h1", "An alert before the limit"), h("p", promise)), picture);
  element.replaceChildren(h("div.page.start", head, h("ul.jobs", jobs)));
  return {
    close: () => {
      closed = true;
    },
  };

  async function watch() {
    const monitor = fittingMonitor(await api.get("/monitors"));
    if (monitor === undefined || !isSimulated(monitor) || !may("POST /flights")) return go("#/demonstration");
    const source = { kind: "simulated", seed: 2, outcome: "unsafe" };
    return startFlight({ api, navigate: go }, { source, monitor: monitor.id });
  }

  async function score(say) {
    const monitor = await aMonitor(say);
    go(await scoreExample(api, monitor));
  }

  async function connect(say) {
    await aMonitor(say);
    go("#/fly?kind=live");
  }

  /** The one to begin with; where there is none, the small one of the demonstration is trained first. */
  async function aMonitor(say) {
    const known = await api.get("/monitors");
    if (known.length > 0 || !may("POST /demonstration")) return fittingMonitor(known);
    say("No monitor yet: training a small one first. Progress is shown above.");
    await demonstration.start(api);
    await demonstration.ended();
    return fittingMonitor(await api.get("/monitors"));
  }
}

const shipped = (name) => fetch(new URL(name, import.meta.url)); // with the page

function job({ title, text, action: [words, act, attributes = {}], more = null }) {
  const refused = errorLine();
  const status = h("p.hint", { role: "status", hidden: true });
  const go = button(words, press, { class: "button button-primary", ...attributes });
  return h("li.panel.job-card", h("h2", title), h("p", text), h("div.row", go, more), status, refused.element);

  async function press() {
    go.disabled = true;
    await refused.attempt(() => act(say));
    status.hidden = true;
    go.disabled = false;
  }

  function say(words) {
    status.textContent = words;
    status.hidden = false;
  }
}

/**
 * The address of the scoring of an example: the demonstration's flight as a recorder would have written it, after 5 s
 * in trim; of its recording where no monitor is given.
 */
async function scoreExample(api, monitor) {
  const id = await uploaded(api);
  const path = `/recordings/${id}`;
  if (monitor === undefined) return `#${path}`;
  const { mapping, ready } = await api.get(path);
  if (!ready) await api.put(`${path}/mapping`, { mapping });
  const scorings = await api.get(`${path}/scorings`);
  const scoring = scorings.find((one) => one.monitor === monitor.id) ?? (await api.post(`${path}/scorings`, { monitor: monitor.id }));
  return `#${path}?scoring=${scoring.id}`;
}

async function uploaded(api) {
  const known = (await api.get(`/recordings?${new URLSearchParams({ text: EXAMPLE })}`)).find(({ name }) => name === EXAMPLE);
  if (known !== undefined) return known.id;
  const file = await (await shipped(EXAMPLE)).blob();
  return (await api.upload(`/recordings?${new URLSearchParams({ name: EXAMPLE })}`, file).ended).id;
}
