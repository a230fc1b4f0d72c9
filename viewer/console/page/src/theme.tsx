// Light or dark: as the system says, unless somebody chose.
import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";

const KEPT = "console-theme";
const CHOICES = ["system", "light", "dark"] as const;
type Choice = (typeof CHOICES)[number];

function kept(): Choice {
  try {
    const choice = localStorage.getItem(KEPT) as Choice | null;
    return choice !== null && CHOICES.includes(choice) ? choice : "system";
  } catch {
    return "system"; // a page from a disk, in a browser that keeps nothing
  }
}

const prefersDark = matchMedia("(prefers-color-scheme: dark)");

/** Says `change` when colours changed. */
export const colors = new EventTarget();

function show(choice: Choice): void {
  const dark = choice === "dark" || (choice === "system" && prefersDark.matches);
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  colors.dispatchEvent(new Event("change"));
}
show(kept());

/** A colour of the page, for what is drawn. */
export const color = (name: string): string =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim() || "#888888";

export function Theme(): JSX.Element {
  const [choice, setChoice] = useState(kept);
  useEffect(() => {
    show(choice);
    try {
      if (choice === "system") localStorage.removeItem(KEPT);
      else localStorage.setItem(KEPT, choice);
    } catch {
      // It holds for this page then.
    }
    const hear = (): void => show(choice);
    prefersDark.addEventListener("change", hear);
    return () => prefersDark.removeEventListener("change", hear);
  }, [choice]);
  return (
    <label class="theme">
      <span class="colours">Colours</span>{" "}
      <select value={choice} onChange={(event) => setChoice((event.target as HTMLSelectElement).value as Choice)}>
        {CHOICES.map((one) => (
          <option key={one} value={one}>
            {one === "system" ? "as the system" : one}
          </option>
        ))}
      </select>
    </label>
  );
}
