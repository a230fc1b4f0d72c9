// Plots, by the library that the report uses; it is loaded when a plot is first seen.
import type { JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Clock } from "./clock";
import type { Series } from "./data";
import { useSignal } from "./hooks";
import { color, colors } from "./theme";
import { called, capital } from "./words";

interface Axis {
  _offset: number;
  _length: number;
  l2p: (value: number) => number;
  p2l: (pixel: number) => number;
}
interface PlotElement extends HTMLDivElement {
  _fullLayout?: { xaxis?: Axis };
}
interface Plotly {
  react: (node: HTMLElement, data: unknown[], layout: unknown, config: unknown) => Promise<unknown>;
  purge: (node: HTMLElement) => void;
  Plots: { resize: (node: HTMLElement) => void };
}

let library: Promise<Plotly> | null = null;

function plotly(): Promise<Plotly> {
  library ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "plotly.js";
    script.onload = () => resolve((window as unknown as { Plotly: Plotly }).Plotly);
    script.onerror = () => {
      library = null;
      script.remove();
      reject(new Error("plotly.js is not part of this console"));
    };
    document.head.append(script);
  });
  return library;
}

const CONFIG = { displayModeBar: false, responsive: false, doubleClick: "reset" };

/** Colours of the page for a figure that somebody else has laid out. */
function themed(layout: Record<string, unknown>): Record<string, unknown> {
  const axes = Object.fromEntries(
    Object.entries(layout)
      .filter(([name]) => /^[xy]axis\d*$/.test(name))
      .map(([name, axis]) => [name, { ...(axis as object), gridcolor: color("grid"), linecolor: color("line"), zerolinecolor: color("line") }]),
  );
  return {
    ...layout,
    ...axes,
    paper_bgcolor: color("panel"),
    plot_bgcolor: color("panel"),
    font: { color: color("ink"), family: 'system-ui, "DejaVu Sans", sans-serif', size: 12 },
  };
}

interface Inputs {
  data: unknown[];
  layout: Record<string, unknown>;
  label: string;
  height: number;
  clock?: Clock | undefined;
}

/** One figure; with a clock, a line stands at its time, and a click moves it. */
export function Plot({ data, layout, label, height, clock }: Inputs): JSX.Element {
  const node = useRef<PlotElement>(null);
  const line = useRef<HTMLDivElement>(null);
  const [error, setError] = useState("");
  const theme = useSignal(colors, "change");
  const place = useRef(() => undefined as void);
  place.current = () => {
    const axis = node.current?._fullLayout?.xaxis;
    if (!axis || !line.current || clock === undefined) return;
    const pixel = axis.l2p(clock.t);
    line.current.hidden = pixel < 0 || pixel > axis._length;
    line.current.style.transform = `translateX(${axis._offset + pixel}px)`;
  };
  useEffect(() => {
    let over = false;
    plotly().then(
      async (api) => {
        if (over || node.current === null) return;
        await api.react(node.current, data, themed({ ...layout, height, autosize: true }), CONFIG);
        place.current();
      },
      (reason: unknown) => setError(String(reason instanceof Error ? reason.message : reason)),
    );
    return () => void (over = true);
  }, [data, layout, theme, height]);
  useEffect(() => {
    const element = node.current!;
    const observer = new ResizeObserver(() => {
      void library?.then((api) => {
        if (!element.isConnected || !element._fullLayout) return;
        api.Plots.resize(element);
        requestAnimationFrame(() => place.current());
      });
    });
    observer.observe(element);
    return () => {
      observer.disconnect();
      void library?.then((api) => api.purge(element));
    };
  }, []);
  useEffect(() => {
    if (clock === undefined) return;
    const hear = (): void => place.current();
    clock.addEventListener("t", hear);
    return () => clock.removeEventListener("t", hear);
  }, [clock]);
  const onClick = (event: MouseEvent): void => {
    const axis = node.current?._fullLayout?.xaxis;
    if (!axis || clock === undefined) return;
    const pixel = event.clientX - node.current!.getBoundingClientRect().left - axis._offset;
    if (pixel >= 0 && pixel <= axis._length) clock.to(axis.p2l(pixel));
  };
  if (error) return <p class="dim">{error}</p>;
  return (
    <div class="plot" role="img" aria-label={label}>
      <div ref={node} style={{ height: `${height}px` }} onClick={onClick} />
      {clock !== undefined && <div ref={line} class="cursor" hidden />}
    </div>
  );
}

const ROW_PX = 104;
/** Colours of cases that share their axes. */
const HUES = ["plot", "plot2", "plot3", "plot4"];

export interface Overlay {
  label: string;
  series: Series;
  dash: "solid" | "dash" | "dot";
  /** Which of the colours of plots; 0 is the first. */
  hue?: number;
}

