// Values as people read them.
import type { Value } from "./data";

/** A number with as many digits as it is worth. */
export function number(value: number): string {
  if (!Number.isFinite(value)) return String(value);
  const size = Math.abs(value);
  if (Number.isInteger(value) && size < 1e7) return String(value);
  if (size >= 1e6 || (size > 0 && size < 1e-3)) return value.toExponential(2);
  return value.toFixed(size >= 100 ? 1 : size >= 1 ? 2 : 3);
}

/** A value with its unit; a dash where there is none, which is not 0. */
export function text(value: Value | undefined, unit = ""): string {
  if (value === null || value === undefined) return "–";
  const shown = typeof value === "number" ? number(value) : String(value).replaceAll("_", " ");
  return unit ? `${shown} ${unit.replace("^2", "²")}` : shown;
}

const UNITS: Record<string, string> = {
  _mps2: "m/s²", _mps: "m/s", _kmh: "km/h", _deg: "°", _rad: "rad", _ms: "ms", _kg: "kg", _hz: "Hz", _m: "m", _s: "s",
};
const SHORT = /\b(aeb|dtc|ttc|kpi|gps|gnss|imu)\b/g;

/** Names that say too little by themselves. */
const TITLES = new Map([["model", "perception model"]]);

/** What a name in a campaign file means, and its unit: `storyboard.ego.speed_kmh` is `ego speed` in `km/h`. */
export function called(name: string): { title: string; unit: string } {
  const suffix = Object.keys(UNITS).find((one) => name.endsWith(one)) ?? "";
  const bare = name.slice(0, name.length - suffix.length).replace(/^(scenario|storyboard|environment|autonomy|axis|actors)\./, "").replace(/^actors\./, "");
  const title = bare.replaceAll(/[_.]/g, " ").trim().replaceAll(SHORT, (word) => word.toUpperCase());
  return { title: TITLES.get(title) ?? (title || plain(name)), unit: UNITS[suffix] ?? "" };
}

/** A name of a campaign file with its unit in brackets. */
export function titled(name: string): string {
  const { title, unit } = called(name);
  return unit ? `${title} [${unit}]` : title;
}

/** A length of time. */
export function span(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return "–";
  const whole = Math.max(0, Math.round(seconds));
  if (seconds > 0 && seconds < 10) return `${seconds.toFixed(1)} s`;
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  if (whole < 86400) return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
  return `${Math.floor(whole / 86400)} d ${Math.floor((whole % 86400) / 3600)} h`;
}

/** The hour of the clock on the wall at which something ends that takes `seconds` more. */
export function hour(seconds: number): string {
  const end = new Date(Date.now() + seconds * 1000);
  return `${String(end.getHours()).padStart(2, "0")}:${String(end.getMinutes()).padStart(2, "0")}`;
}

export const plain = (name: string): string => name.replaceAll("_", " ");
export const capital = (text: string): string => text.charAt(0).toUpperCase() + text.slice(1);
export const at = (t: number): string => `${t.toFixed(2)} s`;
export const count = (n: number, one: string, many = `${one}s`): string => `${n} ${n === 1 ? one : many}`;
