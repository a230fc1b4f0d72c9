// Two cases, or one case of two runs, or as many as eight, side by side at the same sim time.
import type { JSX } from "preact";
import { useMemo } from "preact/hooks";
import { extentOf, KpiName, marksOf, pathOf } from "./case";
import { type Clock, useClock } from "./clock";
import { kpisAsCsv, rowsAsCsv, type Side } from "./compared";
import { type CaseInfo, type Series, statusOf, type Value } from "./data";
import { type Difference, firstDifference } from "./differ";
import { FilmView } from "./film";
import { useEach } from "./hooks";
import { Chip, Figure, save, VerdictSign, Waiting } from "./parts";
import { type Mark, Player } from "./player";
import { type Overlay, SeriesPlots } from "./plots";
import { BESIDE_MAX, type CaseRef, type Route, toBeside, toCase } from "./route";
import { TopView } from "./topview";
import { at, called, capital, number, text } from "./words";

export function BesideView({ route }: { route: Route }): JSX.Element {
  const asked: CaseRef[] = [{ run: route.run, case: route.case }, ...route.others];
  const infos = useEach<CaseInfo>(asked.map((one) => `${pathOf(one.run, one.case)}/case.json`), BESIDE_MAX);
  const drives = useEach<Series | null>(asked.map((one) => `${pathOf(one.run, one.case)}/series.json`), BESIDE_MAX);
  const waits = asked.some((_, place) => (infos[place]!.data === null && !infos[place]!.error) || (drives[place]!.data === null && !drives[place]!.error));
  const sides = useMemo(
    () => asked.flatMap(({ run }, place) => (infos[place]!.data === null ? [] : [{ run, info: infos[place]!.data!, series: drives[place]!.data }])),
    [...infos, ...drives].map((one) => one.data),
  );
  const lost = asked.flatMap((one, place) => (infos[place]!.data === null && infos[place]!.error ? [{ name: one.case, error: infos[place]!.error }] : []));
  return (
    <>
      <h1>Side by side</h1>
      {lost.map(({ name, error }) => (
        <Waiting key={name} error={error} what={`case ${name}`} />
      ))}
      {waits && <Waiting error="" what={asked.length === 2 ? "both cases" : "the cases"} />}
      {!waits && sides.length > 0 && <Beside key={sides.map(({ run, info }) => `${run}/${info.case}`).join()} sides={sides} start={route.query.get("t")} />}
    </>
  );
}

/** The first tick at which any of them differs from the first, and the place of that one. */
function differenceOf([first, ...others]: Side[]): (Difference & { place: number }) | null {
  let earliest: (Difference & { place: number }) | null = null;
  others.forEach(({ series }, place) => {
    const found = series === null || first!.series === null ? null : firstDifference(first!.series, series);
    if (found !== null && (earliest === null || found.t < earliest.t)) earliest = { ...found, place: place + 1 };
  });
  return earliest;
}

/** What a case is called here: by where it stands, or by its number. */
const nameOf = (place: number, count: number): string => (count === 2 ? ["left", "right"][place]! : `case ${place + 1}`);

function Beside({ sides, start }: { sides: Side[]; start: string | undefined }): JSX.Element {
  const extents = sides.map(({ info, series }) => extentOf(info, series)).filter(([begin, end]) => end > begin);
  const begin = extents.length ? Math.min(...extents.map((one) => one[0])) : 0;
  const end = extents.length ? Math.max(...extents.map((one) => one[1])) : 0;
  const differs = useMemo(() => differenceOf(sides), [sides]);
  const asked = Number(start);
  const clock = useClock(begin, end, start && Number.isFinite(asked) ? asked : (differs?.t ?? begin));
  const marks = useMemo(() => {
    const found: Mark[] = marksOf(sides[0]!.info).filter((mark) => mark.kind === "moment");
    if (differs !== null) found.push({ t: differs.t, what: "first difference", kind: "differs" });
    return found;
  }, [sides, differs]);
  const overlays = useMemo(() => overlaysOf(sides), [sides]);
  const many = sides.length > 2;
  return (
    <>
      <p class="box notice" role="status">
        {differenceWords(sides, differs)}
      </p>
      {extents.length > 0 && <Player clock={clock} tick={extents[0]![2]} marks={marks} />}
      <div class={many ? "sides many" : "sides"}>
        {sides.map((side, place) => (
          <SideView key={`${place} ${side.run}/${side.info.case}`} sides={sides} place={place} clock={clock} />
        ))}
      </div>
      {overlays.length > 0 && (
        <Figure title="Over time">
          <SeriesPlots overlays={overlays} clock={clock} marks={marks} />
        </Figure>
      )}
      <Kpis sides={sides} />
    </>
  );
}

/** Two drives differ by their dashes, more by colour first: dots say that colours begin again. */
function overlaysOf(sides: Side[]): Overlay[] {
  const same = sides.every(({ info }) => info.case === sides[0]!.info.case);
  return sides.flatMap(({ run, info, series }, place): Overlay[] => {
    if (series === null || series.t.length === 0) return [];
    const name = same ? run : info.case;
    if (sides.length === 2) return [{ label: name, series, hue: place, dash: place ? "dash" : "solid" }];
    return [{ label: `${place + 1}: ${name}`, series, hue: place, dash: place < BESIDE_MAX / 2 ? "solid" : "dot" }];
  });
}

