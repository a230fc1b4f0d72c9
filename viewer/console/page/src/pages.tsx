// Rulebook, search and comparison, from the files that the report is made of.
import type { ComponentChildren, JSX } from "preact";
import { useMemo } from "preact/hooks";
import type { RunInfo, Value } from "./data";
import { useData, useSignal } from "./hooks";
import { Figure, Icon, Waiting, wordsOf } from "./parts";
import { Plot } from "./plots";
import { toBeside, toCase, toRun } from "./route";
import { axisTitle } from "./table";
import { useTable } from "./tables";
import { color, colors } from "./theme";
import { called, capital, count, number, plain, text } from "./words";

/** Most rows that are drawn of a table. */
const ROWS_MAX = 500;

function Grid({ title, columns, rows, label = String(title) }: {
  title: ComponentChildren; columns: string[]; rows: ComponentChildren[][]; label?: string;
}): JSX.Element {
  return (
    <Figure title={title}>
      <div class="scroll" tabIndex={0} role="region" aria-label={label}>
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
  passed: boolean;
  impact_kmh: number | null;
  reasons: string[];
}
interface RulebookPoint {
  values: Record<string, Value>;
  limit_kmh: number | null;
  standing: string;
  runs: RulebookRun[];
}
interface Rulebook {
  title: string;
  source: string;
  note: string;
  remark: string;
  partial: boolean;
  standing: string;
  count: Count;
  groups: { group: string; title: string; clause: string; failures_max: number; count: Count; standing: string }[];
  rows: { row: string; test: string; clause: string; standing: string; points: RulebookPoint[] }[];
}

const counted = (found: Count): string =>
  [`${found.passed} passed`, `${found.failed} failed`, found.inconclusive ? `${found.inconclusive} inconclusive` : "", found.missing ? `${found.missing} not run` : ""]
    .filter(Boolean)
    .join(", ");

const STANDINGS: Record<string, string> = { passed: "pass", failed: "fail", open: "inconclusive" };

/** How something stands, with the sign of the verdict that it amounts to. */
function Standing({ of }: { of: string }): JSX.Element {
  const verdict = STANDINGS[of];
  return (
    <span class="chip">
      {verdict && <Icon verdict={verdict} />}
      {plain(of)}
    </span>
  );
}

const limitOf = (limit: number | null): string => (limit === null ? "–" : limit === 0 ? "no contact" : `${number(limit)} km/h`);

const valuesOf = (values: Record<string, Value>): string =>
  Object.entries(values).map(([name, value]) => `${called(name).title} ${text(value, called(name).unit)}`).join(", ");

export function RulebookView({ run }: { run: string }): JSX.Element {
  const { data, error } = useData<Rulebook>(`runs/${run}/rulebook.json`);
  if (data === null) return <Waiting error={error} what={`the rulebook of ${run}`} />;
  return (
    <>
      <p class="kicker">
        <a href={toRun(run)}>{run}</a>
      </p>
      <h1>{data.title}</h1>
      <p class="verdict">
        <Standing of={data.standing} /> {data.partial && <span class="dim">not all of its tests were run</span>}
      </p>
      <p>
        Of {count(data.count.runs, "run")}: {counted(data.count)}. {data.remark}
      </p>
      <p class="dim">
        {data.source}. {data.note}
      </p>
      {data.groups.length > 0 && (
        <Grid
          title="Groups of tests" columns={["group", "clause", "share that may fail", "runs", "result"]}
          rows={data.groups.map((one) => [one.title || one.group || "no group", one.clause || "–", `${number(100 * one.failures_max)} %`, counted(one.count), <Standing of={one.standing} />])}
        />
      )}
      {data.rows.map((row) => (
        <Grid
          key={row.row} label={`${row.test}, ${row.row}`}
          title={
            <>
              {row.test} <span class="dim">{row.clause && `(${row.clause}) `}<code>{row.row}</code></span> <Standing of={row.standing} />
            </>
          }
          columns={["at", "allowed impact", "result", "runs"]}
          rows={row.points.map((point) => [valuesOf(point.values), limitOf(point.limit_kmh), <Standing of={point.standing} />, <RulebookRuns run={run} runs={point.runs} />])}
        />
      ))}
    </>
  );
}

function RulebookRuns({ run, runs }: { run: string; runs: RulebookRun[] }): JSX.Element {
  return (
    <ul class="bare">
      {runs.map((one) => (
        <li key={one.case}>
          <Icon verdict={one.status} />{" "}
          <a href={toCase(run, one.case)}>
            <span class="away">{one.case}: {one.impact_kmh === null ? "" : wordsOf(one.status)} </span>
            {one.impact_kmh === null ? wordsOf(one.status) : `${number(one.impact_kmh)} km/h`}
          </a>
          {!one.passed && one.reasons[0] && <span class="dim"> {one.reasons[0]}</span>}
        </li>
      ))}
    </ul>
  );
}

interface Index {
  parameter: string;
  first: number;
  first_low: number;
  first_high: number;
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
  coverage?: { parameters: { parameter: string; cells: string[]; cases: number[] }[] } | null;
  generations: { cases: string[]; values: Value[][]; results: (number | null)[] }[];
}

export function SearchView({ run }: { run: string }): JSX.Element {
  const { data, error } = useData<Search>(`runs/${run}/search.json`);
  const info = useData<RunInfo>(`runs/${run}/run.json`);
  if (data === null) return <Waiting error={error} what={`the search of ${run}`} />;
  const { answer } = data;
  const kpi = axisTitle(info.data, data.kpi);
  const names = data.parameters.map((name) => axisTitle(info.data, name));
  const limit = data.fails_below ?? data.fails_above;
  return (
    <>
      <p class="kicker">
        <a href={toRun(run)}>{run}</a>
      </p>
      <h1>{data.title}</h1>
      <p>
        It looks for cases with {data.fails_above !== null ? "a large" : "a small"} {kpi}
        {limit !== null && `; a case fails ${data.fails_above !== null ? "above" : "below"} ${text(limit)}`}. {data.ended ? `It ended: ${data.ended}.` : "It still runs."}
      </p>
      {answer !== null && (
        <p>
          {answer.probability !== null && `Probability of failure: ${text(answer.probability)}`}
          {answer.probability !== null && answer.low !== null && answer.high !== null && ` (95 % interval ${text(answer.low)} to ${text(answer.high)})`}
          {answer.probability !== null && ". "}
          <strong>
            {answer.failures} of {count(answer.cases, "proposed case")} failed.
          </strong>{" "}
          {answer.best !== null && answer.best_case && (
            <>
              The worst, {text(answer.best)}, is <a href={toCase(run, answer.best_case)}>{answer.best_case}</a>.
            </>
          )}{" "}
          <span class="dim">{answer.method}.</span>
        </p>
      )}
      <Results run={run} data={data} kpi={kpi} names={names} />
      {data.clusters.length > 0 && (
        <Grid
          title="Failures that lie beside each other" columns={["mildest case", kpi, "cases", ...names]}
          rows={data.clusters.map((one) => [<a href={toCase(run, one.mildest)}>{one.mildest}</a>, text(one.kpi), number(one.cases.length), ...one.values.map((value) => text(value))])}
        />
      )}
      {data.indices !== null && data.indices.kpi.length > 0 && (
        <Grid
          title="Which parameters matter" columns={["parameter", "share alone (95 % interval)", "share with others"]}
          rows={data.indices.kpi.map((one) => [axisTitle(info.data, one.parameter), `${number(one.first)} (${number(one.first_low)} to ${number(one.first_high)})`, text(one.total)])}
        />
      )}
      {data.coverage && (
        <Grid
          title="How much was tried" columns={["parameter", "parts with a case", "cases in each part of its range"]}
          rows={data.coverage.parameters.map((one) => [
            axisTitle(info.data, one.parameter),
            `${one.cases.filter((n) => n > 0).length} of ${one.cases.length}`,
            one.cells.map((cell, at) => `${cell}: ${one.cases[at]}`).join("; "),
          ])}
        />
      )}
    </>
  );
}

/** Most parameters over which the KPI is drawn. */
const PARAMETERS_MAX = 12;

/** The KPI of every case in the order of proposals and over each parameter, and the worst as rows. */
function Results({ run, data, kpi, names }: { run: string; data: Search; kpi: string; names: string[] }): JSX.Element {
  const closed = useMemo(
    () => data.generations.flatMap(({ cases, values, results }) => cases.map((name, at) => ({ name, values: values[at] ?? [], kpi: results[at] ?? null }))),
    [data],
  );
  const theme = useSignal(colors, "change");
  const limit = data.fails_below ?? data.fails_above;
  const sign = data.fails_above !== null ? -1 : 1;
  const { table } = useTable(run);
  const impact = (name: string): number => Number(table?.value("impact_speed_mps", table.index(name)) ?? 0);
  // Every collision has the same distance: of equal values the fastest impact is the worst.
  const worst = closed.filter((one) => one.kpi !== null).sort((a, b) => sign * (a.kpi! - b.kpi!) || impact(b.name) - impact(a.name)).slice(0, 20);
  const { order, over } = useMemo(() => {
    const fails = closed.map((one) => one.kpi !== null && limit !== null && sign * (one.kpi - limit) < 0);
    const marker = { size: 7, color: fails.map((failed) => color(failed ? "alarm" : "plot")), symbol: fails.map((failed) => (failed ? "x" : "circle")) };
    const scatter = (x: Value[], title: string): { data: unknown[]; layout: Record<string, unknown> } => ({
      data: [{
        x, y: closed.map((one) => one.kpi), text: closed.map((one) => one.name), mode: "markers", marker, cliponaxis: false,
        hovertemplate: "%{text}: %{y:.4g}<extra></extra>",
      }],
      layout: {
        margin: { l: 56, r: 8, t: 8, b: 44 },
        xaxis: { title: { text: title.replaceAll("<", ""), standoff: 4 }, zeroline: false },
        yaxis: { title: { text: kpi.replaceAll("<", "") }, rangemode: "tozero" },
        shapes: limit === null ? [] : [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: limit, y1: limit, line: { color: color("plot2"), dash: "dash" } }],
      },
    });
    return {
      order: scatter(closed.map((_, at) => at), "case, in the order in which they were proposed"),
      over: names.slice(0, PARAMETERS_MAX).map((name, at) => scatter(closed.map((one) => one.values[at] ?? null), name)),
    };
  }, [closed, kpi, names.join(), theme]);
  return (
    <>
      <Figure title="Cases as they were proposed">
        {limit !== null && <p class="dim">A case {data.fails_above !== null ? "above" : "below"} the dashed line fails, and is a red cross.</p>}
        <Plot data={order.data} layout={order.layout} label={`${kpi} of ${count(closed.length, "case")}`} height={300} />
      </Figure>
      <Figure title="Over each parameter">
        <div class="plots">
          {over.map(({ data: points, layout }, at) => (
            <Plot key={names[at]} data={points} layout={layout} label={`${kpi} over ${names[at]}`} height={240} />
          ))}
        </div>
      </Figure>
      <Grid
        title="The worst cases" columns={["case", kpi, ...names]}
        rows={worst.map((one) => [<a href={toCase(run, one.name)}>{one.name}</a>, text(one.kpi), ...one.values.map((value) => text(value))])}
      />
    </>
  );
}

