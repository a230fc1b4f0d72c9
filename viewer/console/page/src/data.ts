// What the server, or the files of a static console, give: types, and the one way to read them.

export interface VerdictKind {
  name: string;
  words?: string;
  color: string;
  symbol: string;
  rank: number;
  passes: boolean;
}

export interface RunSummary {
  id: string;
  name: string;
  state: string;
  paused?: boolean;
  /** Why it cannot be read; its numbers mean nothing then. */
  error?: string | null;
  cases: number;
  done: number;
  /** Cases that workers have now; null: no conductor says it. */
  running?: number | null;
  verdicts: Record<string, number>;
  started_s: number | null;
  elapsed_s: number | null;
  eta_s: number | null;
  per_minute: number | null;
  workers: number | null;
  gpus: number | null;
  device_hours: number | null;
}

export interface Runs {
  live: boolean;
  roles: string;
  runs: RunSummary[];
  verdict_words?: VerdictKind[];
}

export type Kind = "axis" | "kpi" | "text" | "verdict" | "number";
export interface Column {
  name: string;
  kind: Kind;
  unit: string;
  better: "low" | "high" | null;
  title: string;
}

/** Where the files of a campaign are, if none is at hand. */
export interface Away {
  folder: string | null;
  command: string | null;
}

export interface RunInfo extends RunSummary {
  away?: Away | null;
  axes: { name: string; title?: string; values: (string | number)[] }[];
  columns: Column[];
  verdict_words: VerdictKind[];
  links: Record<string, string | null>;
  fingerprint: string | null;
}

export type Value = string | number | boolean | null;
export interface TableData {
  version: string;
  cases: string[];
  columns: Record<string, Value[]>;
}

export interface Atlas {
  sizes: [number, number][];
  per_atlas: number;
  has: boolean[];
}

export interface Film {
  per_strip: number;
  strips: number;
  fps: number;
  frames: number;
  size: [number, number];
  first_t: number;
  /** Size of the camera's picture, in which boxes are [px]. */
  picture?: [number, number];
}

export interface Beside {
  case: string;
  value: Value;
  index?: number;
  state?: string;
  verdict?: string | null;
}

export interface CaseInfo {
  case: string;
  away?: Away | null;
  index: number;
  state: string;
  outcome: string | null;
  verdict: string | null;
  reasons: string[];
  axes: Record<string, Value>;
  kpis: { name: string; title: string; value: Value; unit: string; better: "low" | "high" | null; doc?: string }[];
  names: Record<string, string>;
  moment: { t: number | null; what: string } | null;
  events: { t: number; what: string; detail: string }[];
  neighbours: Record<string, { before: Beside | null; after: Beside | null }>;
  repeat: string;
  log: { lines: string[]; traceback: string[] | null; cut: boolean } | null;
  attempts: {
    count: number;
    committed: number | null;
    charges: string[];
    steered: string[];
    /** Workers that began it while another one had it. */
    doubles?: string[];
    worker: string | null;
    device_class: string | null;
    wall_s: number | null;
  };
  film: Film | null;
  links: { recording: string | null; in_full: string | null; video: string | null; incomplete: boolean | null };
}

export interface Actor {
  name: string;
  kind: string;
  size: [number, number, number] | null;
  /** Middle of the hull from the point whose pose is given [m]. */
  center?: [number, number, number] | null;
  x: (number | null)[];
  y: (number | null)[];
  yaw: (number | null)[];
}
export type Line = [number, number][];
export interface Box {
  x: number;
  y: number;
  w: number;
  h: number;
  label: string;
}
export interface Hull {
  kind: string;
  x: number;
  y: number;
  yaw: number;
  size: [number, number, number];
}
export interface Series {
  t: number[];
  series: Record<string, { unit: string; title?: string; v: (number | null)[] }>;
  actors: Actor[];
  road: { lines: Line[]; hulls: Hull[] } | null;
  detections: { t: number; boxes: Box[]; truth: Box[]; trigger: Box | null }[];
}

