export function Deck() {
  return null;
}
