// The stream of a live console: it heals by itself, and says how it stands.
import { forget, STATIC, type Value } from "./data";

/** Without any event for so long the stream is opened anew [ms]; the server says something every 5 s. */
const SILENCE_MS = 12_000;
/** Without a word of the conductor for so long it is said to be silent [ms]; it says something every second. */
const CONDUCTOR_MS = 8_000;
const PAUSE_MS = [500, 1000, 2000, 4000];

export interface Events {
  /** The first of a stream; `resync`: something was missed, so all has to be read again; `version`: of each table. */
  hello: { server: string; resync: boolean; version: Record<string, string>; conductor_age_s: number | null; log: LogLine[] };
  /** What changed in a table; `reset`: it has other columns or another order. */
  table: { run: string; version: string; reset?: boolean; rows?: Record<string, Record<string, Value>>; cases?: string[] };
  /** Of each new picture its case by number, version, sim time [s] and age [s]. */
  picture: {
    run: string;
    pictures: [number, number, number | null, number | null][];
    /** From where ages count, and how far they may be off [s]. */
    from?: "simulator" | "console";
    within_s?: number | null;
  };
  workers: { draining: boolean };
  log: LogLine;
  /** The conductor cannot be reached. */
  gone: { error?: string };
}
export interface LogLine {
  at_s: number;
  level: string;
  text: string;
}
const NAMES = ["hello", "table", "picture", "workers", "log", "gone"] as const;

/** How the line stands: `files` never changes, `lost` is being mended. */
export type Line = "files" | "opening" | "open" | "lost";

type Hear<K extends keyof Events> = (data: Events[K]) => void;

class Live extends EventTarget {
  line: Line = STATIC ? "files" : "opening";
  /** Grows when all has to be read again: something was missed, or the server is another. */
  epoch = 0;
  /** Why the conductor is not reachable; empty: it is. */
  gone = "";
  private server = "";
  /** When the conductor said something, as far as the server knows; by this browser's clock [ms]. */
  private word = 0;
  private stream: EventSource | null = null;
  private last = "";
  private heard = 0;
  private tries = 0;
  private opening = 0;
  private started = false;
  /** Nobody sees the page: it has no stream, because browsers grant a server six in all. */
  private asleep = false;

  start(): void {
    if (STATIC || this.started) return;
    this.started = true;
    if (document.visibilityState === "hidden") this.asleep = true;
    else this.open();
    setInterval(() => this.look(), 1000);
    addEventListener("online", () => this.reopen());
    // A page that was frozen, or that the browser kept when somebody left it, had no timers.
    addEventListener("pageshow", () => this.look());
    document.addEventListener("resume", () => this.look());
    document.addEventListener("visibilitychange", () => {
      if (document.visibilityState === "hidden") this.sleep();
      else if (this.asleep) this.wake();
      else this.look();
    });
  }

  on<K extends keyof Events>(name: K, hear: Hear<K>): () => void {
    const listener = (event: Event): void => hear((event as CustomEvent<Events[K]>).detail);
    this.addEventListener(name, listener);
    return () => this.removeEventListener(name, listener);
  }

  private sleep(): void {
    this.asleep = true;
    clearTimeout(this.opening);
    this.stream?.close();
    this.stream = null;
  }

  private wake(): void {
    this.asleep = false;
    this.word = Date.now();
    this.open();
  }

  private open(): void {
    this.heard = Date.now();
    const stream = new EventSource(this.last ? `data/events?since=${encodeURIComponent(this.last)}` : "data/events");
    this.stream = stream;
    stream.onopen = () => this.hear(stream);
    stream.onerror = () => {
      if (this.stream !== stream) return;
      this.say("lost");
      this.again();
    };
    stream.addEventListener("beat", (event) => this.hear(stream, event));
    for (const name of NAMES) {
      stream.addEventListener(name, (event) => {
        this.hear(stream, event);
        this.take(name, (event as MessageEvent<string>).data);
      });
    }
  }

  private hear(stream: EventSource, event?: Event): void {
    if (this.stream !== stream) return;
    this.heard = Date.now();
    this.tries = 0;
    const id = event instanceof MessageEvent ? event.lastEventId : "";
    if (id) this.last = id;
    if (this.line === "lost") {
      forget();
      this.dispatchEvent(new Event("healed"));
    }
    this.say("open");
  }

  private take(name: (typeof NAMES)[number], text: string): void {
    const detail = JSON.parse(text) as Events[typeof name];
    if (name === "hello") {
      const { server, resync, conductor_age_s: age } = detail as Events["hello"];
      this.word = age === null ? 0 : Date.now() - age * 1000;
      if (resync || (this.server && server !== this.server)) {
        this.epoch++;
        forget();
        this.dispatchEvent(new Event("epoch"));
      }
      this.server = server;
    }
    if (name === "workers") this.word = Date.now();
    const gone = name === "gone" ? ((detail as Events["gone"]).error ?? "not reachable") : "";
    this.dispatchEvent(new CustomEvent(name, { detail }));
    if (name === "gone" || name === "workers") this.tell(gone);
  }

  /** A browser that slept, or a line that is cut without a word, gives no error. */
  private look(): void {
    if (this.asleep) return;
    if (this.stream !== null && Date.now() - this.heard > SILENCE_MS) this.reopen();
    else if (this.line === "open" && Date.now() - this.word > CONDUCTOR_MS && !this.gone) this.tell("no word from it");
  }

  private tell(gone: string): void {
    if (gone === this.gone) return;
    this.gone = gone;
    this.dispatchEvent(new Event("line"));
  }

  private again(): void {
    this.stream?.close();
    clearTimeout(this.opening);
    const pause = PAUSE_MS[Math.min(this.tries++, PAUSE_MS.length - 1)];
    this.heard = Date.now();
    this.opening = window.setTimeout(() => this.open(), pause);
  }

  private reopen(): void {
    if (this.stream === null) return;
    this.say("lost");
    this.tries = 0;
    this.again();
  }

  private say(line: Line): void {
    if (this.line === line) return;
    this.line = line;
    this.dispatchEvent(new Event("line"));
  }
}

export const live = new Live();