export interface Workers {
  age_s: number | null;
  draining: boolean;
  storage_error: string | null;
  workers: {
    id: string;
    host: string;
    device_class: string;
    slots: number;
    draining: boolean;
    held: number;
    remaining_s: number | null;
    age_s: number;
    present: boolean;
  }[];
  leases: { case: string; worker: string; attempt: number; tick: number; for_s: number; by_hand: boolean }[];
  notes: string[];
  hosts: string[];
  quarantine: { case: string; charge: string; explain: string[] }[];
  resources: Record<string, Record<string, (number | null)[]> & { t: number[] }>;
}

/** Verdict of a case, or how far it is. */
export const statusOf = (info: CaseInfo): string => info.verdict ?? info.state;

const KEPT = "steer";

/** Take the token out of the address into this tab's memory. */
export function takeToken(): void {
  const found = /^#steer=([\w-]+)$/.exec(location.hash)?.[1];
  if (found === undefined) return;
  try {
    sessionStorage.setItem(KEPT, found);
  } catch {
    // A browser that keeps nothing: look only.
  }
  history.replaceState(null, "", "#/");
}

/** What the printed address said, by which the server knows who may operate; empty: nothing. */
export function token(): string {
  try {
    return sessionStorage.getItem(KEPT) ?? "";
  } catch {
    return "";
  }
}

/** Whether this page's data are files beside it, for which nobody answers. */
export const STATIC = document.documentElement.dataset.static !== undefined;

/** There is no such thing: asking again does not help. */
export class Missing extends Error {}

const waiting = new Map<string, (value: unknown) => void>();

declare global {
  interface Window {
    consoleData: (path: string, value: unknown) => void;
  }
}
window.consoleData = (path, value) => waiting.get(path)?.(typeof value === "string" ? JSON.parse(value) : value);

// Browsers refuse `fetch` to a page that was opened from a disk, and admit scripts.
function fromScript(path: string): Promise<unknown> {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    const end = (): void => {
      waiting.delete(path);
      script.remove();
    };
    waiting.set(path, resolve);
    script.src = `data/${inAddress(path)}.js`;
    script.onload = end;
    script.onerror = () => {
      end();
      reject(new Missing(`data/${path} is not part of this console`));
    };
    document.head.append(script);
  });
}

/** A line that is cut without a word answers nothing and breaks nothing: after so long it is given up [ms]. */
export const PATIENCE_MS = 60_000;
/** A comparison is made when it is asked for, which may take ten minutes [ms]. */
const COMPARE_MS = 660_000;

async function fromServer(path: string): Promise<unknown> {
  const headers: HeadersInit = token() ? { "X-Steer-Token": token() } : {};
  const signal = AbortSignal.timeout(path.startsWith("compare/") ? COMPARE_MS : PATIENCE_MS);
  const answer = await fetch(`data/${inAddress(path)}`, { cache: "no-cache", headers, signal });
  if (answer.ok) return answer.json();
  const words = (await answer.text()).slice(0, 400).trim();
  if (answer.status >= 500) throw new Error(words || `the server says ${answer.status}`);
  throw new Missing(words || `the server says ${answer.status}`);
}

const inAddress = (path: string): string => path.split("/").map(encodeURIComponent).join("/");
const underway = new Map<string, Promise<unknown>>();

/** Data of a path below `data/`; two that ask at once share the answer. */
export function read<T>(path: string): Promise<T> {
  const before = underway.get(path);
  if (before !== undefined) return before as Promise<T>;
  const answer = (STATIC ? fromScript(path) : fromServer(path)).finally(() => {
    if (underway.get(path) === answer) underway.delete(path);
  });
  underway.set(path, answer);
  return answer as Promise<T>;
}

/** What is under way may be older than what was just heard: who asks from now on asks anew. */
export function forget(): void {
  if (!STATIC) underway.clear();
}

/** Address of a file below `data/`; `version` changes when its content does. */
export function file(path: string, version?: number): string {
  return `data/${inAddress(path)}${version === undefined || STATIC ? "" : `?v=${version}`}`;
}
