// Small parts of all views.
import type { ComponentChildren, JSX } from "preact";
import { useState } from "preact/hooks";
import type { VerdictKind } from "./data";
import { capital, plain } from "./words";

/** Kinds of verdicts by name; filled by the first answer that has them. */
export const kinds = new Map<string, VerdictKind>([
  ["running", { name: "running", color: "#009E73", symbol: "▶", rank: 100, passes: false }],
  ["waiting", { name: "waiting", color: "#A9AEB5", symbol: "…", rank: 101, passes: false }],
]);

export function knowKinds(words: VerdictKind[] | undefined): void {
  for (const kind of words ?? []) kinds.set(kind.name, kind);
}

export const colorOf = (verdict: string): string => kinds.get(verdict)?.color ?? "#565B62";
export const symbolOf = (verdict: string): string => kinds.get(verdict)?.symbol ?? "•";
export const wordsOf = (verdict: string): string => kinds.get(verdict)?.words ?? plain(verdict);

const linear = (part: number): number => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);

/** Colour of text on `fill`, `#rrggbb`: the one of white and nearly black that has more contrast. */
export function inkOn(fill: string): string {
  const [red = 0, green = 0, blue = 0] = [1, 3, 5].map((at) => linear(parseInt(fill.slice(at, at + 2), 16) / 255));
  const light = 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  return 1.05 / (light + 0.05) >= (light + 0.05) / 0.059 ? "#FFFFFF" : "#16191D";
}

export function Icon({ verdict }: { verdict: string }): JSX.Element {
  const fill = colorOf(verdict);
  return (
    <b class="icon" style={{ background: fill, color: inkOn(fill) }} aria-hidden="true">
      {symbolOf(verdict)}
    </b>
  );
}

/** An icon that stands alone: who does not see it hears the verdict. */
export function VerdictSign({ verdict }: { verdict: string }): JSX.Element {
  return (
    <span title={wordsOf(verdict)}>
      <Icon verdict={verdict} />
      <span class="away">{wordsOf(verdict)}: </span>
    </span>
  );
}

export function Chip({ verdict, count }: { verdict: string; count?: number }): JSX.Element {
  return (
    <span class="chip">
      <Icon verdict={verdict} />
      {count === undefined ? wordsOf(verdict) : `${count} ${wordsOf(verdict)}`}
    </span>
  );
}

/** Shares of verdicts, worst first, and what has not ended. */
export function Shares({ verdicts, total }: { verdicts: Record<string, number>; total: number }): JSX.Element {
  const parts = byRank(verdicts);
  const words = parts.map(([name, n]) => `${n} ${wordsOf(name)}`).join(", ") || "nothing has ended";
  return (
    <div class="bar" role="img" aria-label={`Of ${total}: ${words}`}>
      {parts.map(([name, n]) => (
        <span key={name} style={{ background: colorOf(name), flexGrow: n }} />
      ))}
      <span class="rest" style={{ flexGrow: Math.max(0, total - parts.reduce((sum, [, n]) => sum + n, 0)) }} />
    </div>
  );
}

export function byRank(verdicts: Record<string, number>): [string, number][] {
  const rank = (name: string): number => kinds.get(name)?.rank ?? 99;
  return Object.entries(verdicts)
    .filter(([, n]) => n > 0)
    .sort(([a], [b]) => rank(a) - rank(b));
}

/** While there are no data: why. */
export function Waiting({ error, what }: { error: string; what: string }): JSX.Element {
  return error ? (
    <p class="box notice" role="status">
      {capital(what)}: {error}
    </p>
  ) : (
    <p class="dim" role="status">
      Reading {what} …
    </p>
  );
}

/** A command, and a button that copies it. */
export function Command({ text, label, plain: quiet = false }: { text: string; label: string; plain?: boolean }): JSX.Element {
  const [said, setSaid] = useState("");
  const copy = async (): Promise<void> => {
    setSaid((await copied(text)) ? "Copied" : "Select it and copy it yourself");
  };
  return (
    <div class="command">
      <pre tabIndex={0} aria-label={label}>
        {text}
      </pre>
      <button type="button" class={quiet ? "" : "main"} aria-label={quiet ? `Copy: ${label}` : undefined} onClick={() => void copy()}>
        Copy
      </button>
      <span role="status">{said}</span>
    </div>
  );
}

export async function copied(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Without a permission, or on a page from a disk.
    const area = document.createElement("textarea");
    area.value = text;
    area.setAttribute("readonly", "");
    area.className = "away";
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    return done;
  }
}

/** Give a text as a file to download. */
export function save(name: string, text: string, type: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export function Figure({ title, children }: { title: ComponentChildren; children: ComponentChildren }): JSX.Element {
  return (
    <section class="panel">
      <h2>{title}</h2>
      {children}
    </section>
  );
}
