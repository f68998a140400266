import { useCallback, useState } from 'preact/hooks';

const kPrefix = 'stillmap.form.';

/** State that is kept over a reload in this tab, such as form fields. `forget` removes it. */
export function useKept<Value>(name: string, initial: Value): [Value, (value: Value) => void] {
  const slot = kPrefix + name;
  const [state, setState] = useState<{ slot: string; value: Value }>(() => ({ slot, value: read(slot, initial) }));
  const set = useCallback((value: Value) => {
    setState({ slot, value });
    try {
      sessionStorage.setItem(slot, JSON.stringify(value));
    } catch {
      // Without storage it lasts until the page is closed.
    }
  }, [slot]);
  return [state.slot === slot ? state.value : read(slot, initial), set];
}

export function forget(name: string): void {
  try {
    sessionStorage.removeItem(kPrefix + name);
  } catch {
    // Nothing was kept.
  }
}

function read<Value>(slot: string, initial: Value): Value {
  try {
    const text = sessionStorage.getItem(slot);
    return text === null ? initial : (JSON.parse(text) as Value);
  } catch {
    return initial;
  }
}
