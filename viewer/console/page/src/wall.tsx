// The wall: all cases of a run as dots, pictures, a heat map of pictures, or rows.
import type { JSX } from "preact";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Canvas } from "./canvas";
import type { Atlas, RunInfo } from "./data";
import { Details } from "./details";
import { useClosed, useData, useEvents, useSize } from "./hooks";
import { fitting, layOut, TILE_MAX, TILE_MIN } from "./layout";
import { late, lagWords, useLag } from "./lag";
import { live } from "./live";
import { copied, save, Waiting } from "./parts";
import { BESIDE_MAX, requery, toBeside, toCase } from "./route";
import { Rows } from "./rows";
import { csv, filter, type Filter, groupable, grouped, ordered, type Table, WORST } from "./table";
import { useTable } from "./tables";
import { Thumbs } from "./thumbs";
import { Tools } from "./tools";
import { count } from "./words";

interface Inputs {
  run: string;
  query: Map<string, string>;
  isLive: boolean;
}

export function WallView({ run, query }: Inputs): JSX.Element {
  const { info, table, version, error } = useTable(run);
  if (info === null || table === null) return <Waiting error={error} what={`the cases of ${run}`} />;
  return <Wall run={run} query={query} info={info} table={table} version={version} />;
}

/** Few cases are not shown larger than so by themselves [px]. */
const WIDE_MAX = 300;

/** Zoom as it stands in the address: the logarithm of a tile's width, 0 to 100. */
const tileOf = (zoom: number): number => Math.round(TILE_MIN * (TILE_MAX / TILE_MIN) ** (zoom / 100));
const zoomOf = (tile: number): number => (Math.log(tile / TILE_MIN) / Math.log(TILE_MAX / TILE_MIN)) * 100;

interface WallInputs extends Omit<Inputs, "isLive"> {
  info: RunInfo;
  table: Table;
  version: number;
}

