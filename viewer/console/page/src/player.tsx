// The bar that moves through a case: play, ticks, events.
import type { JSX } from "preact";
import { useEffect } from "preact/hooks";
import { type Clock, useTime } from "./clock";
import { useSignal } from "./hooks";
import { requery } from "./route";
import { at } from "./words";

export interface Mark {
  t: number;
  what: string;
  /** Class of its sign. */
  kind: "moment" | "event" | "differs";
}

interface Inputs {
  clock: Clock;
  /** Length of a tick [s]. */
  tick: number;
  marks: Mark[];
}

const RATES = [0.1, 0.25, 0.5, 1, 2, 4];
/** After so long without a move the time stands in the address [ms]. */
const REST_MS = 300;

export function Player({ clock, tick, marks }: Inputs): JSX.Element {
  const t = useTime(clock);
  useSignal(clock, "playing");
  useEffect(() => {
    if (clock.playing) return;
    const timer = setTimeout(() => requery({ t: String(Number(clock.t.toFixed(3))) }), REST_MS);
    return () => clearTimeout(timer);
  }, [t, clock.playing]);
  useEffect(() => {
    const hear = (event: KeyboardEvent): void => {
      const target = event.target as HTMLElement;
      if (target.closest("input, select, textarea, button, a, pre, dialog, iframe, summary")) return;
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const step = event.shiftKey ? 1 : tick;
      if (event.key === " ") clock.play(!clock.playing);
      else if (event.key === "ArrowRight") clock.to(clock.t + step);
      else if (event.key === "ArrowLeft") clock.to(clock.t - step);
      else if (event.key === "Home") clock.to(clock.begin);
      else if (event.key === "End") clock.to(clock.end);
      else return;
      event.preventDefault();
    };
    addEventListener("keydown", hear);
    return () => removeEventListener("keydown", hear);
  }, [clock, tick]);
  const share = (time: number): string => `${(100 * (time - clock.begin)) / Math.max(1e-9, clock.end - clock.begin)}%`;
  return (
    <div class="player panel" role="group" aria-label="Time">
      <button type="button" class="main" onClick={() => clock.play(!clock.playing)}>
        {clock.playing ? "Pause" : "Play"}
      </button>
      <button type="button" aria-label="One tick back" onClick={() => clock.to(clock.t - tick)}>
        ‹
      </button>
      <button type="button" aria-label="One tick on" onClick={() => clock.to(clock.t + tick)}>
        ›
      </button>
      <span class="track">
        <input
          type="range" min={clock.begin} max={clock.end} step={tick} value={t}
          aria-label="Sim time" aria-valuetext={at(t)}
          onInput={(event) => clock.to(Number((event.target as HTMLInputElement).value))}
        />
        {marks.map((mark) => (
          <i key={`${mark.t}${mark.what}`} class={mark.kind} style={{ left: share(mark.t) }} title={`${at(mark.t)} ${mark.what}`} />
        ))}
      </span>
      <output>{at(t)}</output>
      {marks
        .filter((mark) => mark.kind !== "event")
        .map((mark) => (
          <button key={mark.kind} type="button" onClick={() => clock.to(mark.t)}>
            To {mark.what}
          </button>
        ))}
      <label>
        <span class="away">Playing speed</span>
        <select value={clock.rate} onChange={(event) => void (clock.rate = Number((event.target as HTMLSelectElement).value))}>
          {RATES.map((rate) => (
            <option key={rate} value={rate}>
              {rate}×
            </option>
          ))}
        </select>
      </label>
    </div>
  );
}