/** Series over sim time, one below the other; two cases share their axes. */
export function SeriesPlots({ overlays, clock, marks }: {
  overlays: Overlay[];
  clock: Clock;
  marks: { t: number; what: string }[];
}): JSX.Element | null {
  const names = [...new Set(overlays.flatMap(({ series }) => Object.keys(series.series)))].filter((name) =>
    overlays.some(({ series }) => varies(series.series[name]?.v ?? [])),
  );
  const theme = useSignal(colors, "change");
  const made = useRef<{ key: string; data: unknown[]; layout: Record<string, unknown> } | null>(null);
  if (names.length === 0) return null;
  const key = `${theme} ${names.join()} ${overlays.map(({ label, series }) => `${label}${series.t.length}`).join()} ${marks.map((m) => m.t).join()}`;
  if (made.current?.key !== key) made.current = { key, ...figure(names, overlays, marks) };
  const { data, layout } = made.current;
  const label = `Over sim time: ${names.map((name) => titleOf(overlays, name)).join(", ")}`;
  return <Plot data={data} layout={layout} label={label} height={ROW_PX * names.length + 40} clock={clock} />;
}

/** Whether a series says something: a constant is no plot. */
function varies(values: (number | null)[]): boolean {
  const first = values.find((value) => value !== null);
  return first !== undefined && values.some((value) => value !== null && value !== first);
}

function figure(names: string[], overlays: Overlay[], marks: { t: number; what: string }[]): { data: unknown[]; layout: Record<string, unknown> } {
  const hues = HUES.map(color);
  const data = names.flatMap((name, row) =>
    overlays.flatMap(({ label, series, dash, hue }, at) => {
      const one = series.series[name];
      if (one === undefined) return [];
      return [{
        x: series.t, y: one.v, name: label, mode: "lines", connectgaps: false, xaxis: "x", yaxis: row ? `y${row + 1}` : "y",
        line: { color: hues[(hue ?? at) % hues.length], width: 1.6, dash }, showlegend: overlays.length > 1 && row === 0,
        hovertemplate: `%{x:.2f} s: %{y:.4g} ${one.unit.replaceAll("<", "").replaceAll("%", "")}<extra></extra>`,
      }];
    }),
  );
  const gap = 0.22 / names.length;
  const layout: Record<string, unknown> = {
    margin: { l: 52, r: 8, t: 8, b: 32 },
    xaxis: { title: { text: "sim time [s]", standoff: 4 }, anchor: names.length > 1 ? `y${names.length}` : "y", fixedrange: false },
    legend: { orientation: "h", y: 1, yanchor: "bottom", x: 0 },
    hovermode: "x",
    shapes: marks.map((mark) => ({
      type: "line", xref: "x", yref: "paper", x0: mark.t, x1: mark.t, y0: 0, y1: 1, line: { color: "#888888", width: 1, dash: "dot" },
    })),
    annotations: names.map((name, row) => ({
      text: `${titleOf(overlays, name)}${unitOf(overlays, name)}`, showarrow: false, xref: "paper", yref: "paper",
      x: 0, y: 1 - row / names.length - 0.02 / names.length, xanchor: "left", yanchor: "top", font: { size: 12 },
    })),
  };
  names.forEach((name, row) => {
    const top = 1 - row / names.length;
    layout[row ? `yaxis${row + 1}` : "yaxis"] = {
      ...rangeOf(name, overlays),
      domain: [Math.max(0, top - 1 / names.length + gap / 2), top - gap], fixedrange: true, nticks: 4, zeroline: false,
    };
  });
  return { data, layout };
}

/** Times to a collision that are longer say nothing, and hide those that do [s]. */
const TTC_SHOWN_S = 10;

/** The range of a plot where not all of its values are worth seeing. */
function rangeOf(name: string, overlays: Overlay[]): { range?: [number, number] } {
  if (!name.includes("ttc")) return {};
  const values = overlays.flatMap(({ series }) => series.series[name]?.v ?? []).filter((value) => value !== null);
  const [least, most] = [Math.min(...values), Math.max(...values)];
  return most <= TTC_SHOWN_S ? {} : { range: [0, Math.max(TTC_SHOWN_S, 1.5 * least)] };
}

const titleOf = (overlays: Overlay[], name: string): string =>
  capital(overlays.map(({ series }) => series.series[name]?.title).find(Boolean) ?? called(name).title).replace(/ ?\[[^\]]*\]$/, "").replaceAll("<", "");

function unitOf(overlays: Overlay[], name: string): string {
  const unit = overlays.map(({ series }) => series.series[name]?.unit).find(Boolean) ?? called(name).unit;
  return unit ? ` [${unit.replaceAll("<", "").replace("^2", "²")}]` : "";
}
