// The case that is looked at on the wall: what it is, why it ended so, how to repeat it.
import type { JSX } from "preact";
import { type CaseInfo, file } from "./data";
import { useData } from "./hooks";
import { Chip, Command } from "./parts";
import { requery, toCase } from "./route";
import type { Table } from "./table";
import { plain, text } from "./words";

interface Inputs {
  run: string;
  table: Table;
  index: number;
  version: number;
  chosen: boolean;
  /** There is a picture of it. */
  pictured: boolean;
  onChoose: () => void;
}

export function Details({ run, table, index, version, chosen, pictured, onChoose }: Inputs): JSX.Element {
  const name = table.cases[index]!;
  const verdict = table.verdict(index);
  const info = useData<CaseInfo>(`runs/${run}/cases/${name}/case.json`, verdict);
  const kpis = table.columns.filter((column) => column.kind === "kpi" && table.value(column.name, index) !== null);
  const axes = table.columns.filter((column) => column.kind === "axis");
  return (
    <aside class="details" aria-label="Case that is looked at">
      <div class="line spread">
        <Chip verdict={verdict} />
        <button type="button" aria-label="Close" onClick={() => requery({ at: "" })}>
          ✕
        </button>
      </div>
      <h2>
        <a href={toCase(run, name)}>{name}</a>
      </h2>
      {pictured && <Picture run={run} name={name} version={verdict === "running" ? version : undefined} />}
      <p>
        <strong>{text(table.value("reason", index) ?? "no reason was given")}</strong>
      </p>
      <p class="line">
        <a class="button main" href={toCase(run, name)}>
          Open the case
        </a>
        <button type="button" aria-pressed={chosen} onClick={onChoose}>
          {chosen ? "Selected" : "Select"}
        </button>
      </p>
      {info.data !== null && info.data.repeat && (
        <>
          <h3>Repeat it</h3>
          <Command text={info.data.repeat} label="Command that repeats this case" />
        </>
      )}
      <dl>
        {[...axes, ...kpis].map((column) => (
          <div key={column.name}>
            <dt title={column.name}>{column.title || plain(column.name)}</dt>
            <dd>{text(table.value(column.name, index), column.unit)}</dd>
          </div>
        ))}
      </dl>
    </aside>
  );
}

/** The moment of a case; nothing where there is no picture. */
export function Picture({ run, name, version }: { run: string; name: string; version: number | undefined }): JSX.Element {
  const hide = (event: Event): void => void ((event.target as HTMLImageElement).hidden = true);
  const show = (event: Event): void => void ((event.target as HTMLImageElement).hidden = false);
  const url = file(`runs/${run}/cases/${name}/moment.webp`, version);
  return <img class="moment" src={url} alt={`What the camera of ${name} saw`} width="320" height="180" onError={hide} onLoad={show} />;
}
