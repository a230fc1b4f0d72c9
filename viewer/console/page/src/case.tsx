// One case: why it ended so, what was seen, how to repeat it.
import type { JSX } from "preact";
import { useMemo, useState } from "preact/hooks";
import { Acts, actsOnCase, mayAct } from "./acts";
import { AwayFiles } from "./away";
import { type Clock, useClock, useTime } from "./clock";
import { type Beside, type CaseInfo, file, type Runs, type Series, STATIC, statusOf } from "./data";
import { useData, useEvents } from "./hooks";
import { FilmView } from "./film";
import { Chip, Command, Figure, kinds, VerdictSign, Waiting, wordsOf } from "./parts";
import { late, lagWords, useLag } from "./lag";
import { type Mark, Player } from "./player";
import { SeriesPlots } from "./plots";
import { toBeside, toCase, toWall } from "./route";
import { safe } from "./runs";
import { TopView } from "./topview";
import { at, called, capital, count, plain, text } from "./words";

interface Inputs {
  run: string;
  name: string;
  query: Map<string, string>;
  runs: Runs;
}

/** Cases beside this one in the matrix. */
const besides = (info: CaseInfo): Beside[] =>
  Object.values(info.neighbours).flatMap(({ before, after }) => [before, after].filter((one) => one !== null));

export const pathOf = (run: string, name: string): string => `runs/${run}/cases/${name}`;

export function CaseView({ run, name, query, runs }: Inputs): JSX.Element {
  const [version, setVersion] = useState(0);
  const [changes, setChanges] = useState(0);
  const info = useData<CaseInfo>(`${pathOf(run, name)}/case.json`, changes);
  const series = useData<Series | null>(`${pathOf(run, name)}/series.json`, changes);
  useEvents("picture", (event) => {
    if (event.run !== run) return;
    for (const [index, picture] of event.pictures) if (index === info.data?.index) setVersion(picture);
  });
  useEvents("table", (event) => {
    if (event.run !== run || info.data === null) return;
    const shown = [info.data, ...besides(info.data)];
    if (event.reset || shown.some(({ index }) => event.rows?.[String(index)] !== undefined)) setChanges((before) => before + 1);
  });
  if (info.data === null) return <Waiting error={info.error} what={`case ${name}`} />;
  const running = info.data.state === "running";
  return (
    <>
      <Why run={run} info={info.data} runs={runs} />
      {running && <Live run={run} info={info.data} version={version} runs={runs} />}
      <Recorded run={run} info={info.data} series={series.data} start={query.get("t")} />
      <Rest run={run} info={info.data} />
    </>
  );
}

function Why({ run, info, runs }: { run: string; info: CaseInfo; runs: Runs }): JSX.Element {
  return (
    <div class="why">
      <p class="kicker">
        <a href={toWall(run, [["at", info.case]])}>{runs.runs.find((one) => one.id === run)?.name || run}</a>
      </p>
      <h1 class="casename">{info.case}</h1>
      <p class="verdict">
        <Chip verdict={statusOf(info)} /> <span class="reason">{info.reasons.join("; ") || (info.outcome === null ? "It has not ended." : "No reason was given.")}</span>
      </p>
      <Axes info={info} />
      <h2 class="small">Repeat it</h2>
      <Command text={info.repeat} label="Command that repeats this case" />
      {info.away && <p class="dim note">On the machine of the conductor, or on one that shares its folder.</p>}
      {!info.away && relative(info.repeat) && (
        <p class="dim note">
          In a terminal, in the folder that holds <code>{run}</code>.
        </p>
      )}
    </div>
  );
}

/** Whether a command names a file that is only found from one folder. */
const relative = (command: string): boolean => /^conductor run '?[^/'\s]/.test(command) && /campaign\.yaml/.test(command);

/** What the case is: its values on the axes of the matrix. */
function Axes({ info }: { info: CaseInfo }): JSX.Element | null {
  const axes = Object.entries(info.axes).filter(([, value]) => value !== null);
  if (axes.length === 0) return null;
  return (
    <dl class="facts axes">
      {axes.map(([name, value]) => (
        <div key={name}>
          <dt>{called(name).title}</dt>
          <dd>{text(value, called(name).unit)}</dd>
        </div>
      ))}
    </dl>
  );
}

