/**
 * Which screen leads a replay, and whether this one is in step with it.
 *
 * createFollowing(element, {lead}) -> Following     lead() -> Promise     lets this screen lead; rejects with the reason
 *   show({screens, leader})     as the server sends it
 *   draw(behind)                behind: why this screen is not where the replay is; empty if it is
 *   isFollowing                 whether another connected screen leads
 */

import { may } from "../../lib/api.js";
import { button, errorLine, h, put } from "../../lib/dom.js";
import { counted } from "../../lib/numbers.js";
import { SCREEN } from "../source/connection.js";

const GRACE = 500; // ms that this screen may be elsewhere, as right after a seek
const NOBODY = "local"; // the person of a server without tokens

export function createFollowing(element, { lead }) {
  const words = h("span.following-words");
  const failure = errorLine();
  const take = button("Take the lead", () => failure.attempt(lead), { class: "button button-small" });
  const line = h("p.following", { role: "status", hidden: true }, words, take);
  element.append(line, failure.element);
  let [screens, leader] = [[], null];
  let inStep = -Infinity; // when it was last

  const nameOf = ({ number, by }) => `screen ${number}${by === NOBODY ? "" : ` (${by})`}`;
  const isHere = (screen) => screens.some(({ id }) => id === screen.id);
  const isFollowing = () => leader !== null && leader.id !== SCREEN && isHere(leader);

  /** [words, whether something is wrong] */
  function stateOf(behind) {
    const others = counted(screens.length - 1, "other screen");
    if (leader === null) return [screens.length > 1 ? `${others} also ${screens.length > 2 ? "show" : "shows"} this replay. The first to steer leads.` : "", false];
    if (!isHere(leader)) return [`◆ LEADER GONE: ${nameOf(leader)} has left. The next to steer leads.`, true];
    if (leader.id === SCREEN) return [screens.length > 1 ? `This screen leads. ${others} ${screens.length > 2 ? "follow" : "follows"}.` : "", false];
    const where = behind ? `◆ OUT OF STEP: ${behind}` : "in step";
    return [`Follows ${nameOf(leader)}: ${where}.`, behind !== ""];
  }

  function draw(behind) {
    const now = performance.now();
    if (!behind) inStep = now;
    const [text, isWrong] = stateOf(now - inStep > GRACE ? behind : "");
    line.hidden = text === "";
    line.dataset.level = isWrong ? "caution" : "ok";
    take.hidden = !isFollowing() || !may("POST /flights/{}/transport");
    put(words, text);
  }

  return {
    show: (message) => {
      ({ screens, leader } = message);
      failure.show("");
    },
    draw,
    get isFollowing() {
      return isFollowing();
    },
  };
}
