// The page: head, address, views.
import { render } from "preact";
import type { JSX } from "preact";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { BesideView } from "./beside";
import { CaseView } from "./case";
import { type RunInfo, type Runs, STATIC, takeToken } from "./data";
import { useData, useSignal } from "./hooks";
import { live } from "./live";
import { ComparePage, RulebookView, SearchView } from "./pages";
import { knowKinds, Waiting } from "./parts";
import { ReportView } from "./report";
import { address, parse, type Route, toRun, toWall } from "./route";
import { RunsView, RunView } from "./runs";
import { Theme } from "./theme";
import { WallView } from "./wall";
import { WorkersView } from "./workers";

const ASK_MS = 3000;

function useRoute(): Route {
  const [hash, setHash] = useState(location.hash);
  useEffect(() => {
    const hear = (): void => {
      takeToken();
      setHash(location.hash);
    };
    addEventListener("hashchange", hear);
    addEventListener("requery", hear);
    return () => {
      removeEventListener("hashchange", hear);
      removeEventListener("requery", hear);
    };
  }, []);
  return useMemo(() => parse(hash), [hash]);
}

/** All runs; new ones are looked for while the page is seen. */
function useRuns(): { runs: Runs | null; error: string } {
  const [again, setAgain] = useState(0);
  const answer = useData<Runs>("runs.json", again);
  const isLive = answer.data?.live ?? false;
  useEffect(() => {
    if (!isLive || STATIC) return;
    live.start();
    const timer = setInterval(() => document.visibilityState === "visible" && setAgain((n) => n + 1), ASK_MS);
    return () => clearInterval(timer);
  }, [isLive]);
  knowKinds(answer.data?.verdict_words);
  return { runs: answer.data, error: answer.error };
}

function LineState({ isLive }: { isLive: boolean }): JSX.Element {
  useSignal(live, "line");
  const gone = live.gone;
  const words =
    STATIC ? "saved copy"
    : !isLive ? "not live"
    : live.line === "lost" ? "no connection; trying again"
    : gone ? `conductor: ${gone}`
    : live.line === "open" ? "live"
    : "connecting";
  const bad = isLive && (live.line === "lost" || gone !== "");
  return (
    <span class={`online ${bad ? "bad" : ""}`} role="status" title={isLive || STATIC ? undefined : "Read from files; viewer web --run follows what runs."}>
      {words}
    </span>
  );
}

const TABS: [keyof RunInfo["links"], string][] = [["report", "Report"], ["search", "Search"], ["rulebook", "Rulebook"]];

function Head({ route, runs }: { route: Route; runs: Runs | null }): JSX.Element {
  const { run, view } = route;
  const known = runs?.runs.some((one) => one.id === run && !one.error) ?? false;
  const info = useData<RunInfo>(known && view !== "compare" ? `runs/${run}/run.json` : null);
  const tabs: [string, string, boolean][] = known && view !== "compare"
    ? [
        [toRun(run), "Summary", view === "run"],
        [toWall(run), "Wall", view === "wall"],
        ...TABS.filter(([name]) => info.data?.links[name]).map(([name, label]): [string, string, boolean] => [
          address(["run", run, String(name)]), label, view === name,
        ]),
        [address(["run", run, "workers"]), "Workers", view === "workers"],
      ]
    : [];
  return (
    <header>
      <a class="skip" href="#main" onClick={(event) => skip(event)}>
        To the content
      </a>
      <nav aria-label="Views">
        {only(runs) === null && (
          <a href="#/" aria-current={view === "runs" ? "page" : undefined}>
            Campaigns
          </a>
        )}
        {tabs.map(([link, label, here]) => (
          <a key={label} href={link} aria-current={here ? "page" : undefined}>
            {label}
          </a>
        ))}
        {only(runs) !== null && tabs.length === 0 && <a href="#/">Summary</a>}
      </nav>
      <LineState isLive={runs?.live ?? false} />
      <Theme />
    </header>
  );
}

/** The only campaign, which is opened at once; null: there are more, or none. */
const only = (runs: Runs | null): string | null => (runs?.runs.length === 1 ? runs.runs[0]!.id : null);

function skip(event: Event): void {
  event.preventDefault();
  document.getElementById("main")?.focus();
}

function View({ route, runs }: { route: Route; runs: Runs }): JSX.Element {
  const { run } = route;
  switch (route.view) {
    case "runs":
      return <RunsView runs={runs} />;
    case "run":
      return <RunView key={run} run={run} runs={runs} />;
    case "wall":
      return <WallView key={run} run={run} query={route.query} isLive={runs.live} />;
    case "case":
      return <CaseView key={`${run}/${route.case}`} run={run} name={route.case} query={route.query} runs={runs} />;
    case "beside":
      return <BesideView key={location.hash.split("?")[0] ?? ""} route={route} />;
    case "search":
      return <SearchView key={run} run={run} />;
    case "rulebook":
      return <RulebookView key={run} run={run} />;
    case "report":
      return <ReportView key={run} run={run} />;
    case "workers":
      return <WorkersView key={run} run={run} runs={runs} />;
    case "compare":
      return <ComparePage left={run} right={route.run2} />;
    case "lost":
      return (
        <>
          <h1>No such view</h1>
          <p>
            This address names no view of the console. <a href="#/">All campaigns</a>
          </p>
        </>
      );
  }
}

function Page(): JSX.Element {
  const route = useRoute();
  const { runs, error } = useRuns();
  const single = route.view === "runs" ? only(runs) : null;
  useEffect(() => {
    if (single === null) return;
    history.replaceState(null, "", toRun(single));
    dispatchEvent(new Event("requery"));
  }, [single]);
  const place = `${route.view}/${route.run}/${route.case}`;
  const main = useRef<HTMLElement>(null);
  const before = useRef(place);
  useEffect(() => {
    const names = [route.case || (route.view === "runs" ? "campaigns" : route.view), route.run, "drivetwin"];
    document.title = names.filter(Boolean).join(" – ");
    if (before.current !== place) {
      before.current = place;
      main.current?.focus({ preventScroll: true });
      scrollTo(0, 0);
    }
  }, [place]);
  return (
    <>
      <Head route={route} runs={runs} />
      <main id="main" ref={main} tabIndex={-1} class={`of-${route.view}`}>
        {runs === null || single !== null ? <Waiting error={error} what="campaigns" /> : <View route={route} runs={runs} />}
      </main>
    </>
  );
}

takeToken();
render(<Page />, document.getElementById("console")!);