const WEATHERS = ["clear", "cloudy", "light_fog", "heavy_fog", "light_rain", "heavy_rain", "light_snow", "heavy_snow"];

function Live({ run, info, version, runs }: {
  run: string; info: CaseInfo; version: number; runs: Runs;
}): JSX.Element {
  const lag = useLag(run, info.index);
  const [weather, setWeather] = useState("");
  const [hour, setHour] = useState("");
  return (
    <div class="panel">
      <h2>Now</h2>
      <img class="live" src={file(`${pathOf(run, info.case)}/moment.webp`, version)} alt={`What the camera of ${info.case} sees now`} width="640" height="360" />
      <p role="status" class={late(lag) ? "box notice" : "dim"}>
        {late(lag) ? lagWords(lag)
        : lag !== null && lag.age_s !== null ? `Live; the picture is ${lag.age_s.toFixed(1)} s old.`
        : version ? "Live."
        : "Waiting for a picture."}
      </p>
      {mayAct(runs.roles) && (
        <>
          <div class="controls">
            <label>
              Weather{" "}
              <select value={weather} onChange={(event) => setWeather((event.target as HTMLSelectElement).value)}>
                <option value="">as it is</option>
                {WEATHERS.map((one) => (
                  <option key={one} value={one}>
                    {plain(one)}
                  </option>
                ))}
              </select>
            </label>
            <label>
              Hour <input type="number" min="0" max="24" step="0.5" value={hour} placeholder="as it is" onInput={(event) => setHour((event.target as HTMLInputElement).value)} />
            </label>
          </div>
          <Acts label="Intervene in this case" acts={actsOnCase(run, runs.runs.find((one) => one.id === run)?.name ?? run, info.case, weather, hour)} />
        </>
      )}
    </div>
  );
}

/** From when to when there is something to see [s], and the length of a tick. */
export function extentOf(info: CaseInfo, series: Series | null): [number, number, number] {
  const times = series?.t ?? [];
  if (times.length > 1) return [times[0]!, times[times.length - 1]!, times[1]! - times[0]!];
  if (info.film !== null) {
    const tick = 1 / info.film.fps;
    return [info.film.first_t, info.film.first_t + (info.film.frames - 1) * tick, tick];
  }
  return [0, 0, 0.05];
}

const MOMENTS: Record<string, string> = {
  impact: "the impact", closest: "the closest approach", trigger: "the trigger of emergency braking", end: "the end",
};

export function marksOf(info: CaseInfo): Mark[] {
  const marks: Mark[] = info.events.map((event) => ({ t: event.t, what: plain(event.what), kind: "event" }));
  if (info.moment !== null && info.moment.t !== null) {
    marks.push({ t: info.moment.t, what: MOMENTS[info.moment.what] ?? plain(info.moment.what), kind: "moment" });
  }
  return marks;
}

function Recorded({ run, info, series, start }: {
  run: string; info: CaseInfo; series: Series | null; start: string | null | undefined;
}): JSX.Element | null {
  const [begin, end, tick] = extentOf(info, series);
  const asked = Number(start);
  const first = start && Number.isFinite(asked) ? asked : (info.moment?.t ?? begin);
  const clock = useClock(begin, end, first);
  const marks = useMemo(() => marksOf(info), [info]);
  const overlays = useMemo(() => (series === null ? [] : [{ label: info.case, series, dash: "solid" as const }]), [series, info.case]);
  if ((series === null || series.t.length === 0) && info.film === null) {
    if (info.outcome === null) return null;
    return (
      <>
        <FilmView run={run} info={info} series={null} clock={clock} label={info.case} />
        {info.kpis.length > 0 && <Kpis info={info} />}
        {info.away && <AwayFiles away={info.away} what={info.log === null ? NOTHING_HERE : "Film, KPIs over time and recording of a case"} />}
      </>
    );
  }
  return (
    <>
      <div class="stage">
        <FilmView run={run} info={info} series={series} clock={clock} label={info.case} />
        {series !== null && series.actors.length > 0 && <TopView series={series} clock={clock} label={info.case} />}
      </div>
      <Player clock={clock} tick={tick} marks={marks} />
      <div class="twocol">
        <Figure title="Over time">
          <SeriesPlots overlays={overlays} clock={clock} marks={marks} />
        </Figure>
        <div>
          <Events info={info} clock={clock} />
          <Kpis info={info} />
        </div>
      </div>
      {info.away ? <AwayFiles away={info.away} what="Film and recording of a case" /> : <InFull info={info} clock={clock} />}
    </>
  );
}

