// Addresses of recordings and of the live page. Each is a page load, so that nothing held is sent.

import { copyText } from "../ui/share";
import { texts } from "../text/text";

/** Address of a recording, optionally at a time in seconds since its start; null is the live page. */
export function addressOf(name: string | null, tS?: number): URL {
  const address = new URL(location.href);
  for (const key of ["recording", "t"]) address.searchParams.delete(key);
  if (name !== null) address.searchParams.set("recording", name);
  if (tS !== undefined) address.searchParams.set("t", tS.toFixed(1));
  return address;
}

/** Leave the recording; no control moves a robot after it. */
export function backToLive(): void {
  location.assign(addressOf(null));
}

/** Copy the address of a recording, and return a message about that. */
export async function shared(name: string, tS?: number): Promise<string> {
  const { copied, copyYourself } = texts().timeline;
  const { href } = addressOf(name, tS);
  return (await copyText(href)) ? copied : `${copyYourself} ${href}`;
}
