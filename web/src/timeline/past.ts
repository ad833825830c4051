// Addresses of the live page and of recordings. Each is a page load, so that nothing held is sent.

import { texts } from "../text/text";

/** Leave the recording; no control moves a robot after it. */
export function backToLive(): void {
  location.assign(liveAddress());
}

export function openRecording(name: string): void {
  location.assign(addressOf(name));
}

function liveAddress(): URL {
  const address = new URL(location.href);
  address.searchParams.delete("recording");
  address.searchParams.delete("t");
  return address;
}

/** Address of a recording, optionally at a time in seconds since its start. */
export function addressOf(name: string, tS?: number): URL {
  const address = liveAddress();
  address.searchParams.set("recording", name);
  if (tS !== undefined) address.searchParams.set("t", tS.toFixed(1));
  return address;
}

/** Time that the address asks for in seconds, or null. */
export function timeInAddress(): number | null {
  const text = new URL(location.href).searchParams.get("t") ?? "";
  const tS = Number(text);
  return text !== "" && tS >= 0 && Number.isFinite(tS) ? tS : null;
}

/** Copy the address of a recording, and return what to tell about it. */
export async function shared(name: string, tS?: number): Promise<string> {
  const { copied, copyYourself } = texts().timeline;
  const { href } = addressOf(name, tS);
  return (await copy(href)) ? copied : `${copyYourself} ${href}`;
}

/** Pages without TLS have no clipboard interface. */
async function copy(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const area = document.createElement("textarea");
    area.value = text;
    const before = document.activeElement as HTMLElement | null;
    document.body.append(area);
    area.select();
    const copied = document.execCommand("copy");
    area.remove();
    before?.focus();
    return copied;
  }
}
