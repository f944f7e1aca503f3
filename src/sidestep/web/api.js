// What the server is asked, and what it says when it cannot answer.

/** A sentence from the server, or about it. */
class Refusal extends Error {}

function address(path, query) {
  const url = new URL(path, document.baseURI);
  for (const [name, value] of Object.entries(query)) {
    if (value !== undefined && value !== null && value !== "") url.searchParams.set(name, value);
  }
  return url;
}

const PATIENCE = 120; // seconds in which a busy server is asked again: the first questions of a kind take long
const SOON = 2; // seconds that something waits which nothing calls off
const LATER = 30; // and something that is called off when it is no longer wanted
const SIDE_BY_SIDE = 2; // as many as a server answers of those that take long

/** Wait, unless the answer is no longer wanted. */
export function pause(seconds, signal) {
  return new Promise((done, stop) => {
    const timer = setTimeout(done, 1000 * seconds);
    signal?.addEventListener("abort", () => {
      clearTimeout(timer);
      stop(new DOMException("no longer wanted", "AbortError"));
    });
  });
}

/** Fetch; where the server has too much to do it is asked again, as late as it says. */
async function fetched(url, options) {
  const latest = performance.now() + 1000 * PATIENCE;
  for (;;) {
    let response;
    try {
      response = await fetch(url, options);
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new Refusal("The server does not answer; it is tried again with the next request.");
    }
    const later = Number(response.headers.get("Retry-After"));
    const busy = [429, 503].includes(response.status) && later > 0 && later <= (options?.signal ? LATER : SOON);
    if (!busy || performance.now() > latest) return response;
    await pause(later, options?.signal);
  }
}

async function answered(url, options) {
  const response = await fetched(url, options);
  if (response.status === 204) return null;
  const text = await response.text();
  let said = null;
  try {
    said = JSON.parse(text);
  } catch {
    said = null;
  }
  if (response.ok && said !== null && (said.code === undefined || said.code === "Ok")) return said;
  // RFC 9457 says it in "detail", OSRM in "message".
  throw new Refusal(said?.detail ?? said?.message ?? `The server answered with status ${response.status}.`);
}

/** Ask for something. */
export const get = (path, query = {}, signal = undefined) => answered(address(path, query), { signal });

/** Send something. */
export const send = (method, path, body = undefined, signal = undefined) =>
  answered(address(path, {}), {
    method,
    signal,
    body: body === undefined ? undefined : JSON.stringify(body),
    headers: body === undefined ? {} : { "Content-Type": "application/json" },
  });

/** Ask about each of some things, not about all at once. */
export async function inTurn(things, ask) {
  const left = [...things];
  const next = async () => {
    while (left.length > 0) await ask(left.shift());
  };
  await Promise.all(Array.from({ length: SIDE_BY_SIDE }, next));
}

/** Listen to the server's events; the browser connects again by itself. */
export function listen(path, listeners) {
  const source = new EventSource(address(path, {}));
  for (const [name, listener] of Object.entries(listeners)) {
    source.addEventListener(name, (event) => {
      let data = {};
      try {
        data = event.data ? JSON.parse(event.data) : {};
      } catch {
        data = {};
      }
      listener(data);
    });
  }
  return source;
}

/** A place as the server reads it. */
export const lonLat = (place) => `${place.lon.toFixed(6)},${place.lat.toFixed(6)}`;
