// The camera's film, with what the stack detected.
import { Fragment, type JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { type Clock, indexAt } from "./clock";
import { type Atlas, type Box, type CaseInfo, file, type Film, type Series } from "./data";
import { Picture } from "./details";
import { useData } from "./hooks";

/** Width in which a film is drawn, so that boxes and their names are sharp whatever was recorded [px]. */
const SHOWN_PX = 960;
const FONT_PX = 20;
/** Narrower boxes have no name [px]. */
const NAMED_PX = 90;
/** Strips that are kept. */
const KEPT_MAX = 8;

const SWATCHES = [["detected", "seen by the stack"], ["truth", "really there"], ["trigger", "why it braked"]] as const;

class Strips {
  private readonly kept = new Map<number, HTMLImageElement | null>();

  constructor(
    private readonly base: string,
    private readonly count: number,
    private readonly changed: () => void,
  ) {}

  /** The strip, if it is there; it is asked for, and so is the next one. */
  get(strip: number): HTMLImageElement | null {
    this.ask(strip + 1);
    return this.ask(strip);
  }

  private ask(strip: number): HTMLImageElement | null {
    if (strip < 0 || strip >= this.count) return null;
    const kept = this.kept.get(strip);
    if (kept !== undefined) return kept;
    this.kept.set(strip, null);
    const image = new Image();
    image.src = file(`${this.base}/film/${strip}.webp`);
    image.decode().then(
      () => {
        this.kept.set(strip, image);
        for (const old of [...this.kept.keys()].slice(0, -KEPT_MAX)) this.kept.delete(old);
        this.changed();
      },
      () => setTimeout(() => this.kept.delete(strip), 2000),
    );
    return null;
  }
}

interface Inputs {
  run: string;
  info: CaseInfo;
  series: Series | null;
  clock: Clock;
  label: string;
}

export function FilmView(inputs: Inputs): JSX.Element {
  const { run, info } = inputs;
  const { film } = info;
  if (film === null) {
    return (
      <figure class="film">
        <KnownPicture run={run} info={info} />
        <figcaption class="dim">
          {info.away ? "No film: the files of the campaign are not here." : "No film: the case was not recorded (run it with --view record)."}
        </figcaption>
      </figure>
    );
  }
  return <StripFilm {...inputs} film={film} />;
}

/** The moment of a case without a film, if a picture of it came while it ran. */
function KnownPicture({ run, info }: { run: string; info: CaseInfo }): JSX.Element | null {
  const atlas = useData<Atlas>(`runs/${run}/pictures/atlas.json`);
  return atlas.data?.has[info.index] ? <Picture run={run} name={info.case} version={undefined} /> : null;
}

/** Frame of the film that stands at a sim time. */
const frameAt = (film: Film, t: number): number =>
  Math.min(film.frames - 1, Math.max(0, Math.floor((t - film.first_t) * film.fps + 1e-6)));

function StripFilm({ run, info, series, clock, film, label }: Inputs & { film: Film }): JSX.Element {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [boxes, setBoxes] = useState(true);
  const showBoxes = useRef(boxes);
  showBoxes.current = boxes;
  const drawn = useRef<() => void>(() => undefined);
  useEffect(() => {
    const per = film.per_strip;
    const strips = new Strips(`runs/${run}/cases/${info.case}`, film.strips, () => drawn.current());
    const times = series?.detections.map((one) => one.t) ?? [];
    const [width, height] = film.size;
    const draw = (): void => {
      const context = canvas.current?.getContext("2d");
      if (!context) return;
      const frame = frameAt(film, clock.t);
      const strip = strips.get(Math.floor(frame / per));
      const { width: wide, height: high } = canvas.current!;
      if (strip !== null) context.drawImage(strip, (frame % per) * width, 0, width, height, 0, 0, wide, high);
      canvas.current!.dataset.frame = strip === null ? "" : String(frame);
      const index = indexAt(times, clock.t);
      if (showBoxes.current && index >= 0) paintDetections(context, film, series!.detections[index]!);
    };
    drawn.current = draw;
    draw();
    clock.addEventListener("t", draw);
    return () => clock.removeEventListener("t", draw);
  }, [film, clock, series, run, info.case]);
  useEffect(() => drawn.current(), [boxes]);
  return (
    <figure class="film">
      <canvas ref={canvas} width={SHOWN_PX} height={Math.round((SHOWN_PX * film.size[1]) / film.size[0])} role="img" aria-label={`Camera film of ${label}`} />
      <figcaption>
        <label>
          <input type="checkbox" checked={boxes} onChange={() => setBoxes(!boxes)} /> detections
        </label>
        {boxes && (
          <span class="dim">
            {SWATCHES.map(([kind, words]) => (
              <Fragment key={kind}>
                {" "}
                <span class="swatched">
                  <i class={`swatch ${kind}`} aria-hidden="true" /> {words}
                </span>
              </Fragment>
            ))}
          </span>
        )}
      </figcaption>
    </figure>
  );
}

function paintDetections(context: CanvasRenderingContext2D, film: Film, seen: Series["detections"][number]): void {
  const scale = SHOWN_PX / (film.picture ?? film.size)[0];
  context.font = `${FONT_PX}px system-ui, "DejaVu Sans", sans-serif`;
  context.textBaseline = "bottom";
  for (const box of seen.truth) paintBox(context, box, scale, "#35e0ff", 1, "");
  // The name of a small box would hide what is beside it.
  for (const box of seen.boxes) paintBox(context, box, scale, "#ff9f1c", 2, box.w * scale < NAMED_PX ? "" : box.label);
  if (seen.trigger !== null) paintBox(context, seen.trigger, scale, "#ffe600", 4, `${seen.trigger.label} trigger`);
}

function paintBox(context: CanvasRenderingContext2D, box: Box, scale: number, style: string, thick: number, words: string): void {
  const [x, y] = [box.x * scale, box.y * scale];
  context.strokeStyle = style;
  context.lineWidth = thick;
  context.strokeRect(x, y, box.w * scale, box.h * scale);
  if (!words) return;
  const wide = context.measureText(words).width + 6;
  const line = FONT_PX + 5;
  context.fillStyle = "#000000b8";
  context.fillRect(x, Math.max(0, y - line), wide, line);
  context.fillStyle = "#ffffff";
  context.fillText(words, x + 3, Math.max(line, y));
}
