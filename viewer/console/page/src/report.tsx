// The report of a campaign, in a frame: it is the file itself, with scripts and an origin of its own.
import type { JSX } from "preact";
import type { RunInfo } from "./data";
import { useData } from "./hooks";
import { Waiting } from "./parts";
import { toRun } from "./route";
import { safe } from "./runs";

/** What a report may do: no forms, no windows of its own, nothing in our origin. */
const SANDBOX = "allow-scripts allow-downloads";

export function ReportView({ run }: { run: string }): JSX.Element {
  const { data, error } = useData<RunInfo>(`runs/${run}/run.json`);
  if (data === null) return <Waiting error={error} what={`campaign ${run}`} />;
  const link = data.links.report;
  return (
    <>
      <div class="line spread">
        <h1>
          Report of <a href={toRun(run)}>{data.name || run}</a>
        </h1>
        {link && (
          <a class="button" href={safe(link)} target="_blank" rel="noreferrer">
            Open it alone
          </a>
        )}
      </div>
      {link ? (
        <iframe class="report" src={safe(link)} sandbox={SANDBOX} title={`Report of ${data.name || run}`} />
      ) : (
        <p class="box notice">
          There is no report yet: a campaign writes one when it ends, and <code>conductor report</code> at any time.
        </p>
      )}
    </>
  );
}