interface Comparison {
  result: string;
  says: string[];
  flips: { case: string; before: string; after: string; change: string; reasons: string[] }[];
  notes: string[];
  shifts: { name: string; label: string; pairs: number; changed: number; median: { estimate: number }; largest: number | null; largest_case: string }[];
}

export function ComparePage({ left, right }: { left: string; right: string }): JSX.Element {
  const { data, error } = useData<Comparison>(`compare/${left}/${right}.json`);
  if (data === null) {
    return (
      <>
        <h1>
          {left} <span aria-hidden="true">→</span><span class="away"> compared with </span> {right}
        </h1>
        <Waiting error={error.replace(/^conductor: /, "")} what="the comparison" />
        {error && <p><a href="#/">Choose other runs</a></p>}
      </>
    );
  }
  const link = (name: string): JSX.Element => <a href={toBeside(left, name, [{ run: right, case: name }])}>{name}</a>;
  return (
    <>
      <h1>
        <a href={toRun(left)}>{left}</a> <span aria-hidden="true">→</span><span class="away"> compared with </span> <a href={toRun(right)}>{right}</a>{" "}
        <span class={`state ${data.result.replaceAll(" ", "-")}`}>{plain(data.result)}</span>
      </h1>
      {data.says.map((words, place) => (
        <p key={place} class={words.startsWith("Note:") ? "box notice" : place ? "" : "lead"}>
          {capital(words)}
        </p>
      ))}
      {data.flips.length > 0 ? (
        <Grid
          title="Cases that changed: a click shows both side by side" columns={["case", "change", `before: ${left}`, `after: ${right}`, "why"]}
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
          title="KPIs that moved, in cases that are in both" columns={["KPI", "changed in", "median change", "largest change", "in case"]}
          rows={data.shifts.filter((one) => one.changed).map((one) => [
            one.label,
            `${one.changed} of ${one.pairs}`,
            text(one.median.estimate),
            text(one.largest),
            one.largest_case ? link(one.largest_case) : "",
          ])}
        />
      )}
    </>
  );
}
