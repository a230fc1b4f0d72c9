// The case from above: road, bodies, where they were and will be.
import type { JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { type Clock, indexAt, useTime } from "./clock";
import type { Actor, Hull, Line, Series } from "./data";
import { useSignal, useSize } from "./hooks";
import { color, colors } from "./theme";
import { number, text } from "./words";

/** Length of road that is seen while the view follows the ego [m]. */
const FOLLOW_M = 70;
/** Nothing on the road is smaller on the screen [px]. */
const BODY_PX_MIN = 5;
/** Sizes of bodies that nothing says [m]. */
const EGO_M: [number, number] = [4.5, 1.9];
const BODY_M: [number, number] = [1, 1];
const HUES = ["#56B4E9", "#E69F00", "#CC79A7", "#3DB58F", "#D55E00", "#9AA7B8"];

interface View {
  scale: number;
  /** Point of the world in the middle [m]. */
  x: number;
  y: number;
  width: number;
  height: number;
}

const egoOf = (series: Series): Actor | undefined =>
  series.actors.find((actor) => actor.kind === "ego") ?? series.actors[0];

/** A view in which all places of the actors lie. */
function wholeOf(series: Series, width: number, height: number): View {
  let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const actor of series.actors) {
    for (let at = 0; at < actor.x.length; at++) {
      const [x, y] = [actor.x[at], actor.y[at]];
      if (x === null || x === undefined || y === null || y === undefined) continue;
      [left, right] = [Math.min(left, x), Math.max(right, x)];
      [low, high] = [Math.min(low, y), Math.max(high, y)];
    }
  }
  if (left > right) return { scale: 5, x: 0, y: 0, width, height };
  const scale = Math.min(width / (right - left + 14), height / (high - low + 12), 30);
  return { scale, x: (left + right) / 2, y: (low + high) / 2, width, height };
}

export function TopView({ series, clock, label }: { series: Series; clock: Clock; label: string }): JSX.Element {
  const [frame, width, height] = useSize<HTMLDivElement>();
  const canvas = useRef<HTMLCanvasElement>(null);
  const [follow, setFollow] = useState(true);
  const theme = useSignal(colors, "change");
  const t = useTime(clock, 250);
  useEffect(() => {
    const node = canvas.current;
    const context = node?.getContext("2d");
    if (!node || !context || !width || !height) return;
    const ratio = Math.min(2, devicePixelRatio);
    node.width = Math.round(width * ratio);
    node.height = Math.round(height * ratio);
    const ink = { paper: color("panel"), line: color("line"), dim: color("dim"), ink: color("ink"), road: color("road") };
    const whole = wholeOf(series, width, height);
    const draw = (): void => {
      const at = Math.max(0, indexAt(series.t, clock.t));
      const ego = egoOf(series);
      const [x, y] = [ego?.x[at], ego?.y[at]];
      const view = follow && typeof x === "number" && typeof y === "number" ? { ...whole, scale: width / FOLLOW_M, x: x + FOLLOW_M * 0.22, y } : whole;
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      context.fillStyle = ink.paper;
      context.fillRect(0, 0, width, height);
      paintLines(context, view, series.road?.lines ?? [], ink.road, 1);
      for (const hull of series.road?.hulls ?? []) paintHull(context, view, hull, ink.line, ink.dim);
      const labels: Label[] = [];
      series.actors.forEach((actor, number) => paintActor(context, view, actor, number, at, ego === actor, ink.ink, labels));
      for (const hull of series.road?.hulls ?? []) if (hull.kind === "obstacle") labels.push(labelOf(view, hull));
      paintLabels(context, labels, ink.ink);
      paintScale(context, view, ink.dim);
    };
    draw();
    clock.addEventListener("t", draw);
    return () => clock.removeEventListener("t", draw);
  }, [series, clock, width, height, follow, theme]);
  return (
    <figure class="top">
      <div ref={frame} class="topframe">
        <canvas ref={canvas} style={{ width: `${width}px`, height: `${height}px` }} role="img" aria-label={`${label} from above. ${situation(series, t)}`} />
      </div>
      <figcaption>
        <label>
          <input type="checkbox" checked={follow} onChange={() => setFollow(!follow)} /> follow the ego
        </label>
      </figcaption>
    </figure>
  );
}

/** Where the ego is and who is nearest, in words. */
function situation(series: Series, t: number): string {
  const at = Math.max(0, indexAt(series.t, t));
  const ego = egoOf(series);
  const [x, y] = [ego?.x[at] ?? null, ego?.y[at] ?? null];
  if (x === null || y === null) return "";
  let nearest = "";
  let least = Infinity;
  for (const actor of series.actors) {
    const [ax, ay] = [actor.x[at] ?? null, actor.y[at] ?? null];
    if (actor === ego || ax === null || ay === null) continue;
    const distance = Math.hypot(ax - x, ay - y);
    if (distance < least) [least, nearest] = [distance, actor.name];
  }
  const place = `At ${number(Math.round(t * 10) / 10)} s the ego is at x ${text(Math.round(x))} m, y ${text(Math.round(y))} m`;
  for (const hull of series.road?.hulls ?? []) {
    const distance = Math.hypot(hull.x - x, hull.y - y);
    if (hull.kind !== "building" && distance < least) [least, nearest] = [distance, `${hull.kind === "obstacle" ? "the obstacle" : "a parked car"}`];
  }
  return nearest ? `${place}; nearest is ${nearest}, ${number(Math.round(least))} m from middle to middle.` : `${place}.`;
}

