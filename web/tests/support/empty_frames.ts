// happy-dom loads nothing into frames, and prints an error for each. Here a frame stays empty, and
// there is no server for requests.

const frame = HTMLIFrameElement.prototype;
for (const symbol of Object.getOwnPropertySymbols(frame))
  if (symbol.description === "connectedToDocument") Reflect.deleteProperty(frame, symbol);

globalThis.fetch = () => Promise.reject(new TypeError("no server"));
