/**
 * Who is logged in, and which requests the role allows, by the server's own table.
 *
 * Exports
 *   loadMe(api) -> Promise<{name, role, allowed} | null>    null where the server does not answer
 *   may(route) -> boolean        "POST /flights/{}/end"; true until the server has answered
 *   asksForToken() -> bool       whether the server needs a token
 *   needs(route) -> attributes   hide an element whose request the role does not allow
 *
 * The server checks every request itself.
 */

let me = null;

export async function loadMe(api) {
  try {
    me = await api.get("/me");
  } catch {
    me = null; // the view reports that the server does not answer
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
