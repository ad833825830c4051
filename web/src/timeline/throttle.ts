const SEND_MS = 50; // The dashboard closes sockets that flood it.

/** Return a function that sends the latest of several messages in quick succession. */
export function throttled<T>(send: (message: T) => void): (message: T) => void {
  let waiting: T | undefined;
  let timer = 0;
  const flush = () => {
    timer = 0;
    if (waiting === undefined) return;
    send(waiting);
    waiting = undefined;
    timer = window.setTimeout(flush, SEND_MS);
  };
  return (message) => {
    waiting = message;
    if (timer === 0) flush();
  };
}
