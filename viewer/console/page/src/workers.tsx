// Workers, their leases, what is quarantined and why, what the machines do.
import type { JSX } from "preact";
import { useEffect, useMemo, useState } from "preact/hooks";
import { Acts, actsOnRun, drainAct, mayAct } from "./acts";
import type { Runs, Workers } from "./data";
import { useData, useEvents } from "./hooks";
import type { LogLine } from "./live";
import { Figure, Waiting } from "./parts";
import { Plot } from "./plots";
import { toCase, toRun } from "./route";
import { count, number, span } from "./words";

const LINES_MAX = 200;
/** Workers are read again at most so often [ms]; they hold the resources of an hour. */
const ASK_MS = 3000;
/** A worker that was silent for longer is said to be [s]. */
const SILENT_S = 10;

export function WorkersView({ run, runs }: { run: string; runs: Runs }): JSX.Element {
  const [again, setAgain] = useState(0);
  const [lines, setLines] = useState<LogLine[]>([]);
  const { data: state, error } = useData<Workers>(`runs/${run}/workers.json`, again);
  useEffect(() => {
    if (!runs.live) return;
    const timer = setInterval(() => document.visibilityState === "visible" && setAgain((n) => n + 1), ASK_MS);
    return () => clearInterval(timer);
  }, [runs.live]);
  useEvents("log", (line) => setLines((before) => [...before, line].slice(-LINES_MAX)));
  useEvents("hello", (event) => setLines(event.log ?? []));
  const summary = runs.runs.find((one) => one.id === run);
  if (state === null) return <Waiting error={error} what="workers" />;
  const operates = mayAct(runs.roles);
  return (
    <>
      <h1>
        Workers of <a href={toRun(run)}>{summary?.name || run}</a>
      </h1>
      <Alarms state={state} />
      {operates && <Acts label="Campaign" acts={actsOnRun(run, summary?.paused ?? false)} />}
      {runs.live && <WorkersTable run={run} state={state} operates={operates} />}
      {runs.live && <Leases run={run} leases={state.leases} />}
      {!runs.live && Object.keys(state.resources).length === 0 && <p class="dim">No worker wrote down what it used.</p>}
      {runs.live && <Figure title="Quarantine">
        {state.quarantine.length === 0 && <p class="dim">No case is charged with a failure.</p>}
        {state.quarantine.map((one) => (
          <div key={one.case} class="box alarm">
            <h3>
              <a href={toCase(run, one.case)}>{one.case}</a>
            </h3>
            <p>{one.charge}</p>
            <pre tabIndex={0} aria-label={`Why ${one.case} is charged`}>
              {one.explain.join("\n")}
            </pre>
          </div>
        ))}
      </Figure>}
      <Resources resources={state.resources} />
      {runs.live && <Figure title="What the conductor says">
        <pre tabIndex={0} class="log" aria-label="Lines of the conductor">
          {lines.map((line) => line.text).join("\n") || "Nothing yet."}
        </pre>
      </Figure>}
    </>
  );
}

function Alarms({ state }: { state: Workers }): JSX.Element {
  const alarms = [
    ...(state.storage_error ? [`The conductor cannot write: ${state.storage_error}`] : []),
    ...(state.age_s !== null && state.age_s > SILENT_S ? [`No word from the conductor for ${span(state.age_s)}.`] : []),
    ...(state.draining ? ["The conductor drains: nothing more is leased."] : []),
    ...state.hosts,
    ...state.notes,
  ];
  return (
    <>
      {alarms.map((words) => (
        <p key={words} class="box notice" role="status">
          {words}
        </p>
      ))}
    </>
  );
}

type Worker = Workers["workers"][number];
const stateOf = (worker: Worker): string =>
  !worker.present ? "gone" : worker.draining ? "draining" : worker.age_s > SILENT_S ? "silent" : worker.held ? "busy" : "idle";

