/** A method as a small coloured word. */
export function Verb({ method }: { method: string }) {
  return <span class={`verb ${method.toLowerCase()}`}>{method}</span>;
}
