/**
 * A "?" that opens the guide at the section about what it stands beside.
 *
 * Exports  guideLink(place, about) -> <a>     place: "slug" or "slug#anchor";  about: read aloud and shown as a tooltip
 */

import { h } from "./dom.js";

export function guideLink(place, about) {
  return h(
    "a",
    { class: "guide-link", href: `/guide/${place}`, target: "_blank", rel: "noopener", title: `Guide: ${about}` },
    "?",
    h("span", { class: "visually-hidden" }, ` ${about}`),
  );
}
