// What stands above the wall: filter, order, groups, zoom.
import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";
import type { RunInfo } from "./data";
import { byRank, Chip } from "./parts";
import { requery } from "./route";
import { axisTitle, groupable, headOf, type Table, WORST } from "./table";

interface Inputs {
  table: Table;
  info: RunInfo;
  asked: string;
  error: string;
  sort: string;
  axes: string[];
  asRows: boolean;
  zoom: number;
  counts: string;
  /** Nobody has looked at a case yet. */
  hint: boolean;
  onFit: () => void;
}

const TYPING_MS = 80;

export function Tools(inputs: Inputs): JSX.Element {
  const { info, axes, asRows, zoom } = inputs;
  return (
    <div class="tools">
      <Search {...inputs} />
      <Order {...inputs} />
      <Group label="Group across" name={axes[0] ?? ""} info={info} onChange={(name) => requery({ group: [name, axes[1] ?? ""].filter(Boolean).join(",") })} />
      {axes.length > 0 && (
        <Group label="Down" name={axes[1] ?? ""} info={info} onChange={(name) => requery({ group: [axes[0]!, name].filter(Boolean).join(",") })} />
      )}
      <span class="line">
        <label>
          Size{" "}
          <input
            type="range" min="0" max="100" step="0.5" value={zoom} disabled={asRows}
            onInput={(event) => requery({ zoom: (event.target as HTMLInputElement).value })}
          />
        </label>
        <button type="button" disabled={asRows} title="All cases on the screen" onClick={inputs.onFit}>
          Fit
        </button>
        <button type="button" aria-pressed={asRows} title="As a table" onClick={() => requery({ as: asRows ? "" : "rows" })}>
          Rows
        </button>
      </span>
      <Verdicts {...inputs} />
    </div>
  );
}

function Search({ asked, error, counts }: Inputs): JSX.Element {
  const [typed, setTyped] = useState(asked);
  useEffect(() => setTyped(asked), [asked]);
  useEffect(() => {
    if (typed === asked) return;
    const timer = setTimeout(() => requery({ filter: typed }), TYPING_MS);
    return () => clearTimeout(timer);
  }, [typed]);
  return (
    <span class="finder">
      <label>
        <span class="away">Filter by a word or by a column, as in weather=heavy_fog or impact_speed_mps&gt;3</span>
        <input
          type="search" value={typed} placeholder="filter: fog, weather=heavy_fog, dtc_min_m<2"
          aria-invalid={error !== ""} aria-describedby="filter-says" spellcheck={false}
          onInput={(event) => setTyped((event.target as HTMLInputElement).value)}
        />
      </label>
      <span id="filter-says" role="status" class={error ? "wrong" : "dim"}>
        {error || `${counts} cases`}
      </span>
    </span>
  );
}

function Order({ table, sort }: Inputs): JSX.Element {
  const name = sort.replace(/^-/, "");
  const down = sort.startsWith("-");
  return (
    <span class="line">
      <label>
        Sort{" "}
        <select value={name} onChange={(event) => requery({ sort: (event.target as HTMLSelectElement).value })}>
          <option value={WORST}>worst first</option>
          <option value="case">case number</option>
          {table.columns.map((column) => (
            <option key={column.name} value={column.name}>
              {headOf(column)}
            </option>
          ))}
        </select>
      </label>
      {name !== WORST && (
        <button type="button" onClick={() => requery({ sort: down ? name : `-${name}` })}>
          {down ? "↓ falling" : "↑ rising"}
        </button>
      )}
    </span>
  );
}

function Group({ label, name, info, onChange }: {
  label: string; name: string; info: RunInfo; onChange: (name: string) => void;
}): JSX.Element {
  return (
    <label>
      {label}{" "}
      <select value={name} onChange={(event) => onChange((event.target as HTMLSelectElement).value)}>
        <option value="">–</option>
        {groupable(info).map((axis) => (
          <option key={axis} value={axis}>
            {axisTitle(info, axis)}
          </option>
        ))}
      </select>
    </label>
  );
}

/** How many there are of each verdict; a click filters by it, or no longer. */
function Verdicts({ table, asked, hint }: Inputs): JSX.Element {
  const counts: Record<string, number> = {};
  for (let index = 0; index < table.size; index++) {
    const verdict = table.verdict(index);
    counts[verdict] = (counts[verdict] ?? 0) + 1;
  }
  const toggle = (rule: string): void => {
    const words = asked.split(/\s+/).filter(Boolean);
    const rest = words.filter((word) => !word.startsWith("verdict="));
    requery({ filter: (words.includes(rule) ? rest : [...rest, rule]).join(" ") });
  };
  return (
    <>
    <span class="line verdicts" role="group" aria-label="Verdicts">
      {byRank(counts).map(([name, n]) => (
        <button key={name} type="button" aria-pressed={asked.split(/\s+/).includes(`verdict=${name}`)} onClick={() => toggle(`verdict=${name}`)}>
          <Chip verdict={name} count={n} />
        </button>
      ))}
    </span>
    {hint && <span class="dim hint">Click a case to see why it ended so.</span>}
    </>
  );
}
