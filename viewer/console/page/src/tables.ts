// The table of a run as it stands now: read once, then kept up by the stream.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { forget, type RunInfo, type TableData } from "./data";
import { useData, useEpoch, useEvents } from "./hooks";
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

/** A read of the table that is under way. */
interface Reading {
  /** What was there when it began. */
  info: RunInfo | null;
  data: TableData | null;
  events: Events["table"][];
  /** Version of the table when the stream began, if that was meanwhile. */
  hello: string | undefined;
}

export function useTable(run: string): Shown {
  const [again, setAgain] = useState(0);
  const epoch = useEpoch();
  const reading = useRef<Reading | null>(null);
  const newest = useRef<{ info: RunInfo | null; data: TableData | null }>({ info: null, data: null });
  // Before those of `useData`, which begin to read: no event falls between.
  useEffect(() => {
    reading.current = { ...newest.current, events: [], hello: undefined };
  }, [run, again, epoch]);
  const info = useData<RunInfo>(run ? `runs/${run}/run.json` : null, again);
  const data = useData<TableData>(run ? `runs/${run}/table.json` : null, again);
  newest.current = { info: info.data, data: data.data };
  const [version, setVersion] = useState(0);
  const frame = useRef(0);
  const readAgain = (): void => {
    forget();
    setAgain((before) => before + 1);
  };
  const table = useMemo(() => {
    if (info.data === null || data.data === null) return null;
    knowKinds(info.data.verdict_words);
    const made = new Table(data.data, info.data.columns, kinds);
    // Those up to the one that led to this version are in it.
    const events = reading.current?.events ?? [];
    const known = events.findLastIndex((event) => event.version === made.version);
    for (const event of events.slice(known + 1)) made.change(event.version, event.rows ?? {}, event.cases ?? []);
    return made;
  }, [info.data, data.data]);
  useEffect(() => {
    const read = reading.current;
    if (read === null || info.data === null || data.data === null) return;
    if (info.data === read.info || data.data === read.data) return;
    reading.current = null;
    // What changed between the answer and the begin of the stream, nobody has sent.
    if (read.hello !== undefined && read.hello !== data.data.version) readAgain();
  }, [info.data, data.data]);
  useEvents("hello", ({ version: versions }) => {
    const now = versions[run];
    if (now === undefined) return;
    if (reading.current !== null) reading.current.hello = now;
    else if (table !== null && table.version !== now) readAgain();
  });
  useEvents("table", (event) => {
    if (event.run !== run) return;
    if (event.reset) {
      readAgain();
      return;
    }
    if (reading.current !== null) {
      reading.current.events.push(event);
      if (reading.current.events.length > KEPT_MAX) reading.current.events.shift();
    }
    if (table === null) return;
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
