// Sim time of a case that is looked at; film, top view and plots follow it.
import { useEffect, useMemo, useState } from "preact/hooks";

export class Clock extends EventTarget {
  t: number;
  playing = false;
  rate = 1;
  private last = 0;
  private frame = 0;

  constructor(
    readonly begin: number,
    readonly end: number,
    start: number,
  ) {
    super();
    this.t = Math.min(end, Math.max(begin, start));
  }

  to(t: number): void {
    const now = Math.min(this.end, Math.max(this.begin, t));
    if (now === this.t) return;
    this.t = now;
    this.dispatchEvent(new Event("t"));
  }

  play(on: boolean): void {
    if (on === this.playing) return;
    if (on && this.t >= this.end) this.to(this.begin);
    this.playing = on;
    this.last = 0;
    if (on) this.frame = requestAnimationFrame(this.step);
    else cancelAnimationFrame(this.frame);
    this.dispatchEvent(new Event("playing"));
  }

  private readonly step = (now: number): void => {
    if (!this.playing) return;
    if (this.last) this.to(this.t + (Math.min(250, now - this.last) / 1000) * this.rate);
    this.last = now;
    if (this.t >= this.end) this.play(false);
    else this.frame = requestAnimationFrame(this.step);
  };

  close(): void {
    this.playing = false;
    cancelAnimationFrame(this.frame);
  }
}

export function useClock(begin: number, end: number, start: number): Clock {
  const clock = useMemo(() => new Clock(begin, end, start), [begin, end]);
  useEffect(() => () => clock.close(), [clock]);
  return clock;
}

/** Sim time, at most as often as `every` ms: for words, which nobody reads faster. */
export function useTime(clock: Clock, every = 0): number {
  const [t, setT] = useState(clock.t);
  useEffect(() => {
    let timer = 0;
    const take = (): void => {
      timer = 0;
      setT(clock.t);
    };
    const hear = (): void => {
      if (!every) take();
      else if (!timer) timer = window.setTimeout(take, every);
    };
    setT(clock.t);
    clock.addEventListener("t", hear);
    return () => {
      clearTimeout(timer);
      clock.removeEventListener("t", hear);
    };
  }, [clock]);
  return t;
}

/** Index of the last time that is not after `t`; -1: all are. */
export function indexAt(times: number[], t: number): number {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle]! <= t + 1e-9) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}
