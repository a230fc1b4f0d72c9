// Cases that are compared, as tables for a spreadsheet.
import { type CaseInfo, type Series, statusOf, type Value } from "./data";
import { asCsv } from "./table";

export interface Side {
  run: string;
  info: CaseInfo;
  series: Series | null;
}

/** A row per case: where it is from, its verdict and why, its axes and KPIs. */
export function kpisAsCsv(sides: Side[]): string {
  const axes = [...new Set(sides.flatMap(({ info }) => Object.keys(info.axes)))];
  const kpis = [...new Set(sides.flatMap(({ info }) => info.kpis.map((kpi) => kpi.name)))];
  const rows = sides.map(({ run, info }): Value[] => [
    run, info.case, statusOf(info), info.reasons.join("; "),
    ...axes.map((name) => info.axes[name] ?? null),
    ...kpis.map((name) => info.kpis.find((kpi) => kpi.name === name)?.value ?? null),
  ]);
  return asCsv(["run", "case", "verdict", "reasons", ...axes, ...kpis], rows);
}

const POSE = [["x_m", "x"], ["y_m", "y"], ["yaw_rad", "yaw"]] as const;

/** A row per tick of each case: sim time, pose of the ego, what is drawn over time. */
export function rowsAsCsv(sides: Side[]): string {
  const names = [...new Set(sides.flatMap(({ series }) => Object.keys(series?.series ?? {})))];
  const rows = sides.flatMap(({ run, info, series }) => {
    if (series === null) return [];
    const ego = series.actors.find((actor) => actor.kind === "ego");
    const columns = [
      ...POSE.map(([, axis]) => ego?.[axis] ?? []),
      ...names.map((name) => (Object.hasOwn(series.series, name) ? series.series[name]!.v : [])),
    ];
    return series.t.map((t, tick): Value[] => [run, info.case, t, ...columns.map((values) => values[tick] ?? null)]);
  });
  return asCsv(["run", "case", "sim_time_s", ...POSE.map(([name]) => name), ...names], rows);
}
