// All campaigns, and the first page of one.
import type { JSX } from "preact";
import { useMemo, useState } from "preact/hooks";
import { actsOnRun, Acts, mayAct } from "./acts";
import { AwayFiles } from "./away";
import type { Atlas, RunInfo, RunSummary, Runs } from "./data";
import { Picture } from "./details";
import { useData } from "./hooks";
import { byRank, Chip, Command, Figure, kinds, Shares, VerdictSign, Waiting, wordsOf } from "./parts";
import { address, toCase, toRun, toWall } from "./route";
import { Running } from "./running";
import { ordered, type Table, WORST } from "./table";
import { useTable } from "./tables";
import { count, hour, number, span, text } from "./words";

/** Cases below the worst one that are shown with a picture. */
const NEXT_MAX = 8;
/** Axes with more values make no heat map that anybody reads. */
const HEAT_VALUES_MAX = 12;

function Facts({ run }: { run: RunSummary }): JSX.Element {
  const over = run.state === "finished";
  const facts: [string, string][] = [];
  const add = (name: string, value: number | null, shown: (value: number) => string): void => {
    if (value !== null && value !== undefined) facts.push([name, shown(value)]);
  };
  add(over ? "took" : "time so far", run.elapsed_s, span);
  if (!over) add("expected end", run.eta_s, (s) => `in ${span(s)}, at ${hour(s)}`);
  add("cases per minute", run.per_minute, number);
  add("workers", run.workers, number);
  if (run.gpus) add("GPUs", run.gpus, number);
  add(over ? "cost" : "cost so far", run.device_hours, (hours) =>
    hours < 1 ? `${span(hours * 3600)} on devices` : `${number(hours)} device hours`,
  );
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
        {run.state !== "finished" && typeof run.running === "number" && `, ${run.running || "none"} running`}
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

const nameOf = (run: RunSummary): string => (run.name === run.id || !run.name ? run.id : `${run.name} (${run.id})`);

export function RunsView({ runs }: { runs: Runs }): JSX.Element {
  const states = ["running", "paused", "waiting", "finished"];
  const place = (state: string): number => (states.indexOf(state) + states.length + 1) % (states.length + 1);
  const sorted = [...runs.runs].sort((a, b) => place(a.state) - place(b.state));
  const readable = sorted.filter((run) => !run.error);
  return (
    <>
      <h1>Campaigns</h1>
      {sorted.length === 0 && <p class="dim">No campaign yet. It appears here when one is submitted.</p>}
      <ul class="cards">
        {sorted.map((run) => (
          <li key={run.id} class="panel">
            {run.error ? <Damaged run={run} /> : <Card run={run} />}
          </li>
        ))}
      </ul>
      {readable.length > 1 && <Others runs={readable} />}
    </>
  );
}

function Card({ run }: { run: RunSummary }): JSX.Element {
  return (
    <>
      <h2>
        <a href={toRun(run.id)}>{nameOf(run)}</a> <span class={`state ${run.state}`}>{run.state}</span>
      </h2>
      <Progress run={run} />
      <Facts run={run} />
      <p class="line">
        <a class="button main" href={toRun(run.id)}>
          Summary<span class="away"> of {nameOf(run)}</span>
        </a>
        <a class="button" href={toWall(run.id)}>
          Open the wall<span class="away"> of {nameOf(run)}</span>
        </a>
      </p>
    </>
  );
}

/** A campaign that cannot be read: why, and nothing to open. */
function Damaged({ run }: { run: RunSummary }): JSX.Element {
  return (
    <>
      <h2>
        {run.id} <span class="state damaged">damaged</span>
      </h2>
      <p class="box alarm">{run.error}</p>
      <p class="dim">It cannot be shown until that is mended. Nothing else here depends on it.</p>
    </>
  );
}

function Others({ runs }: { runs: RunSummary[] }): JSX.Element {
  const [chosen, setChosen] = useState<[string, string]>(["", ""]);
  const known = (id: string): boolean => runs.some((run) => run.id === id);
  const left = known(chosen[0]) ? chosen[0] : runs[0]!.id;
  const right = known(chosen[1]) ? chosen[1] : runs[1]!.id;
  const compare = (event: Event): void => {
    event.preventDefault();
    location.hash = address(["compare", left, right]);
  };
  const choice = (label: string, value: string, choose: (id: string) => void): JSX.Element => (
    <label>
      {label}{" "}
      <select value={value} onChange={(event) => choose((event.target as HTMLSelectElement).value)}>
        {runs.map((run) => (
          <option key={run.id} value={run.id}>
            {run.id}
          </option>
        ))}
      </select>
    </label>
  );
  return (
    <form class="controls panel" aria-label="Compare two runs of one campaign" onSubmit={compare}>
      {choice("Compare", left, (id) => setChosen([id, right]))}
      {choice("with", right, (id) => setChosen([left, id]))}
      <button type="submit" disabled={left === right}>Compare</button>
      <span class="dim">Two runs of the same cases, as of two versions of a stack.</span>
    </form>
  );
}

export function RunView({ run, runs }: { run: string; runs: Runs }): JSX.Element {
  const listed = runs.runs.find((one) => one.id === run);
  const { info, table, version, error } = useTable(listed?.error ? "" : run);
  // Which cases have a picture is asked anew with every twentieth of the campaign: it is a question to the disk.
  const share = listed && listed.cases ? Math.floor((20 * listed.done) / listed.cases) : 0;
  const atlas = useData<Atlas>(info === null ? null : `runs/${run}/pictures/atlas.json`, share);
  const worst = useMemo(() => (table === null ? [] : worstOf(table)), [table, version]);
  if (listed?.error) {
    return (
      <div class="panel">
        <Damaged run={listed} />
      </div>
    );
  }
  if (info === null || table === null) return <Waiting error={error} what={`campaign ${run}`} />;
  const summary = { ...info, ...listed };
  const has = (index: number): boolean => atlas.data?.has[index] ?? false;
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
          <a class="button" href={toWall(run)}>
            Open the wall:{" "}
            {summary.cases === 1
              ? "its case as a picture"
              : `all ${count(summary.cases, "case")} as pictures, worst first`}
          </a>
        </p>
      </div>
      <Running run={run} table={table} has={has} />
      <Worst run={run} table={table} worst={worst} has={has} over={summary.state === "finished"} />
      <More run={run} info={info} />
      {info.away && <AwayFiles away={info.away} what="Report, search, rulebook, fingerprint, films and recordings" />}
    </>
  );
}

