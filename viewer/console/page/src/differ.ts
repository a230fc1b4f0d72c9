// The first tick at which two drives differ.
import type { Series } from "./data";

export interface Difference {
  t: number;
  what: string;
  left: number | null;
  right: number | null;
  unit: string;
}

type Values = (number | null)[];

/** Compares, tick by tick, what both have: times, series, and poses of bodies of the same name; null: all is the same. */
export function firstDifference(left: Series, right: Series): Difference | null {
  const pairs: { what: string; unit: string; a: Values; b: Values }[] = [{ what: "sim time", unit: "s", a: left.t, b: right.t }];
  for (const [name, one] of Object.entries(left.series)) {
    const other = Object.hasOwn(right.series, name) ? right.series[name] : undefined;
    if (other !== undefined) pairs.push({ what: name, unit: one.unit, a: one.v, b: other.v });
  }
  for (const actor of left.actors) {
    const other = right.actors.find((one) => one.name === actor.name);
    if (other === undefined || actor.x.length < 2) continue;
    pairs.push({ what: `${actor.name} x`, unit: "m", a: actor.x, b: other.x });
    pairs.push({ what: `${actor.name} y`, unit: "m", a: actor.y, b: other.y });
    pairs.push({ what: `${actor.name} heading`, unit: "rad", a: actor.yaw, b: other.yaw });
  }
  const both = Math.min(left.t.length, right.t.length);
  for (let tick = 0; tick < both; tick++) {
    for (const { what, unit, a, b } of pairs) {
      const [one, two] = [a[tick] ?? null, b[tick] ?? null];
      if (one !== two) return { t: left.t[tick]!, what, left: one, right: two, unit };
    }
  }
  if (left.t.length === right.t.length) return null;
  const longer = left.t.length > right.t.length ? left.t : right.t;
  return { t: longer[both]!, what: "length of the drive", left: left.t.at(-1) ?? null, right: right.t.at(-1) ?? null, unit: "s" };
}
