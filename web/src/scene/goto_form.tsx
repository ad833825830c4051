export function GoToForm() {
  return null;
}