const toScreen = (view: View, x: number, y: number): [number, number] => [
  view.width / 2 + (x - view.x) * view.scale,
  view.height / 2 - (y - view.y) * view.scale,
];

function paintLines(context: CanvasRenderingContext2D, view: View, lines: Line[], style: string, width: number): void {
  context.strokeStyle = style;
  context.lineWidth = width;
  context.beginPath();
  for (const line of lines) {
    line.forEach(([x, y], at) => {
      const [left, top] = toScreen(view, x, y);
      if (at) context.lineTo(left, top);
      else context.moveTo(left, top);
    });
  }
  context.stroke();
}

/** What stands: obstacle, parked cars, buildings. */
function paintHull(context: CanvasRenderingContext2D, view: View, hull: Hull, fill: string, edge: string): void {
  const [left, top] = toScreen(view, hull.x, hull.y);
  const [long, wide] = [hull.size[0] * view.scale, hull.size[1] * view.scale];
  context.save();
  context.translate(left, top);
  context.rotate(-hull.yaw);
  context.fillStyle = hull.kind === "obstacle" ? "#D55E00" : fill;
  context.strokeStyle = edge;
  context.lineWidth = 1;
  context.fillRect(-long / 2, -wide / 2, long, wide);
  context.strokeRect(-long / 2, -wide / 2, long, wide);
  context.restore();
}

function paintTrail(context: CanvasRenderingContext2D, view: View, actor: Actor, from: number, to: number): void {
  context.beginPath();
  let up = true;
  for (let at = from; at <= to; at++) {
    const [x, y] = [actor.x[at] ?? null, actor.y[at] ?? null];
    if (x === null || y === null) {
      up = true;
      continue;
    }
    const [left, top] = toScreen(view, x, y);
    if (up) context.moveTo(left, top);
    else context.lineTo(left, top);
    up = false;
  }
  context.stroke();
}

function paintActor(
  context: CanvasRenderingContext2D, view: View, actor: Actor, number: number, at: number, isEgo: boolean, ink: string, labels: Label[],
): void {
  const fill = isEgo ? "#F0C419" : HUES[number % HUES.length]!;
  const count = actor.x.length;
  if (count > 1) {
    context.strokeStyle = fill;
    context.globalAlpha = 0.35;
    context.lineWidth = 1.5;
    paintTrail(context, view, actor, at, count - 1);
    context.globalAlpha = 1;
    context.lineWidth = 2.5;
    paintTrail(context, view, actor, 0, at);
  }
  // What stands for the whole case may have one place only.
  const now = count === 1 ? 0 : at;
  const [x, y, yaw] = [actor.x[now] ?? null, actor.y[now] ?? null, actor.yaw[now] ?? 0];
  if (x === null || y === null) return;
  const [left, top] = toScreen(view, x, y);
  const size = actor.size ?? (isEgo ? EGO_M : BODY_M);
  const long = Math.max(BODY_PX_MIN, size[0] * view.scale);
  const wide = Math.max(BODY_PX_MIN, size[1] * view.scale);
  context.save();
  context.translate(left, top);
  context.rotate(-(yaw ?? 0));
  context.translate((actor.center?.[0] ?? 0) * view.scale, -(actor.center?.[1] ?? 0) * view.scale);
  context.fillStyle = fill;
  context.strokeStyle = ink;
  context.lineWidth = isEgo ? 2 : 1;
  context.beginPath();
  context.rect(-long / 2, -wide / 2, long, wide);
  context.fill();
  context.stroke();
  context.beginPath();
  context.moveTo(long / 2, 0);
  context.lineTo(long / 2 - Math.min(long * 0.3, wide), -wide / 2);
  context.lineTo(long / 2 - Math.min(long * 0.3, wide), wide / 2);
  context.closePath();
  context.fillStyle = ink;
  context.globalAlpha = 0.55;
  context.fill();
  context.restore();
  labels.push({ words: isEgo ? "ego" : actor.name, x: left, y: top - Math.max(wide, 8) / 2 - 4 });
}

interface Label {
  words: string;
  x: number;
  y: number;
}

function labelOf(view: View, hull: Hull): Label {
  const [x, y] = toScreen(view, hull.x, hull.y);
  return { words: "obstacle", x, y: y - (hull.size[1] * view.scale) / 2 - 4 };
}

/** Names of bodies; one that would stand on another is left out. */
function paintLabels(context: CanvasRenderingContext2D, labels: Label[], ink: string): void {
  context.fillStyle = ink;
  context.font = '11px system-ui, "DejaVu Sans", sans-serif';
  context.textAlign = "center";
  context.textBaseline = "bottom";
  const placed: { x: number; y: number; half: number }[] = [];
  for (const { words, x, y } of labels) {
    const half = context.measureText(words).width / 2 + 2;
    if (placed.some((one) => Math.abs(one.y - y) < 12 && Math.abs(one.x - x) < one.half + half)) continue;
    placed.push({ x, y, half });
    context.fillText(words, x, y);
  }
}

function paintScale(context: CanvasRenderingContext2D, view: View, style: string): void {
  const length = [1, 2, 5, 10, 20, 50, 100, 200, 500].findLast((m) => m * view.scale <= view.width / 4) ?? 1;
  const [left, top] = [12, view.height - 12];
  context.strokeStyle = style;
  context.fillStyle = style;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(left, top - 4);
  context.lineTo(left, top);
  context.lineTo(left + length * view.scale, top);
  context.lineTo(left + length * view.scale, top - 4);
  context.stroke();
  context.font = '11px system-ui, "DejaVu Sans", sans-serif';
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillText(`${length} m`, left + 4, top - 3);
}