/** What is missing of a case whose files a conductor does not give. */
const NOTHING_HERE = "Film, KPIs over time, events, log and recording of a case";

function Events({ info, clock }: { info: CaseInfo; clock: Clock }): JSX.Element {
  const t = useTime(clock, 100);
  return (
    <Figure title="Events">
      {info.events.length === 0 && <p class="dim">No events.</p>}
      <ol class="events">
        {info.events.map((event, place) => (
          <li key={place} class={event.t <= t + 1e-9 ? "past" : ""}>
            <button type="button" class="link" onClick={() => clock.to(event.t)}>
              {at(event.t)}
            </button>{" "}
            <EventKind what={event.what} /> {worded(event.detail)}
          </li>
        ))}
      </ol>
    </Figure>
  );
}

/** A text with the words of the verdict that it begins with: `false_braking: ...`. */
const worded = (detail: string): string => detail.replace(/^\w+(?=: )/, (name) => (kinds.has(name) ? wordsOf(name) : name));

const KINDS: Record<string, [string, string]> = { warn: ["▲", "warning"], error: ["✕", "failure"], info: ["•", ""] };

/** Levels of a log as signs, with a name for who does not see them. */
function EventKind({ what }: { what: string }): JSX.Element {
  const [sign, name] = KINDS[what] ?? ["", ""];
  if (!sign) return <strong>{plain(what)}</strong>;
  return (
    <>
      <span class={`eventkind ${what}`} aria-hidden="true">
        {sign}
      </span>
      {name && <span class="away">{name}: </span>}
    </>
  );
}

