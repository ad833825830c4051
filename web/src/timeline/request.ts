// HTTP requests about recordings; a refusal has a code and becomes a sentence.

import { texts } from "../text/text";

export class Refused extends Error {
  constructor(
    readonly code: string,
    text: string,
  ) {
    super(text);
  }
}

const CODES: Record<number, string> = { 403: "viewer", 404: "no_recording", 429: "too_many" };

/** Send a request below `recordings/`; return the answer, or throw `Refused`. */
export async function answer(method: string, path: string, body?: unknown): Promise<Response> {
  const address = new URL(
    path.startsWith("?") ? `recordings${path}` : `recordings/${path}`,
    document.baseURI,
  );
  const init = body === undefined ? { method } : { method, body: JSON.stringify(body) };
  const found = await fetch(address, init).catch(() => {
    throw new Refused("offline", "");
  });
  if (found.ok) return found;
  // The answer to HEAD has no body; a proxy may answer with a page.
  const { code, text } = (await found.json().catch(() => ({}))) as { code?: string; text?: string };
  throw new Refused(code ?? CODES[found.status] ?? "offline", text ?? "");
}

export async function request<T>(method: string, path: string, body?: unknown): Promise<T> {
  return (await (await answer(method, path, body)).json()) as T;
}

/** Return why a request failed, as a sentence. */
export function problem(error: unknown): string {
  const known = texts().timeline.refusals;
  if (!(error instanceof Refused)) return known["offline"]!;
  const text = known[error.code] ?? error.message;
  const sentence = text.slice(0, 1).toUpperCase() + text.slice(1);
  return sentence === "" ? known["offline"]! : sentence.replace(/([^.!?])$/, "$1.");
}
