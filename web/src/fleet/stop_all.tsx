// STOP ALL, at the place of STOP on the page of all robots.

export function StopAll() {
  return null;
}
