// All campaigns, and the first page of one.
import type { JSX } from "preact";
import { useMemo } from "preact/hooks";
import { actsOnRun, Acts, mayAct } from "./acts";
import type { RunSummary, Runs } from "./data";
import { byRank, Chip, Command, Figure, Icon, kinds, Shares, Waiting, wordsOf } from "./parts";
import { address, toCase, toRun, toWall } from "./route";
import { ordered, WORST } from "./table";
import { useTable } from "./tables";
import { count, hour, number, plain, span, text } from "./words";

function Facts({ run }: { run: RunSummary }): JSX.Element {
  const facts: [string, string][] = [];
  const add = (name: string, value: number | null, shown: (value: number) => string): void => {
    if (value !== null && value !== undefined) facts.push([name, shown(value)]);
  };
  add("time so far", run.elapsed_s, span);
  if (run.state !== "finished") add("expected end", run.eta_s, (s) => `in ${span(s)}, at ${hour(s)}`);
  add("cases per minute", run.per_minute, number);
  add("workers", run.workers, number);
  add("GPUs", run.gpus, number);
  add("cost so far", run.device_hours, (hours) => `${number(hours)} device hours`);
  return (
    <dl class="facts">
      {facts.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

function Progress({ run }: { run: RunSummary }): JSX.Element {
  return (
    <>
      <p>
        <strong>{run.done}</strong> of {count(run.cases, "case")} ended
        {run.paused ? "; paused" : ""}
      </p>
      <Shares verdicts={run.verdicts} total={run.cases} />
      <ul class="legend">
        {byRank(run.verdicts).map(([name, n]) => (
          <li key={name}>
            <a href={toWall(run.id, [["filter", `verdict=${name}`]])}>
              <Chip verdict={name} count={n} />
            </a>
          </li>
        ))}
      </ul>
    </>
  );
}

export function RunsView({ runs }: { runs: Runs }): JSX.Element {
  const states = ["running", "paused", "waiting", "finished"];
  const place = (state: string): number => (states.indexOf(state) + states.length + 1) % (states.length + 1);
  const sorted = [...runs.runs].sort((a, b) => place(a.state) - place(b.state));
  return (
    <>
      <h1>Campaigns</h1>
      {sorted.length === 0 && <p class="dim">No campaign yet. It appears here when one is submitted.</p>}
      <ul class="cards">
        {sorted.map((run) => (
          <li key={run.id} class="panel">
            <h2>
              <a href={toRun(run.id)}>{run.name === run.id || !run.name ? run.id : `${run.name} (${run.id})`}</a> <span class={`state ${run.state}`}>{run.state}</span>
            </h2>
            <Progress run={run} />
            <Facts run={run} />
            <p class="line">
              <a class="button main" href={toWall(run.id)}>
                Open the wall
              </a>
              <a class="button" href={toRun(run.id)}>
                Summary
              </a>
            </p>
          </li>
        ))}
      </ul>
      {sorted.length > 1 && <Others runs={sorted} />}
    </>
  );
}

function Others({ runs }: { runs: RunSummary[] }): JSX.Element {
  const compare = (event: Event): void => {
    event.preventDefault();
    const form = new FormData(event.target as HTMLFormElement);
    location.hash = address(["compare", String(form.get("left")), String(form.get("right"))]);
  };
  const choice = (name: string, label: string, chosen: number): JSX.Element => (
    <label>
      {label}{" "}
      <select name={name} defaultValue={runs[chosen]?.id ?? ""}>
        {runs.map((run) => (
          <option key={run.id} value={run.id}>
            {run.id}
          </option>
        ))}
      </select>
    </label>
  );
  return (
    <form class="controls panel" onSubmit={compare}>
      {choice("left", "Compare", 1)}
      {choice("right", "with", 0)}
      <button type="submit">Compare</button>
    </form>
  );
}

const LINKS: Record<string, string> = { report: "Report", search: "Search", rulebook: "Rulebook" };

export function RunView({ run, runs }: { run: string; runs: Runs }): JSX.Element {
  const { info, table, version, error } = useTable(run);
  const worst = useMemo(
    () => (table === null ? [] : ordered(table, (index) => failed(table.verdict(index)), WORST).slice(0, 8)),
    [table, version],
  );
  if (info === null || table === null) return <Waiting error={error} what={`campaign ${run}`} />;
  const summary = { ...info, ...runs.runs.find((one) => one.id === run) };
  const worstOne = worst[0];
  return (
    <>
      <h1>
        {info.name || run} <span class={`state ${summary.state}`}>{summary.state}</span>
      </h1>
      {mayAct(runs.roles) && summary.state !== "finished" && (
        <Acts label="Campaign" acts={actsOnRun(run, summary.paused ?? false)} />
      )}
      <div class="panel">
        <Progress run={summary} />
        <Facts run={summary} />
        <p class="line">
          <a class="button main" href={toWall(run)}>
            Open the wall
          </a>
          {worstOne !== undefined && (
            <a class="button" href={toCase(run, table.cases[worstOne]!)}>
              Open the worst case
            </a>
          )}
        </p>
      </div>
      <Figure title="The worst cases">
        {worst.length === 0 ? (
          <p class="dim">No case has failed.</p>
        ) : (
          <ol class="worst">
            {worst.map((index) => (
              <li key={index}>
                <Icon verdict={table.verdict(index)} /> <a href={toCase(run, table.cases[index]!)}>{table.cases[index]}</a>
                <br />
                <span class="dim">
                  {wordsOf(table.verdict(index))}: {text(table.value("reason", index))}
                </span>
              </li>
            ))}
          </ol>
        )}
      </Figure>
      <Figure title="More">
        <ul class="plain">
          {Object.entries(info.links ?? {}).map(([name, link]) => link !== null && Own({ run, name, link }))}
          <li>
            <a href={address(["run", run, "workers"])}>Workers, leases, resources</a>
          </li>
          {groupsOf(info.axes.filter((axis) => axis.values.length > 1).map((axis) => axis.name)).map(([a, b]) => (
            <li key={`${a},${b}`}>
              <a href={toWall(run, [["group", `${a},${b}`]])}>
                The wall as a heat map: {plain(a)} across, {plain(b)} down
              </a>
            </li>
          ))}
        </ul>
        {info.fingerprint && <Command text={info.fingerprint} label="Fingerprint of the results" />}
      </Figure>
    </>
  );
}

function Own({ run, name, link }: { run: string; name: string; link: string }): JSX.Element {
  const own = name === "search" || name === "rulebook";
  return (
    <li key={name}>
      <a href={own ? address(["run", run, name]) : safe(link)}>{LINKS[name] ?? plain(name)}</a>
    </li>
  );
}

/** An address of this site; anything else leads nowhere. */
export function safe(link: string): string {
  const url = new URL(link, location.href);
  return url.protocol === location.protocol && url.host === location.host ? url.href : "#/";
}

const groupsOf = (axes: string[]): [string, string][] =>
  axes.slice(0, 3).flatMap((a, at) => axes.slice(at + 1, 3).map((b): [string, string] => [a, b]));

const UNENDED = ["running", "waiting"];
/** Whether a verdict is one that somebody wants to look into. */
const failed = (verdict: string): boolean => !UNENDED.includes(verdict) && !kinds.get(verdict)?.passes;
