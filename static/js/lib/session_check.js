/**
 * The session check that this browser did last, for the record of the flights that follow it.
 *
 * storeCheck({at, by, checks: [{name, result, text}]})     at: ISO 8601; result: one of RESULTS
 * lastCheck() -> such a check, not older than VALID; null for none
 * checkWords(check | null)     in one text: what failed and what was not done comes first; null: not done
 */

import { remember, remembered } from "./storage.js";

const RESULTS = ["failed", "not done", "passed"]; // worst first
const KEY = "forewarn.session_check";
const VALID = 12 * 3600 * 1000; // ms
const LONGEST = 2000; // letters of an event

export function storeCheck(check) {
  remember(KEY, JSON.stringify(check));
}

export function lastCheck() {
  const check = JSON.parse(remembered(KEY) ?? "null");
  return check !== null && Date.now() - Date.parse(check.at) < VALID ? check : null;
}

export function worstOf({ checks }) {
  return RESULTS.find((result) => checks.some((each) => each.result === result));
}

export function checkWords(check) {
  if (check === null) return "Session check NOT DONE in this browser in the last 12 h";
  const parts = RESULTS.flatMap((result) => {
    const those = check.checks.filter((each) => each.result === result);
    return those.length > 0 ? `${result}: ${those.map(({ name, text }) => `${name} (${text})`).join(", ")}` : [];
  });
  const head = `Session check ${worstOf(check).toUpperCase()}, ${check.at.slice(0, 16).replace("T", " ")} UTC, by ${check.by}`;
  return `${head}: ${parts.join("; ")}`.slice(0, LONGEST);
}