/** Cases that somebody wants to look into: those that did not pass, else those that came closest to it; worst first. */
function worstOf(table: Table): number[] {
  const bad = ordered(table, (index) => failed(table.verdict(index)), WORST);
  if (bad.length > 0) return bad.slice(0, NEXT_MAX + 1);
  return ordered(table, (index) => !UNENDED.includes(table.verdict(index)), WORST).slice(0, 4);
}

function Worst({ run, table, worst, has, over }: {
  run: string; table: Table; worst: number[]; has: (index: number) => boolean; over: boolean;
}): JSX.Element {
  const [first, ...rest] = worst;
  if (first === undefined) {
    return (
      <Figure title="The worst case">
        <p class="dim">No case has ended yet.</p>
      </Figure>
    );
  }
  const bad = failed(table.verdict(first));
  const title = bad ? "The worst case" : over ? "No case failed; this one came closest" : "No case has failed so far; this one came closest";
  const name = table.cases[first]!;
  return (
    <>
      <Figure title={title}>
        <div class="hero">
          {has(first) && (
            <a href={toCase(run, name)} tabIndex={-1} aria-hidden="true">
              <Picture run={run} name={name} version={undefined} />
            </a>
          )}
          <div>
            <p class="verdict">
              <Chip verdict={table.verdict(first)} />
            </p>
            <p class="reason">{text(table.value("reason", first) ?? "No reason was given.")}</p>
            <p class="dim">{name}</p>
            <p class="line">
              <a class="button main" href={toCase(run, name)}>
                {bad ? "See why, and repeat it" : "Look at it"}
              </a>
            </p>
          </div>
        </div>
      </Figure>
      {rest.length > 0 && (
        <Figure title={bad ? "The next worst" : "The next"}>
          <ol class="worst" start={2}>
            {rest.map((index) => (
              <li key={index}>
                {has(index) && <Picture run={run} name={table.cases[index]!} version={undefined} />}
                <div>
                  <VerdictSign verdict={table.verdict(index)} /> <a href={toCase(run, table.cases[index]!)}>{table.cases[index]}</a>
                  <br />
                  <span class="dim">{text(table.value("reason", index) ?? wordsOf(table.verdict(index)))}</span>
                </div>
              </li>
            ))}
          </ol>
        </Figure>
      )}
    </>
  );
}

function More({ run, info }: { run: string; info: RunInfo }): JSX.Element {
  const axes = info.axes.filter((axis) => axis.values.length > 1 && axis.values.length <= HEAT_VALUES_MAX);
  const { report, search, rulebook } = info.links ?? {};
  return (
    <Figure title="More">
      <ul class="plain">
        {report && (
          <li>
            <a href={address(["run", run, "report"])}>Report: tables, plots and what they mean</a>
          </li>
        )}
        {search && (
          <li>
            <a href={address(["run", run, "search"])}>Search: which values lead to failures</a>
          </li>
        )}
        {rulebook && (
          <li>
            <a href={address(["run", run, "rulebook"])}>Rulebook: what was asked, and what was met</a>
          </li>
        )}
        <li>
          <a href={address(["run", run, "workers"])}>Workers, leases, resources</a>
        </li>
        {pairsOf(axes).map(([across, down]) => (
          <li key={`${across.name},${down.name}`}>
            <a href={toWall(run, [["group", `${across.name},${down.name}`]])}>
              Heat map: {across.title || across.name} across, {down.title || down.name} down
            </a>
          </li>
        ))}
      </ul>
      {info.fingerprint && (
        <>
          <h3>Fingerprint of the results</h3>
          <p class="dim">Runs with the same results have the same one.</p>
          <Command text={info.fingerprint} label="Fingerprint of the results" plain />
        </>
      )}
    </Figure>
  );
}

/** An address of this site; anything else leads nowhere. */
export function safe(link: string): string {
  const url = new URL(link, location.href);
  return url.protocol === location.protocol && url.host === location.host ? url.href : "#/";
}

const pairsOf = <T,>(axes: T[]): [T, T][] =>
  axes.slice(0, 3).flatMap((a, at) => axes.slice(at + 1, 3).map((b): [T, T] => [a, b]));

const UNENDED = ["running", "waiting"];
/** Whether a verdict is one that somebody wants to look into. */
const failed = (verdict: string): boolean => !UNENDED.includes(verdict) && !kinds.get(verdict)?.passes;