function WorkersTable({ run, state, operates }: { run: string; state: Workers; operates: boolean }): JSX.Element {
  return (
    <Figure title={count(state.workers.length, "worker")}>
      <div class="scroll" tabIndex={0} role="region" aria-label="Workers">
        <table>
          <thead>
            <tr>
              <th scope="col">worker</th>
              <th scope="col">state</th>
              <th scope="col">host</th>
              <th scope="col">device</th>
              <th scope="col" class="n">cases / slots</th>
              <th scope="col">last word</th>
              <th scope="col">walltime left</th>
              {operates && <th scope="col">acts</th>}
            </tr>
          </thead>
          <tbody>
            {state.workers.map((worker) => (
              <tr key={worker.id}>
                <th scope="row">{worker.id}</th>
                <td>
                  <span class={`state ${stateOf(worker)}`}>{stateOf(worker)}</span>
                </td>
                <td>{worker.host}</td>
                <td>{worker.device_class}</td>
                <td class="n">
                  {worker.held} / {worker.slots}
                </td>
                <td>{span(worker.age_s)} ago</td>
                <td>{span(worker.remaining_s)}</td>
                {operates && <td>{worker.present && <Acts label={`Worker ${worker.id}`} acts={[drainAct(run, worker.id)]} />}</td>}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Figure>
  );
}

function Leases({ run, leases }: { run: string; leases: Workers["leases"] }): JSX.Element {
  const shown = leases.slice(0, 256);
  return (
    <Figure title={count(leases.length, "running case")}>
      <div class="scroll" tabIndex={0} role="region" aria-label="Leases">
        <table>
          <thead>
            <tr>
              <th scope="col">case</th>
              <th scope="col">worker</th>
              <th scope="col" class="n">attempt</th>
              <th scope="col" class="n">tick</th>
              <th scope="col">for</th>
            </tr>
          </thead>
          <tbody>
            {shown.map((lease) => (
              <tr key={`${lease.case} ${lease.attempt}`}>
                <th scope="row">
                  <a href={toCase(run, lease.case)}>{lease.case}</a>
                  {lease.by_hand && " (intervened)"}
                </th>
                <td>{lease.worker}</td>
                <td class="n">{number(lease.attempt)}</td>
                <td class="n">{number(lease.tick)}</td>
                <td>{span(lease.for_s)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Figure>
  );
}

const PLOTS: [string, string, number][] = [
  ["cpu_cores", "CPU cores", 1],
  ["ram_bytes", "memory [GB]", 1e-9],
  ["gpu_percent", "GPU [%]", 1],
  ["gpu_memory_bytes", "GPU memory [GB]", 1e-9],
];

export function Resources({ resources }: { resources: Workers["resources"] }): JSX.Element | null {
  const key = JSON.stringify(Object.entries(resources).map(([name, one]) => [name, one.t.length, one.t.at(-1)]));
  const plots = useMemo(() => {
    const begin = Math.min(...Object.values(resources).map(({ t }) => t[0] ?? Infinity));
    return PLOTS.map(([name, title, scale]) => ({
      name,
      title,
      data: Object.entries(resources)
        .filter(([, one]) => one[name]?.some((value) => value !== null))
        .map(([worker, one]) => ({
          x: one.t.map((t) => t - begin),
          y: one[name]!.map((value) => (value === null ? null : value * scale)),
          name: worker.replaceAll("<", ""),
          mode: "lines",
          line: { width: 1.5 },
        })),
      layout: {
        margin: { l: 52, r: 8, t: 8, b: 36 },
        xaxis: { title: { text: "time [s]", standoff: 4 } },
        yaxis: { title: { text: title }, rangemode: "tozero" },
        legend: { orientation: "h", y: 1, yanchor: "bottom" },
        showlegend: true,
      },
    })).filter(({ data }) => data.length > 0);
  }, [key]);
  if (plots.length === 0) return null;
  return (
    <Figure title="Resources">
      {plots.map(({ name, title, data, layout }) => (
        <Plot key={name} data={data} layout={layout} label={`Over time: ${title}`} height={220} />
      ))}
    </Figure>
  );
}