function Kpis({ info }: { info: CaseInfo }): JSX.Element {
  return (
    <Figure title="KPIs">
      {info.kpis.length === 0 && <p class="dim">{info.state === "ended" ? "It has none." : "They come with the end of the case."}</p>}
      <div class="scroll" hidden={info.kpis.length === 0} tabIndex={0} role="region" aria-label="KPIs">
        <table>
          <thead>
            <tr>
              <th scope="col">KPI</th>
              <th scope="col" class="n">value</th>
            </tr>
          </thead>
          <tbody>
            {info.kpis.map((kpi) => (
              <tr key={kpi.name}>
                <th scope="row">
                  <KpiName kpi={kpi} />
                </th>
                <td class="n">{text(kpi.value, kpi.unit)}</td>
              </tr>
            ))}
            {Object.entries(info.names).map(([name, value]) => (
              <tr key={name}>
                <th scope="row">{capital(called(name).title)}</th>
                <td class="n">{value}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Figure>
  );
}

/** What a KPI says, and the name by which filters and files know it. */
export function KpiName({ kpi }: { kpi: { name: string; title: string; doc?: string } }): JSX.Element {
  return (
    <>
      {kpi.doc || kpi.title || capital(called(kpi.name).title)} <code class="dim">{kpi.name}</code>
    </>
  );
}

/** Rerun's viewer at the same moment, in a frame; it is large, so it comes when it is asked for. */
function InFull({ info, clock }: { info: CaseInfo; clock: Clock }): JSX.Element {
  const [address, setAddress] = useState("");
  const { in_full: full, recording, video, incomplete } = info.links;
  return (
    <Figure title="In full, in 3D">
      <p class="line">
        {full ? (
          <button type="button" onClick={() => setAddress(`${safe(full.split("#")[0]!)}#when=sim_time@+${clock.t.toFixed(3)}s`)}>
            {address ? "Open in full at this moment again" : "Open in full at this moment"}
          </button>
        ) : (
          <span class="dim">
            {STATIC && incomplete !== null
              ? "The view in 3D is not part of saved files; viewer web shows it."
              : "No recording, so there is no view in 3D (run the case with --view record)."}
          </span>
        )}
        {recording && (
          <a class="button" href={safe(recording)} download>
            Recording (.rrd)
          </a>
        )}
        {video && (
          <a class="button" href={safe(video)} download>
            Video
          </a>
        )}
      </p>
      {incomplete && info.state !== "running" && <p class="dim">The recorder was stopped early: the recording ends before the case did.</p>}
      {address && <iframe key={address} src={address} title={`Rerun viewer: ${info.case}`} />}
    </Figure>
  );
}

function Rest({ run, info }: { run: string; info: CaseInfo }): JSX.Element {
  const axes = Object.entries(info.neighbours).filter(([, { before, after }]) => before !== null || after !== null);
  return (
    <>
      {axes.length > 0 && (
        <Figure title="Neighbours in the matrix">
          {axes.map(([axis, { before, after }]) => (
            <div key={axis} class="neighbours">
              <h3>{capital(called(axis).title)}</h3>
              <ul>
                {before !== null && <Neighbour run={run} info={info} to={before} sign="←" axis={axis} />}
                <li aria-current="true">
                  <VerdictSign verdict={statusOf(info)} /> <strong>{text(info.axes[axis], called(axis).unit)}</strong>
                  <span class="away"> (this case)</span>
                </li>
                {after !== null && <Neighbour run={run} info={info} to={after} sign="→" axis={axis} />}
              </ul>
            </div>
          ))}
        </Figure>
      )}
      {info.log !== null && <Log log={info.log} />}
      <Attempts info={info} />
    </>
  );
}

function Neighbour({ run, info, to, sign, axis }: { run: string; info: CaseInfo; to: Beside; sign: string; axis: string }): JSX.Element {
  return (
    <li>
      {to.verdict !== undefined && <VerdictSign verdict={to.verdict ?? to.state ?? "waiting"} />}{" "}
      <a href={toCase(run, to.case)}>
        <span aria-hidden="true">{sign}</span> {text(to.value, called(axis).unit)}
      </a>{" "}
      <a class="button" href={toBeside(run, info.case, [{ run, case: to.case }])} aria-label={`Side by side with ${to.case}`} title="Both cases side by side">
        ⇄
      </a>
    </li>
  );
}

function Attempts({ info }: { info: CaseInfo }): JSX.Element | null {
  const { count: number, charges, steered, doubles = [], worker, device_class: device, wall_s: wall } = info.attempts;
  if (!number) return null;
  return (
    <Figure title="Attempts">
      <p>
        {count(number, "attempt")}
        {worker && `; the one that counts ran on ${worker}`}
        {device && ` (${device})`}
        {wall !== null && ` for ${text(wall)} s`}.
      </p>
      {charges.length + steered.length + doubles.length > 0 && (
        <ul class="plain">
          {[...charges, ...steered, ...doubles].map((words, place) => (
            <li key={place}>{words}</li>
          ))}
        </ul>
      )}
    </Figure>
  );
}

function Log({ log }: { log: NonNullable<CaseInfo["log"]> }): JSX.Element {
  return (
    <Figure title="Log of the stack">
      {log.traceback !== null && (
        <>
          <h3>Traceback</h3>
          <pre tabIndex={0} class="alarm" aria-label="Traceback of the stack">
            {log.traceback.join("\n")}
          </pre>
        </>
      )}
      <details open={log.traceback === null && log.lines.length < 60}>
        <summary>{log.cut ? "The end of the log" : "The log"}</summary>
        <pre tabIndex={0} class="log" aria-label="Log of the stack">
          {log.lines.join("\n") || "(empty)"}
        </pre>
      </details>
    </Figure>
  );
}
