/**
 * Who is logged in, and which requests the role allows: the server's own table, asked once.
 *
 * Exports
 *   loadMe(api) -> Promise<{name, role, allowed} | null>    null where the server does not say
 *   may(route) -> boolean        "POST /flights/{}/end"; true until the server has said otherwise
 *   asksForToken() -> bool       whether the server lets nobody in without one
 *   needs(route) -> attributes   of an element that is hidden where the role does not allow its request
 *
 * The server refuses what is tried all the same, and its sentence is shown there.
 */

let me = null;

export async function loadMe(api) {
  try {
    me = await api.get("/me");
  } catch {
    me = null; // what does not answer is told where it was asked for
  }
  return me;
}

export function may(route) {
  const [method, path] = route.split(" ");
  return me === null || me.allowed.includes(`${method} /api/v1${path}`);
}

export function asksForToken() {
  return me !== null && me.name !== "local";
}

export function needs(route) {
  return may(route) ? {} : { "data-refused": true };
}
