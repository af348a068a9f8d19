/** Words of the states of samples and of headlines, as core/monitor/status.py has them. */

export const STATE_WORDS = {
  ok: "OK",
  warming_up: "WARMING UP",
  stale: "STALE",
  invalid: "INVALID",
  not_assessed: "NOT ASSESSED",
  not_applicable: "NOT APPLICABLE",
  limits_unknown: "LIMITS UNKNOWN",
  paused: "PAUSED",
  none: "NO DATA",
  no_data: "NO DATA",
  exceeding: "EXCEEDING",
  alarm: "ALARM",
  risk: "ALERT",
  caution: "CAUTION",
  not_calibrated: "NOT CALIBRATED",
  exceeded: "EXCEEDED",
  no_alert: "NO ALERT",
};

export const WITHDRAWN = ["not_applicable", "limits_unknown"];

/** Between manoeuvres there is no guarantee to withdraw; a live flight waits for the next input there. */
export function shownState({ state, cause = null }) {
  const between = { invalid: "between_manoeuvres", warming_up: "ready" };
  return cause !== null && between[state] === cause ? "not_assessed" : state;
}

export function stripState({ state, cause = null }) {
  return state === "invalid" && WITHDRAWN.includes(cause) ? cause : shownState({ state, cause });
}

export function withdrawnWord(cause) {
  return WITHDRAWN.includes(cause) ? STATE_WORDS[cause] : null;
}

/** Without the word of its cause, with which it begins. */
export function reasonOf({ cause, reason }) {
  const withdrawn = withdrawnWord(cause);
  return withdrawn === null ? reason : reason.slice(withdrawn.length + 2);
}
