// How old the pictures of running cases are, and how a page says so.
import { useEffect, useState } from "preact/hooks";
import { useEvents } from "./hooks";

/** Pictures that are older are said to lag [s]. */
export const LAG_MAX_S = 2;
/** A picture is spoken of for so long [ms]; where one is late, the next may be as well. */
const KEPT_MS = 20_000;

export interface Lag {
  /** Age of the oldest of the latest pictures [s]; null: nobody said it. */
  age_s: number | null;
  /** From where it counts: from the simulator, or from the coming to the console alone. */
  from: "simulator" | "console";
  /** How far the age may be off [s]; null: nobody knows. */
  within_s: number | null;
}

export const late = (lag: Lag | null): lag is Lag & { age_s: number } =>
  lag !== null && lag.age_s !== null && lag.age_s > LAG_MAX_S;

/** What a lag is in words. */
export function lagWords({ age_s: age, from, within_s: within }: Lag & { age_s: number }): string {
  const size = `${from === "console" ? "at least " : ""}${age.toFixed(1)} s`;
  const off = from === "simulator" && within !== null && within >= 0.1 ? ` (within ${within.toFixed(1)} s)` : "";
  return `The picture lags ${size} behind the simulator${off}.`;
}

/** The lag of a run's pictures, or of one case of it; null: no picture came lately. */
export function useLag(run: string, index?: number): Lag | null {
  const [lag, setLag] = useState<(Lag & { heard: number }) | null>(null);
  useEvents("picture", (event) => {
    if (event.run !== run) return;
    const ages = event.pictures.filter(([of]) => index === undefined || of === index).map(([, , , age]) => age);
    if (ages.length === 0) return;
    const known = ages.filter((age) => age !== null);
    setLag({
      age_s: known.length ? Math.max(...known) : null,
      from: event.from ?? "console",
      within_s: event.within_s ?? null,
      heard: Date.now(),
    });
  });
  useEffect(() => {
    if (lag === null) return;
    const timer = setTimeout(() => setLag(null), KEPT_MS);
    return () => clearTimeout(timer);
  }, [lag]);
  return lag;
}
