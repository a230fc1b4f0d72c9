// What somebody with the role may do: each act is confirmed, in words that say what it costs.
import type { JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { STATIC, token } from "./data";

export const mayAct = (roles: string): boolean => !STATIC && roles === "operate" && token() !== "";

export interface Act {
  act: "pause" | "resume" | "drain" | "cancel" | "intervene";
  label: string;
  body: () => Promise<Record<string, unknown>>;
}

async function post(name: string, body: Record<string, unknown>): Promise<{ confirm?: string; done?: string }> {
  const answer = await fetch(`act/${name}`, {
    method: "POST",
    headers: { "Content-Type": "application/json", "X-Steer-Token": token() },
    body: JSON.stringify(body),
  });
  const said = (await answer.json().catch(() => ({}))) as { confirm?: string; done?: string; error?: string };
  if (!answer.ok) throw new Error(said.error ?? `refused (${answer.status})`);
  return said;
}

const wordsOf = (error: unknown): string => (error instanceof Error ? error.message : String(error));

interface Asked {
  act: Act;
  body: Record<string, unknown>;
  /** What it does, also to verdicts, as the server says. */
  cost: string;
}

/** Buttons of acts; the server says what each does, and nothing happens before somebody confirms. */
export function Acts({ acts, label }: { acts: Act[]; label: string }): JSX.Element {
  const [asked, setAsked] = useState<Asked | null>(null);
  const [said, setSaid] = useState("");
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (asked !== null) dialog.current?.showModal();
  }, [asked]);
  const ask = async (act: Act): Promise<void> => {
    setSaid("");
    try {
      const body = await act.body();
      const { confirm } = await post(act.act, { ...body, confirm: false });
      setAsked({ act, body, cost: confirm ?? "" });
    } catch (error) {
      setSaid(wordsOf(error));
    }
  };
  const carryOut = async ({ act, body }: Asked): Promise<void> => {
    setSaid(`${act.label} …`);
    try {
      setSaid((await post(act.act, { ...body, confirm: true })).done ?? "Done.");
    } catch (error) {
      setSaid(wordsOf(error));
    }
  };
  return (
    <div class="acts" role="group" aria-label={label}>
      {acts.map((act) => (
        <button key={act.label} type="button" onClick={() => void ask(act)}>
          {act.label}
        </button>
      ))}
      <span role="status">{said}</span>
      <dialog ref={dialog} aria-labelledby="asked" onClose={() => setAsked(null)}>
        <h2 id="asked">{asked?.act.label}?</h2>
        <p>{asked?.cost}</p>
        <div class="line">
          <button type="button" onClick={() => dialog.current?.close()}>
            No
          </button>
          <button
            type="button"
            class="main"
            onClick={() => {
              if (asked !== null) void carryOut(asked);
              dialog.current?.close();
            }}
          >
            {asked?.act.label}
          </button>
        </div>
      </dialog>
    </div>
  );
}

const plainAct = (act: Act["act"], label: string, body: Record<string, unknown>): Act => ({
  act,
  label,
  body: () => Promise.resolve(body),
});

export function actsOnRun(run: string, paused: boolean): Act[] {
  return [
    paused ? plainAct("resume", "Resume", { run }) : plainAct("pause", "Pause", { run }),
    plainAct("cancel", "Cancel", { run }),
  ];
}

export const drainAct = (run: string, worker: string): Act => plainAct("drain", `Drain ${worker}`, { run, worker });

interface Running {
  campaign: string;
  case: string;
  token: number;
}

/** Acts on a running case of the run that its conductor calls `campaign`; `weather` and `hour` are what somebody has chosen. */
export function actsOnCase(run: string, campaign: string, name: string, weather: string, hour: string): Act[] {
  const attempt = async (): Promise<Running> => {
    const answer = await fetch("running.json");
    if (!answer.ok) throw new Error(await answer.text());
    const found = ((await answer.json()) as Running[]).find((one) => one.case === name && one.campaign === campaign);
    if (found === undefined) throw new Error(`${name} of ${campaign} does not run any more, or its rig takes no interventions`);
    return found;
  };
  const act = (label: string, does: Record<string, unknown>): Act => ({
    act: "intervene",
    label,
    body: async () => {
      const { token: attemptToken } = await attempt();
      return { run, case: name, campaign, token: attemptToken, ...does };
    },
  });
  const settings: Record<string, string | number> = {};
  if (weather) settings.weather = weather;
  if (hour) settings.hour = Number(hour);
  return [
    act("Pause case", { action: { action: "pause" } }),
    act("Step 20 ticks", { action: { action: "step", ticks: 20 } }),
    act("Resume case", { action: { action: "resume" } }),
    ...(weather || hour ? [act("Set weather and hour", { settings })] : []),
    act("Release case", { action: { action: "release" } }),
  ];
}
