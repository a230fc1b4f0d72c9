// The cases that run now, on the first page of a campaign.
import type { JSX } from "preact";
import { useRef, useState } from "preact/hooks";
import { Picture } from "./details";
import { useEvents } from "./hooks";
import { lagWords, late, useLag } from "./lag";
import { Figure } from "./parts";
import { toCase, toWall } from "./route";
import type { Table } from "./table";
import { count } from "./words";

/** Running cases that are shown; the wall has all of them. */
const SHOWN_MAX = 8;

interface Inputs {
  run: string;
  table: Table;
  /** Whether there was a picture of a case when the page asked. */
  has: (index: number) => boolean;
}

export function Running({ run, table, has }: Inputs): JSX.Element | null {
  const indices: number[] = [];
  for (let index = 0; index < table.size; index++) if (table.verdict(index) === "running") indices.push(index);
  const shown = indices.slice(0, SHOWN_MAX);
  const versions = usePictures(run, shown);
  const lag = useLag(run);
  if (shown.length === 0) return null;
  return (
    <Figure title="Running now">
      {late(lag) && (
        <p class="box notice" role="status">
          {lagWords(lag)}
        </p>
      )}
      <ul class="tiles">
        {shown.map((index) => {
          const name = table.cases[index]!;
          const version = versions.get(index);
          return (
            <li key={name}>
              {version !== undefined || has(index) ? <Picture run={run} name={name} version={version} /> : <p class="moment dim">No picture yet</p>}
              <a href={toCase(run, name)}>{name}</a>
            </li>
          );
        })}
      </ul>
      {indices.length > shown.length && (
        <p>
          <a href={toWall(run, [["filter", "verdict=running"]])}>All {count(indices.length, "running case")} on the wall</a>
        </p>
      )}
    </Figure>
  );
}

/** The number of the latest picture of each case that is shown, as far as one came while the page looked. */
function usePictures(run: string, shown: number[]): Map<number, number> {
  const versions = useRef(new Map<number, number>());
  const [, setDrawn] = useState(0);
  useEvents("picture", (event) => {
    if (event.run !== run) return;
    // The others are remembered, too: one of them is shown when a place becomes free.
    for (const [index, version] of event.pictures) versions.current.set(index, version);
    if (event.pictures.some(([index]) => shown.includes(index))) setDrawn((before) => before + 1);
  });
  return versions.current;
}
