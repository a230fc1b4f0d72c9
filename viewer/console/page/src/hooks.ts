// What views share: data that heal, events, the size of an element.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Missing, read, STATIC } from "./data";
import { type Events, live } from "./live";

export interface Answer<T> {
  data: T | null;
  /** Why there is nothing; empty while it is on its way. */
  error: string;
}

const PAUSE_MS = [1000, 2000, 4000, 8000];

/** Data of a path, read again when the line was mended, until they are there; `again` asks anew. */
export function useData<T>(path: string | null, again: unknown = 0): Answer<T> {
  const [answer, setAnswer] = useState<Answer<T> & { path: string | null }>({ data: null, error: "", path: null });
  const epoch = useEpoch();
  useEffect(() => {
    if (path === null) return;
    let over = false;
    let timer = 0;
    let asked = 0;
    let answered = false;
    const ask = (tries: number): void => {
      const mine = ++asked;
      clearTimeout(timer);
      read<T>(path).then(
        (data) => {
          if (over || mine !== asked) return;
          answered = true;
          setAnswer({ data, error: "", path });
        },
        (error: unknown) => {
          if (over || mine !== asked) return;
          answered = error instanceof Missing;
          const words = error instanceof Missing ? error.message : "No answer from the server; asking again.";
          setAnswer((before) => ({ data: before.path === path ? before.data : null, error: words, path }));
          if (STATIC || error instanceof Missing) return;
          timer = window.setTimeout(() => ask(tries + 1), PAUSE_MS[Math.min(tries, PAUSE_MS.length - 1)]);
        },
      );
    };
    ask(0);
    // A question that was on the line when it was cut may never be answered.
    const healed = (): void => void (answered || ask(0));
    live.addEventListener("healed", healed);
    return () => {
      over = true;
      clearTimeout(timer);
      live.removeEventListener("healed", healed);
    };
  }, [path, again, epoch]);
  return answer.path === path ? answer : { data: null, error: "" };
}

/** Data of several paths, at most `most`. */
export const useEach = <T>(paths: string[], most: number): Answer<T>[] =>
  Array.from({ length: most }, (_, place) => useData<T>(paths[place] ?? null)).slice(0, paths.length);

/** Grows when all has to be read again. */
export function useEpoch(): number {
  const [epoch, setEpoch] = useState(live.epoch);
  useEffect(() => {
    const hear = (): void => setEpoch(live.epoch);
    live.addEventListener("epoch", hear);
    return () => live.removeEventListener("epoch", hear);
  }, []);
  return epoch;
}

/** Call `hear` for each event of the stream; the newest `hear` is called. */
export function useEvents<K extends keyof Events>(name: K, hear: (data: Events[K]) => void): void {
  const newest = useRef(hear);
  newest.current = hear;
  useEffect(() => live.on(name, (data) => newest.current(data)), [name]);
}

/** Draw again when `target` says `name`. */
export function useSignal(target: EventTarget, name: string): number {
  const [count, setCount] = useState(0);
  useEffect(() => {
    const hear = (): void => setCount((before) => before + 1);
    target.addEventListener(name, hear);
    return () => target.removeEventListener(name, hear);
  }, [target, name]);
  return count;
}

/** Width and height of an element [px]. */
export function useSize<E extends HTMLElement>(): [{ current: E | null }, number, number] {
  const element = useRef<E>(null);
  const [size, setSize] = useState<[number, number]>([0, 0]);
  const watched = useRef<{ node: E; observer: ResizeObserver } | null>(null);
  // The element may be another one after any drawing.
  useEffect(() => {
    const node = element.current;
    if (node === (watched.current?.node ?? null)) return;
    watched.current?.observer.disconnect();
    watched.current = null;
    if (node === null) return;
    const observer = new ResizeObserver(() => setSize([node.clientWidth, node.clientHeight]));
    observer.observe(node);
    watched.current = { node, observer };
  });
  useEffect(() => () => watched.current?.observer.disconnect(), []);
  return [element, ...size];
}

/** A value that ends (`close`) when `make` gives another one. */
export function useClosed<T extends { close(): void }>(make: () => T, inputs: unknown[]): T {
  const value = useMemo(make, inputs);
  useEffect(() => () => value.close(), [value]);
  return value;
}
