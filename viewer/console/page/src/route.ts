// Addresses of views: everything that a view shows stands behind the `#`, so that it can be shared.

export interface CaseRef {
  run: string;
  case: string;
}

/** Most cases that are compared. */
export const BESIDE_MAX = 8;

export interface Route {
  view: "runs" | "run" | "wall" | "case" | "beside" | "search" | "rulebook" | "report" | "workers" | "compare" | "lost";
  run: string;
  case: string;
  run2: string;
  /** Cases that stand beside the one of `case`. */
  others: CaseRef[];
  query: Map<string, string>;
}

const NONE = { run: "", case: "", run2: "", others: [] };

function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text; // a link that was cut in the middle of a character
  }
}

/** The view that an address names; `lost` where it names none. */
export function parse(hash: string): Route {
  const [path = "", asked = ""] = hash.replace(/^#/, "").split("?", 2);
  const query = new Map<string, string>();
  for (const part of asked.split("&")) {
    const at = part.indexOf("=");
    if (at > 0) query.set(decoded(part.slice(0, at)), decoded(part.slice(at + 1)));
  }
  const parts = path.split("/").filter(Boolean).map(decoded);
  const [first, run = "", view = "", name = "", beside = "", ...rest] = parts;
  const route = { ...NONE, run, query };
  if (first === undefined) return { ...route, view: "runs" };
  if (first === "compare" && run && view) return { ...route, view: "compare", run2: view };
  if (first !== "run" || !run) return { ...route, view: "lost" };
  if (!view) return { ...route, view: "run" };
  if (view === "case" && beside === "beside" && rest.length > 0 && rest.length % 2 === 0) {
    const others = rest.flatMap((run2, at) => (at % 2 ? [] : [{ run: run2, case: rest[at + 1]! }]));
    return { ...route, view: others.length < BESIDE_MAX ? "beside" : "lost", case: name, others };
  }
  if (view === "case" && name) return { ...route, view: "case", case: name };
  if (view === "wall" || view === "search" || view === "rulebook" || view === "report" || view === "workers") {
    return { ...route, view };
  }
  return { ...route, view: "lost" };
}

/** An address of its parts; empty values of the query are left out. */
export function address(parts: string[], query: Iterable<[string, string]> = []): string {
  const asked = [...query]
    .filter(([, value]) => value !== "")
    .map(([name, value]) => `${name}=${encodeURIComponent(value).replaceAll("%2C", ",")}`);
  return `#/${parts.map(encodeURIComponent).join("/")}${asked.length ? `?${asked.join("&")}` : ""}`;
}

export const toRun = (run: string): string => address(["run", run]);
export const toWall = (run: string, query: Iterable<[string, string]> = []): string =>
  address(["run", run, "wall"], query);
export const toCase = (run: string, name: string, t?: number | null): string =>
  address(["run", run, "case", name], t === undefined || t === null ? [] : [["t", String(t)]]);
export const toBeside = (run: string, name: string, others: CaseRef[]): string =>
  address(["run", run, "case", name, "beside", ...others.flatMap((other) => [other.run, other.case])]);

/** Change the query of the present address, without a step in the browser's history. */
export function requery(changes: Record<string, string>): void {
  const [path = "#/"] = location.hash.split("?", 1);
  const query = parse(location.hash).query;
  for (const [name, value] of Object.entries(changes)) query.set(name, value);
  const parts = path.replace(/^#\//, "").split("/").filter(Boolean).map(decoded);
  const hash = address(parts, query);
  if (hash === location.hash) return;
  history.replaceState(null, "", hash);
  dispatchEvent(new Event("requery"));
}
