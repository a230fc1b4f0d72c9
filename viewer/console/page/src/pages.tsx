// Rulebook, search and comparison, from the files that the report is made of.
import type { ComponentChildren, JSX } from "preact";
import type { Value } from "./data";
import { useData } from "./hooks";
import { Figure, Icon, Waiting, wordsOf } from "./parts";
import { Plot } from "./plots";
import { toBeside, toCase, toRun } from "./route";
import { count, number, plain, text } from "./words";

/** Most rows that are drawn of a table. */
const ROWS_MAX = 500;

function Grid({ title, columns, rows }: { title: string; columns: string[]; rows: ComponentChildren[][] }): JSX.Element {
  return (
    <Figure title={title}>
      <div class="scroll" tabIndex={0} role="region" aria-label={title}>
        <table>
          <thead>
            <tr>
              {columns.map((column) => (
                <th key={column} scope="col">
                  {column}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {rows.slice(0, ROWS_MAX).map((row, place) => (
              <tr key={place}>
                {row.map((cell, at) => (
                  <td key={at}>{cell}</td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {rows.length > ROWS_MAX && <p class="dim">The first {ROWS_MAX} are shown.</p>}
    </Figure>
  );
}

interface Count {
  runs: number;
  passed: number;
  failed: number;
  inconclusive: number;
  missing: number;
}
interface RulebookRun {
  case: string;
  status: string;
  impact_kmh: number | null;
}
interface Rulebook {
  title: string;
  source: string;
  remark: string;
  standing: string;
  count: Count;
  groups: { group: string; title: string; clause: string; failures_max: number; count: Count; standing: string }[];
  rows: {
    row: string;
    test: string;
    clause: string;
    standing: string;
    points: { values: Record<string, Value>; limit_kmh: number | null; standing: string; runs: RulebookRun[] }[];
  }[];
}

const counted = (found: Count): string =>
  `${found.passed} passed, ${found.failed} failed, ${found.inconclusive} inconclusive, ${found.missing} missing`;

export function RulebookView({ run }: { run: string }): JSX.Element {
  const { data, error } = useData<Rulebook>(`runs/${run}/rulebook.json`);
  if (data === null) return <Waiting error={error} what={`the rulebook of ${run}`} />;
  return (
    <>
      <p class="kicker">
        <a href={toRun(run)}>{run}</a>
      </p>
      <h1>
        {data.title} <span class="state">{data.standing}</span>
      </h1>
      <p>
        Of {count(data.count.runs, "run")}: {counted(data.count)}. {data.remark}
      </p>
      <p class="dim">{data.source}</p>
      {data.groups.length > 0 && (
        <Grid
          title="Groups" columns={["group", "clause", "may fail", "runs", "standing"]}
          rows={data.groups.map((one) => [one.title || one.group || "no group", one.clause, `${number(100 * one.failures_max)} %`, counted(one.count), one.standing])}
        />
      )}
      {data.rows.map((row) => (
        <Grid
          key={row.row} title={`${row.row}: ${row.test} (${row.clause}), ${row.standing}`}
          columns={["values", "limit [km/h]", "standing", "runs"]}
          rows={row.points.map((point) => [
            Object.entries(point.values).map(([name, value]) => `${plain(name)} ${text(value)}`).join(", "),
            text(point.limit_kmh),
            point.standing,
            point.runs.map((one) => (
              <span key={one.case} class="runlink">
                <Icon verdict={one.status} />{" "}
                <a href={toCase(run, one.case)} aria-label={`${one.case}: ${plain(one.status)}`}>
                  {one.impact_kmh === null ? plain(one.status) : `${number(one.impact_kmh)} km/h`}
                </a>{" "}
              </span>
            )),
          ])}
        />
      ))}
    </>
  );
}

interface Index {
  parameter: string;
  first: number;
  total: number | null;
}
interface Search {
  title: string;
  kpi: string;
  ended: string;
  parameters: string[];
  fails_below: number | null;
  fails_above: number | null;
  answer: { method: string; cases: number; failures: number; probability: number | null; low: number | null; high: number | null; best: number | null; best_case: string } | null;
  clusters: { mildest: string; kpi: number; values: Value[]; cases: string[] }[];
  indices: { method: string; kpi: Index[]; failure: Index[] } | null;
  generations: { cases: string[]; values: Value[][]; results: (number | null)[] }[];
}

export function SearchView({ run }: { run: string }): JSX.Element {
  const { data, error } = useData<Search>(`runs/${run}/search.json`);
  if (data === null) return <Waiting error={error} what={`the search of ${run}`} />;
  const { answer } = data;
  return (
    <>
      <p class="kicker">
        <a href={toRun(run)}>{run}</a>
      </p>
      <h1>{data.title}</h1>
      <p>{data.ended ? `It ended: ${data.ended}.` : "It runs."}</p>
      {answer !== null && (
        <p>
          {answer.probability !== null && `Probability of failure ${text(answer.probability)}`}
          {answer.low !== null && answer.high !== null && ` (95 % interval ${text(answer.low)} to ${text(answer.high)}); `}
          {answer.failures} of {answer.cases} proposed cases failed.{" "}
          {answer.best !== null && answer.best_case && (
            <>
              The worst, {text(answer.best)}, is <a href={toCase(run, answer.best_case)}>{answer.best_case}</a>.
            </>
          )}
        </p>
      )}
      <Results run={run} data={data} />
      {data.clusters.length > 0 && (
        <Grid
          title="Failures that lie beside each other" columns={["mildest case", plain(data.kpi), "cases", ...data.parameters.map(plain)]}
          rows={data.clusters.map((one) => [<a href={toCase(run, one.mildest)}>{one.mildest}</a>, text(one.kpi), number(one.cases.length), ...one.values.map((value) => text(value))])}
        />
      )}
      {data.indices !== null && data.indices.kpi.length > 0 && (
        <Grid
          title="Which parameters matter" columns={["parameter", "share alone", "share in all"]}
          rows={data.indices.kpi.map((one) => [plain(one.parameter), number(one.first), text(one.total)])}
        />
      )}
    </>
  );
}

/** The KPI of every case in the order of proposals, and the worst of them as rows. */
function Results({ run, data }: { run: string; data: Search }): JSX.Element {
  const closed = data.generations.flatMap(({ cases, results }) => cases.map((name, at) => ({ name, kpi: results[at] ?? null })));
  const limit = data.fails_below ?? data.fails_above;
  const sign = data.fails_above !== null ? -1 : 1;
  const worst = closed.filter((one) => one.kpi !== null).sort((a, b) => sign * (a.kpi! - b.kpi!)).slice(0, 20);
  const figure = {
    data: [{ x: closed.map((_, at) => at + 1), y: closed.map((one) => one.kpi), mode: "markers", marker: { size: 5 }, name: plain(data.kpi) }],
    layout: {
      margin: { l: 56, r: 8, t: 8, b: 40 },
      xaxis: { title: { text: "case, in the order of proposals" } },
      yaxis: { title: { text: plain(data.kpi) } },
      shapes: limit === null ? [] : [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: limit, y1: limit, line: { color: "#D55E00", dash: "dash" } }],
    },
  };
  return (
    <>
      <Figure title="Cases as they were proposed">
        <Plot data={figure.data} layout={figure.layout} label={`${plain(data.kpi)} of ${count(closed.length, "case")}`} height={300} />
      </Figure>
      <Grid title="The worst cases" columns={["case", plain(data.kpi)]} rows={worst.map((one) => [<a href={toCase(run, one.name)}>{one.name}</a>, text(one.kpi)])} />
    </>
  );
}

interface Comparison {
  result: string;
  says: string[];
  flips: { case: string; before: string; after: string; change: string; reasons: string[] }[];
  only_before: string[];
  only_after: string[];
  notes: string[];
  shifts: { name: string; label: string; pairs: number; changed: number; median: { estimate: number }; largest: number | null; largest_case: string }[];
}

export function ComparePage({ left, right }: { left: string; right: string }): JSX.Element {
  const { data, error } = useData<Comparison>(`compare/${left}/${right}.json`);
  if (data === null) return <Waiting error={error} what={`the comparison of ${left} with ${right}`} />;
  const link = (name: string): JSX.Element => <a href={toBeside(left, name, right, name)}>{name}</a>;
  return (
    <>
      <h1>
        <a href={toRun(left)}>{left}</a> and <a href={toRun(right)}>{right}</a> <span class="state">{plain(data.result)}</span>
      </h1>
      {[...data.says, ...data.notes].map((words, place) => (
        <p key={place}>{words}</p>
      ))}
      {data.flips.length > 0 ? (
        <Grid
          title="Cases that changed" columns={["case", "change", "before", "after", "why"]}
          rows={data.flips.map((one) => [
            link(one.case),
            one.change,
            <><Icon verdict={one.before} /> {wordsOf(one.before)}</>,
            <><Icon verdict={one.after} /> {wordsOf(one.after)}</>,
            one.reasons.join("; "),
          ])}
        />
      ) : (
        <p>Every case that is in both has the same verdict.</p>
      )}
      {data.shifts.some((one) => one.changed) && (
        <Grid
          title="KPIs that moved" columns={["KPI", "changed", "median shift", "largest", "in"]}
          rows={data.shifts.filter((one) => one.changed).map((one) => [
            one.label,
            `${one.changed} of ${one.pairs}`,
            text(one.median.estimate),
            text(one.largest),
            one.largest_case ? link(one.largest_case) : "",
          ])}
        />
      )}
      {[...data.only_before, ...data.only_after].length > 0 && (
        <p>
          Only in {left}: {data.only_before.join(", ") || "none"}. Only in {right}: {data.only_after.join(", ") || "none"}.
        </p>
      )}
    </>
  );
}