function differenceWords(sides: Side[], differs: (Difference & { place: number }) | null): string {
  const both = sides.length === 2;
  if (sides.length === 1) return "Only one of the cases is here.";
  const bare = sides.filter(({ series }) => series === null || series.t.length === 0).length;
  const missing = bare === 0 ? "" : both ? "One of the drives has no rows, so nothing is compared tick by tick." : `${bare} of the drives ${bare === 1 ? "has" : "have"} no rows, so not all are compared tick by tick. `;
  if (both && missing) return missing;
  if (differs === null) return missing || `${both ? "Both" : "All"} drives are the same, at every tick.`;
  const { what, unit, left, right } = differs;
  const where = both ? ["on the left", "on the right"] : ["in case 1", `in case ${differs.place + 1}`];
  return `${missing}They differ first at ${at(differs.t)}: ${called(what).title} is ${text(left, unit)} ${where[0]}, ${text(right, unit)} ${where[1]}${closely(left, right, unit)}.`;
}

/** Two values that look the same when rounded. */
const closely = (left: number | null, right: number | null, unit: string): string =>
  left !== null && right !== null && number(left) === number(right) ? `, a difference of ${text(right - left, unit)}` : "";

function SideView({ sides, place, clock }: { sides: Side[]; place: number; clock: Clock }): JSX.Element {
  const { run, info, series } = sides[place]!;
  const many = sides.length > 2;
  const label = many ? `case ${place + 1}` : `the ${nameOf(place, 2)} case`;
  const driven = series !== null && series.t.length > 0;
  const rest = sides.filter((_, other) => other !== place).map((side) => ({ run: side.run, case: side.info.case }));
  return (
    <section aria-label={capital(label)}>
      <h2 class="casename">
        {many && `${place + 1}: `}
        <a href={toCase(run, info.case)}>{info.case}</a>
      </h2>
      <p>
        <Chip verdict={statusOf(info)} /> <span class="reason">{info.reasons.join("; ")}</span> <span class="dim">in {run}</span>
      </p>
      {(!many || info.film !== null || !driven) && <FilmView run={run} info={info} series={series} clock={clock} label={label} />}
      {driven && (!many || info.film === null) && <TopView series={series} clock={clock} label={capital(label)} />}
      {many && (
        <a class="button" href={toBeside(rest[0]!.run, rest[0]!.case, rest.slice(1))} aria-label={`Leave out ${info.case}`}>
          Leave out
        </a>
      )}
    </section>
  );
}

/** Axes on which they differ, and KPIs, beside each other; as files, too. */
function Kpis({ sides }: { sides: Side[] }): JSX.Element {
  const axes = namesIn(sides.map(({ info }) => Object.keys(info.axes))).filter((name) => differ(sides.map(({ info }) => info.axes[name] ?? null)));
  const kpis = namesIn(sides.map(({ info }) => info.kpis.map((kpi) => kpi.name)));
  const driven = sides.some(({ series }) => series !== null && series.t.length > 0);
  return (
    <Figure title="KPIs">
      <div class="scroll" tabIndex={0} role="region" aria-label="KPIs of all cases">
        <table>
          <thead>
            <tr>
              <th scope="col">KPI</th>
              {sides.map(({ info }, place) => (
                <th key={place} scope="col" class="n" title={info.case}>
                  <VerdictSign verdict={statusOf(info)} /> {nameOf(place, sides.length)}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {axes.map((name) => (
              <tr key={`axis ${name}`}>
                <th scope="row">
                  {capital(called(name).title)} <code class="dim">{name}</code>
                </th>
                {sides.map(({ info }, place) => (
                  <td key={place} class="n">{text(info.axes[name], called(name).unit)}</td>
                ))}
              </tr>
            ))}
            {kpis.map((name) => {
              const found = sides.map(({ info }) => info.kpis.find((kpi) => kpi.name === name));
              const known = found.find((kpi) => kpi !== undefined)!;
              return (
                <tr key={name} class={differ(found.map((kpi) => kpi?.value ?? null)) ? "differs" : ""}>
                  <th scope="row">
                    <KpiName kpi={known} />
                  </th>
                  {found.map((kpi, place) => (
                    <td key={place} class="n">{text(kpi?.value, known.unit)}</td>
                  ))}
                </tr>
              );
            })}
          </tbody>
        </table>
      </div>
      <p class="line">
        <button type="button" onClick={() => save("cases.csv", kpisAsCsv(sides), "text/csv")}>
          Save KPIs as CSV
        </button>
        <button type="button" disabled={!driven} onClick={() => save("cases-over-time.csv", rowsAsCsv(sides), "text/csv")}>
          Save rows over time as CSV
        </button>
      </p>
    </Figure>
  );
}

const namesIn = (lists: string[][]): string[] => [...new Set(lists.flat())];
const differ = (values: Value[]): boolean => values.some((value) => value !== values[0]);
