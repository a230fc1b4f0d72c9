// Two cases, or one case of two runs, side by side at the same sim time.
import type { JSX } from "preact";
import { useMemo } from "preact/hooks";
import { extentOf, KpiName, marksOf, pathOf } from "./case";
import { type Clock, useClock } from "./clock";
import { type CaseInfo, type Series, statusOf, type Value } from "./data";
import { firstDifference } from "./differ";
import { FilmView } from "./film";
import { useData } from "./hooks";
import { Chip, Figure, Waiting } from "./parts";
import { type Mark, Player } from "./player";
import { type Overlay, SeriesPlots } from "./plots";
import { type Route, toCase } from "./route";
import { TopView } from "./topview";
import { at, called, number, text } from "./words";

interface Side {
  run: string;
  info: CaseInfo;
  series: Series | null;
}

export function BesideView({ route }: { route: Route }): JSX.Element {
  const one = useData<CaseInfo>(`${pathOf(route.run, route.case)}/case.json`);
  const two = useData<CaseInfo>(`${pathOf(route.run2, route.case2)}/case.json`);
  const oneSeries = useData<Series | null>(`${pathOf(route.run, route.case)}/series.json`);
  const twoSeries = useData<Series | null>(`${pathOf(route.run2, route.case2)}/series.json`);
  const gone = oneSeries.error || twoSeries.error;
  if (one.data === null || two.data === null) return <Waiting error={one.error || two.error} what="both cases" />;
  if (!gone && (oneSeries.data === null || twoSeries.data === null)) {
    return <Waiting error="" what="both drives" />;
  }
  const left = { run: route.run, info: one.data, series: oneSeries.data };
  const right = { run: route.run2, info: two.data, series: twoSeries.data };
  return <Beside left={left} right={right} start={route.query.get("t")} />;
}

function Beside({ left, right, start }: { left: Side; right: Side; start: string | undefined }): JSX.Element {
  const [begin1, end1, tick] = extentOf(left.info, left.series);
  const [begin2, end2] = extentOf(right.info, right.series);
  const differs = useMemo(
    () => (left.series === null || right.series === null ? null : firstDifference(left.series, right.series)),
    [left.series, right.series],
  );
  const asked = Number(start);
  const first = start && Number.isFinite(asked) ? asked : (differs?.t ?? Math.min(begin1, begin2));
  const clock = useClock(Math.min(begin1, begin2), Math.max(end1, end2), first);
  const marks = useMemo(() => {
    const found: Mark[] = marksOf(left.info).filter((mark) => mark.kind === "moment");
    if (differs !== null) found.push({ t: differs.t, what: "first difference", kind: "differs" });
    return found;
  }, [left.info, differs]);
  const overlays: Overlay[] = useMemo(() => {
    const names = left.info.case === right.info.case ? [left.run, right.run] : [left.info.case, right.info.case];
    return [left, right].flatMap(({ series }, place) =>
      series === null ? [] : [{ label: names[place]!, series, dash: place ? ("dash" as const) : ("solid" as const) }],
    );
  }, [left.series, right.series]);
  const both = left.series !== null && right.series !== null;
  return (
    <>
      <h1>Side by side</h1>
      <p class="box notice" role="status">
        {!both ? "One of the drives has no rows, so nothing is compared tick by tick."
        : differs === null ? "Both drives are the same, at every tick."
        : `They differ first at ${at(differs.t)}: ${called(differs.what).title} is ${text(differs.left, differs.unit)} on the left, ${text(differs.right, differs.unit)} on the right${closely(differs.left, differs.right, differs.unit)}.`}
      </p>
      <Player clock={clock} tick={tick} marks={marks} />
      <div class="sides">
        <SideView side={left} clock={clock} label="left" />
        <SideView side={right} clock={clock} label="right" />
      </div>
      <Figure title="Over time">
        <SeriesPlots overlays={overlays} clock={clock} marks={marks} />
      </Figure>
      <Kpis left={left.info} right={right.info} />
    </>
  );
}

/** Two values that look the same when rounded. */
const closely = (left: number | null, right: number | null, unit: string): string =>
  left !== null && right !== null && number(left) === number(right) ? `, a difference of ${text(right - left, unit)}` : "";

function SideView({ side, clock, label }: { side: Side; clock: Clock; label: string }): JSX.Element {
  const { run, info, series } = side;
  return (
    <section aria-label={`The ${label} case`}>
      <h2 class="casename">
        <a href={toCase(run, info.case)}>{info.case}</a>
      </h2>
      <p>
        <Chip verdict={statusOf(info)} /> <span class="reason">{info.reasons.join("; ")}</span> <span class="dim">in {run}</span>
      </p>
      <FilmView run={run} info={info} series={series} clock={clock} label={`the ${label} case`} />
      {series !== null && <TopView series={series} clock={clock} label={`The ${label} case`} />}
    </section>
  );
}

function Kpis({ left, right }: { left: CaseInfo; right: CaseInfo }): JSX.Element {
  const value = (info: CaseInfo, name: string): Value => info.kpis.find((kpi) => kpi.name === name)?.value ?? null;
  return (
    <Figure title="KPIs">
      <div class="scroll" tabIndex={0} role="region" aria-label="KPIs of both">
        <table>
          <thead>
            <tr>
              <th scope="col">KPI</th>
              <th scope="col" class="n">left</th>
              <th scope="col" class="n">right</th>
            </tr>
          </thead>
          <tbody>
            {left.kpis.map((kpi) => (
              <tr key={kpi.name} class={kpi.value === value(right, kpi.name) ? "" : "differs"}>
                <th scope="row">
                  <KpiName kpi={kpi} />
                </th>
                <td class="n">{text(kpi.value, kpi.unit)}</td>
                <td class="n">{text(value(right, kpi.name), kpi.unit)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Figure>
  );
}
