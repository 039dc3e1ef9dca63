// What the page asks of the server. Answers are JSON; an error is one sentence.

export class Refused extends Error {
  constructor(message, status) { super(message); this.status = status; }
}

export async function ask(path, method = "GET", body = undefined) {
  const raw = body instanceof Blob;
  const answer = await fetch(`api/${path}`, {
    method, body: body === undefined ? undefined : raw ? body : JSON.stringify(body),
    headers: body === undefined ? {} : { "content-type": raw ? "application/octet-stream" : "application/json" },
  });
  const found = answer.headers.get("content-type")?.startsWith("application/json") ? await answer.json() : {};
  if (!answer.ok) throw new Refused(found.error || `The server answered ${answer.status}.`, answer.status);
  return found;
}

export async function askBytes(path) {
  const answer = await fetch(`api/${path}`);
  if (answer.ok) return answer.arrayBuffer();
  const found = answer.headers.get("content-type")?.startsWith("application/json") ? await answer.json() : {};
  throw new Refused(found.error || `The server answered ${answer.status}.`, answer.status);
}

// The points of a motion, as they arrive; `arrived` is called with how many frames are there.
export async function streamPoints(path, values, arrived) {
  const answer = await fetch(`api/${path}`);
  if (!answer.ok) throw new Refused(`The server answered ${answer.status}.`, answer.status);
  const bytes = new Uint8Array(values.buffer), reader = answer.body.getReader();
  for (let at = 0; ;) {
    const { done, value } = await reader.read();
    if (done) return;
    bytes.set(value, at);
    at += value.length;
    arrived(at);
  }
}
