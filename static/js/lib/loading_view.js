/**
 * The life of a view that loads: shows loading, then what was built, or why not; forgets it when left.
 *
 * Exports
 *   loadingView(element, {title, text, build}) -> {close()}
 *     build(life) -> Promise<Node>     may use life.keep({close}) for what must end with the view
 */

import { failure, loading, pageOf } from "./view_states.js";

export function loadingView(element, { title, text, build }) {
  let open = true;
  let closing = [];
  const keep = (thing) => {
    if (open) closing.push(thing);
    else thing.close();
    return thing;
  };
  const release = () => {
    closing.forEach((thing) => thing.close());
    closing = [];
  };
  load();
  return {
    close: () => {
      open = false;
      release();
    },
  };

  async function load() {
    release();
    element.replaceChildren(pageOf(title, [], loading(text)));
    try {
      const built = await build({
        keep,
        again: load,
        get open() {
          return open;
        },
      });
      if (open) element.replaceChildren(built);
    } catch (error) {
      if (open) element.replaceChildren(pageOf(title, [], failure(error, load)));
    }
  }
}