function Wall({ run, query, info, table, version }: WallInputs): JSX.Element {
  const [frame, width, height] = useSize<HTMLDivElement>();
  const [redraw, setRedraw] = useState(0);
  const lag = useLag(run);
  const atlas = useData<Atlas>(`runs/${run}/pictures/atlas.json`);
  const thumbs = useClosed(
    () => new Thumbs(run, (index) => table.cases[index]!, () => setRedraw((n) => n + 1)),
    [run, table],
  );
  thumbs.atlas = atlas.data;

  const asked = query.get("filter") ?? "";
  const sort = query.get("sort") || WORST;
  const axes = (query.get("group") ?? "").split(",").filter((name) => groupable(info).includes(name)).slice(0, 2);
  const asRows = query.get("as") === "rows";
  const lets: Filter = useMemo(() => filter(table, asked), [table, asked, version]);
  const order = useMemo(() => ordered(table, lets.matches, sort), [lets, sort]);
  const groups = useMemo(() => grouped(table, info, order, axes), [order, axes.join()]);
  const fit = useMemo(() => (width && height ? fitting(groups, width, height) : 60), [groups, width, height]);
  const zoomed = query.get("zoom") ?? "";
  const tile = zoomed === "" ? Math.min(WIDE_MAX, Math.max(width > 600 ? 60 : 44, fit)) : tileOf(Number(zoomed) || 0);
  const layout = useMemo(() => layOut(groups, Math.max(1, width), tile), [groups, width, tile]);
  const chosen = useMemo(() => chosenOf(table, query.get("sel") ?? ""), [table, query.get("sel")]);
  const active = table.index(query.get("at") ?? "");

  useEvents("picture", (event) => {
    if (event.run !== run) return;
    for (const [index, picture] of event.pictures) thumbs.renew(index, picture);
    setRedraw((n) => n + 1);
  });
  useEvents("table", (event) => {
    if (event.run !== run) return;
    for (const [index, cells] of Object.entries(event.rows ?? {})) {
      if (cells.verdict) thumbs.renew(Number(index));
    }
  });
  useEffect(() => {
    const hear = (): void => thumbs.retry();
    live.addEventListener("healed", hear);
    return () => live.removeEventListener("healed", hear);
  }, [thumbs]);

  const choose = (indices: number[], how: "toggle" | "add"): void => {
    const now = new Set(chosen);
    for (const index of indices) {
      if (how === "toggle" && now.has(index)) now.delete(index);
      else now.add(index);
    }
    requery({ sel: [...now].join(",") });
  };
  const zoomTo = useRef((wide: number) => {
    requery({ zoom: zoomOf(Math.min(TILE_MAX, Math.max(TILE_MIN, wide))).toFixed(1) });
  });
  const setActive = (index: number): void => requery({ at: table.cases[index] ?? "" });
  const open = (index: number): void => void (location.hash = toCase(run, table.cases[index]!));
  return (
    <div class="wallpage">
      <h1 class="away">The wall of {info.name}</h1>
      <Tools
        table={table} info={info} asked={asked} error={lets.error} sort={sort} axes={axes} asRows={asRows}
        zoom={zoomOf(tile)} onFit={() => zoomTo.current(fit)} counts={`${order.length} of ${table.size}`} hint={active < 0 && table.size > 0}
      />
      <div class={`wallbody ${active >= 0 ? "withdetails" : ""}`}>
        {asRows ? (
          <Rows table={table} order={order} active={active} chosen={chosen} sort={sort} onActive={setActive} onChoose={choose} onOpen={open} />
        ) : (
          <Canvas
            layout={layout} table={table} thumbs={thumbs} version={version + redraw + (atlas.data === null ? 0 : 1)} active={active} chosen={chosen}
            onActive={setActive} onChoose={choose} onOpen={open} onZoom={(factor) => zoomTo.current(tile * factor)}
            frame={frame} width={width} height={height} zoomed={zoomed !== ""}
          />
        )}
        {active >= 0 && <Details key={active} run={run} table={table} index={active} version={version + redraw} chosen={chosen.has(active)} pictured={(atlas.data?.has[active] ?? false) || thumbs.heard(active)} onChoose={() => choose([active], "toggle")} />}
      </div>
      {order.length === 0 && (
        <p class="box notice" role="status">
          No case passes the filter. <button type="button" onClick={() => requery({ filter: "" })}>Clear it</button>
        </p>
      )}
      {!asRows && order.length > 0 && info.state === "finished" && table.cases.every((_, index) => thumbs.without(index)) && (
        <p class="box notice" role="status">
          {info.away ? (
            "No pictures: the files of the campaign are not here."
          ) : (
            <>
              No pictures: this run was not recorded. Run it with <code>--view record</code>.
            </>
          )}
        </p>
      )}
      {late(lag) && (
        <p class="box notice lag" role="status">
          {lagWords(lag)}
        </p>
      )}
      {chosen.size > 0 && <Chosen run={run} table={table} chosen={[...chosen]} />}
    </div>
  );
}

function chosenOf(table: Table, words: string): Set<number> {
  const indices = words.split(",").filter(Boolean).map(Number);
  return new Set(indices.filter((index) => Number.isInteger(index) && index >= 0 && index < table.size));
}

function Chosen({ run, table, chosen }: { run: string; table: Table; chosen: number[] }): JSX.Element {
  const [said, setSaid] = useState("");
  const names = chosen.map((index) => table.cases[index]!);
  const copy = async (): Promise<void> => {
    setSaid((await copied(names.join("\n"))) ? "Case ids copied" : "The browser lets nothing be copied");
  };
  return (
    <div class="chosen panel" role="group" aria-label="Selected cases">
      <strong>{count(chosen.length, "case")} selected</strong>
      {names.length > 1 && names.length <= BESIDE_MAX && (
        <a class="button main" href={toBeside(run, names[0]!, names.slice(1).map((name) => ({ run, case: name })))}>
          Compare side by side
        </a>
      )}
      {names.length > BESIDE_MAX && <span class="dim">At most {BESIDE_MAX} are compared side by side.</span>}
      <button type="button" onClick={() => save(`${run}.csv`, csv(table, chosen), "text/csv")}>
        Save as CSV
      </button>
      <button type="button" onClick={() => save(`${run}-cases.txt`, `${names.join("\n")}\n`, "text/plain")}>
        Save case ids
      </button>
      <button type="button" onClick={() => void copy()}>
        Copy case ids
      </button>
      <button type="button" onClick={() => requery({ sel: "" })}>
        Clear
      </button>
      <span role="status">{said}</span>
    </div>
  );
}
