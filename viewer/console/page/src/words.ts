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
  return unit ? `${shown} ${unit}` : shown;
}

/** A length of time. */
export function span(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return "–";
  const whole = Math.max(0, Math.round(seconds));
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
export const at = (t: number): string => `${t.toFixed(2)} s`;
export const count = (n: number, one: string, many = `${one}s`): string => `${n} ${n === 1 ? one : many}`;
