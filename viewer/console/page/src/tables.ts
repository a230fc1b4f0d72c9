// The table of a run as it stands now: read once, then kept up by the stream.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import type { RunInfo, TableData } from "./data";
import { useData, useEvents } from "./hooks";
import type { Events } from "./live";
import { kinds, knowKinds } from "./parts";
import { Table } from "./table";

export interface Shown {
  info: RunInfo | null;
  table: Table | null;
  /** Grows when a value changed. */
  version: number;
  error: string;
}

/** Events that came while the table was on its way are kept; nobody needs more. */
const KEPT_MAX = 2000;

export function useTable(run: string): Shown {
  const [again, setAgain] = useState(0);
  const info = useData<RunInfo>(run ? `runs/${run}/run.json` : null, again);
  const data = useData<TableData>(run ? `runs/${run}/table.json` : null, again);
  const [version, setVersion] = useState(0);
  const kept = useRef<Events["table"][]>([]);
  const frame = useRef(0);
  const table = useMemo(() => {
    if (info.data === null || data.data === null) return null;
    knowKinds(info.data.verdict_words);
    const made = new Table(data.data, info.data.columns, kinds);
    // Those up to the one that led to this version are in it.
    const known = kept.current.findLastIndex((event) => event.version === made.version);
    for (const event of kept.current.slice(known + 1)) made.change(event.version, event.rows ?? {}, event.cases ?? []);
    kept.current = [];
    return made;
  }, [info.data, data.data]);
  useEvents("table", (event) => {
    if (event.run !== run) return;
    if (event.reset) {
      kept.current = [];
      setAgain((before) => before + 1);
      return;
    }
    if (table === null) {
      kept.current.push(event);
      if (kept.current.length > KEPT_MAX) kept.current.shift();
      return;
    }
    table.change(event.version, event.rows ?? {}, event.cases ?? []);
    if (frame.current) return;
    frame.current = requestAnimationFrame(() => {
      frame.current = 0;
      setVersion((before) => before + 1);
    });
  });
  useEffect(() => () => cancelAnimationFrame(frame.current), []);
  return { info: info.data, table, version, error: info.error || data.error };
}
