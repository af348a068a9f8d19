/**
 * Where to send the samples of a live flight: addresses, channels and commands.
 *
 * createSourceAddress(element, flight) -> {describe(hello), show({isWaiting, isLinked}), toggle() -> is open}
 *     isWaiting: for the first sample, so it is all that is shown
 */

import { asksForToken } from "../../lib/api.js";
import { channelName } from "../../lib/catalog.js";
import { formatted, h, put, table } from "../../lib/dom.js";

const ANY = /^(0\.0\.0\.0|\[::\]):/; // every address of the server

export function createSourceAddress(element, flight) {
  element.classList.add("source-address");
  element.hidden = true;
  const now = { isWaiting: false, isLinked: true, isOpen: false };
  let described = "";
  const title = h("h2", {});

  function describe({ channels, live, source }) {
    const sent = JSON.stringify([live.names, live.needed, live.conditions, live.udp]);
    if (sent === described) return;
    described = sent;
    const words = "Send samples to one of these addresses: the flight starts with the first sample. The button Address shows this again.";
    element.replaceChildren(
      title,
      h("p", { class: "dim" }, words),
      h("div", { class: "source-parts" }, h("section", {}, ...addresses(flight, live), ...commands(flight, live, source)), channelTable(channels, live, source)),
    );
  }

  function titleNow() {
    if (!now.isWaiting) return "Where to send samples";
    return now.isLinked ? "NO DATA: waiting for the first sample" : "STALE: not connected to the server";
  }

  function show(given) {
    Object.assign(now, given);
    put(title, titleNow());
    element.hidden = !now.isWaiting && !now.isOpen;
    element.parentElement?.toggleAttribute("data-waiting", now.isWaiting);
  }

  function toggle() {
    show({ isOpen: !now.isOpen });
    return now.isOpen;
  }

  return { describe, show, toggle };
}

function addresses(flight, { udp }) {
  const path = `${location.host}/api/v1/flights/${flight}`;
  const socket = location.protocol === "https:" ? "wss" : "ws";
  return [
    line("REST, POST", `${location.origin}/api/v1/flights/${flight}/samples`),
    line("WebSocket", `${socket}://${path}/uplink`),
    udp === null
      ? h("p.dim", "UDP: not chosen when the flight was started")
      : line("UDP, JSON lines", udp.replace(ANY, `${location.hostname}:`)),
  ];
}

function commands(flight, live, { recording }) {
  const [header, option] = asksForToken() ? [` -H "Authorization: Bearer $TOKEN"`, ` --token "$TOKEN"`] : ["", ""];
  const [time, ...names] = live.names;
  const sent = names.filter((name) => live.needed.includes(name) || !ATTITUDE.includes(name));
  const conditions = live.conditions.map(({ name }) => name);
  const batch = Object.fromEntries([["sequence", 0], [time, 0], ...[...sent, ...conditions].map((name) => [name, 0])]);
  const curl = `curl ${location.origin}/api/v1/flights/${flight}/samples${header} -d '${JSON.stringify(batch)}'`;
  const push = `forewarn push FILE --flight ${flight} --server ${location.origin}${option}`;
  return [
    ...(recording === undefined ? [line("Command, for a recording at its own pace", push)] : []),
    line("Command, for one sample", curl),
  ];
}

const ATTITUDE = ["phi", "theta", "psi"];

/** Names, units and what monitor and flight condition need; with a mapping, its signals in its units. */
function channelTable(channels, { names, needed, conditions }, { recording }) {
  const [time, ...others] = names;
  const signals = recording === undefined ? ownRows(channels, needed) : others.map((name) => [name, "", "unit of the mapping", ""]);
  const rows = [
    ...signals.filter(([name]) => !conditions.some((condition) => condition.name === name)),
    ...conditions.map(({ name, label, unit }) => [name, label, unit, "✓ flight condition"]),
  ];
  const columns = ["name", "channel", "unit", "needed"].map((word, k) => [word, (row) => row[k]]);
  return table({ columns, items: [[time, "time of the sample", "s", "✓"], ...rows], classes: "source-channels", panel: false });
}

function ownRows(channels, needed) {
  const wordOf = ({ key, formula }) => (formula ? "computed, not sent" : needed.includes(key) ? "✓" : "optional");
  const rows = channels.map((channel) => [channel.key, formatted(channelName(channel)), channel.unit, wordOf(channel)]);
  const others = ATTITUDE.filter((angle) => !channels.some(({ key }) => key === angle));
  return others.length === 0 ? rows : [...rows, [others.join(", "), "attitude, for the scene", "rad", "optional"]];
}

function line(name, text) {
  return h("div.source-line", h("span.source-name", name), h("code", text));
}
