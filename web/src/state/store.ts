import { useEffect, useState } from 'preact/hooks';

/** A value that calls its listeners when it changes. */
export class Store<Value> {
  private readonly listeners_ = new Set<(value: Value) => void>();

  constructor(private value_: Value) {}

  get(): Value {
    return this.value_;
  }

  set(value: Value): void {
    if (Object.is(value, this.value_)) return;
    this.value_ = value;
    for (const listener of [...this.listeners_]) listener(value);
  }

  /** @return stops listening. */
  listen(listener: (value: Value) => void): () => void {
    this.listeners_.add(listener);
    return () => this.listeners_.delete(listener);
  }
}

/** A store's value in a component, which is drawn again with each change. */
export function useStore<Value>(store: Store<Value>): Value {
  const [value, setValue] = useState(store.get());
  useEffect(() => {
    setValue(() => store.get());
    return store.listen((next) => setValue(() => next));
  }, [store]);
  return value;
}
