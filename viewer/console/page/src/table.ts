// The table of a run: filter, order and groups. Nothing here knows the screen.
import type { Column, RunInfo, TableData, Value, VerdictKind } from "./data";
import { plain, titled } from "./words";

export const WORST = "worst";
/** Most values by which cases are grouped; the others are one group. */
export const GROUPS_MAX = 24;

export class Table {
  version: string;
  readonly cases: string[];
  private readonly values = new Map<string, Value[]>();
  private readonly indices = new Map<string, number>();
  private readonly haystacks: (string | undefined)[] = [];

  constructor(
    data: TableData,
    readonly columns: Column[],
    readonly kinds: Map<string, VerdictKind>,
  ) {
    this.version = data.version;
    this.cases = data.cases;
    for (const column of columns) {
      this.values.set(column.name, Object.hasOwn(data.columns, column.name) ? data.columns[column.name]! : []);
    }
    this.cases.forEach((name, index) => this.indices.set(name, index));
  }

  get size(): number {
    return this.cases.length;
  }

  column(name: string): Column | undefined {
    return this.columns.find((column) => column.name === name);
  }

  value(name: string, index: number): Value {
    return this.values.get(name)?.[index] ?? null;
  }

  verdict(index: number): string {
    return String(this.value("verdict", index) ?? this.value("state", index) ?? "waiting");
  }

  index(name: string): number {
    return this.indices.get(name) ?? -1;
  }

  /** Take in what changed. */
  change(version: string, rows: Record<string, Record<string, Value>>, added: string[]): void {
    this.version = version;
    for (const name of added) {
      if (this.indices.has(name)) continue;
      this.indices.set(name, this.cases.length);
      this.cases.push(name);
    }
    for (const [key, cells] of Object.entries(rows)) {
      const index = Number(key);
      if (!Number.isInteger(index) || index < 0 || index >= this.cases.length) continue;
      this.haystacks[index] = undefined;
      for (const [name, value] of Object.entries(cells)) {
        const column = this.values.get(name);
        if (column !== undefined) column[index] = value;
      }
    }
  }

  /** All that can be found of a case by a word, in small letters. */
  haystack(index: number): string {
    const kept = this.haystacks[index];
    if (kept !== undefined) return kept;
    const parts = [this.cases[index] ?? "", this.verdict(index), plain(this.verdict(index))];
    for (const column of this.columns) {
      if (column.kind === "axis" || column.kind === "text") {
        const value = this.value(column.name, index);
        if (value !== null) parts.push(String(value));
      }
    }
    return (this.haystacks[index] = parts.join("\n").toLowerCase());
  }

  /** How bad a case is: 0 is the worst verdict. */
  rank(index: number): number {
    return this.kinds.get(this.verdict(index))?.rank ?? 99;
  }

  /** Columns that say how bad a case is among those of its verdict. */
  severities(): Column[] {
    return this.columns.filter((column) => column.kind === "kpi" && column.better !== null);
  }
}

export interface Filter {
  matches: (index: number) => boolean;
  /** Why a part was not understood; empty: all was. */
  error: string;
}

const TOKEN = /-?(?:[\w.]+(?:<=|>=|!=|=|<|>))?"[^"]*"|\S+/g;
const RULE = /^([\w.]+)(<=|>=|!=|=|<|>)"?([^"]*)"?$/;

/** What `weather=heavy_fog impact_speed_mps>3 -clear` lets through. */
export function filter(table: Table, words: string): Filter {
  const rules: ((index: number) => boolean)[] = [];
  let error = "";
  for (const token of words.match(TOKEN) ?? []) {
    const not = token.startsWith("-") && token.length > 1;
    const word = not ? token.slice(1) : token;
    const rule = RULE.exec(word);
    const made = rule ? compared(table, rule[1]!, rule[2]!, rule[3]!) : found(table, word);
    if (typeof made === "string") error = made;
    else rules.push(not ? (index) => !made(index) : made);
  }
  return { matches: (index) => rules.every((rule) => rule(index)), error };
}

function found(table: Table, word: string): (index: number) => boolean {
  const text = word.replaceAll('"', "").toLowerCase();
  return (index) => table.haystack(index).includes(text);
}

function compared(table: Table, name: string, sign: string, wanted: string): ((index: number) => boolean) | string {
  if (table.column(name) === undefined) {
    const names = table.columns.map((column) => column.name).slice(0, 12).join(", ");
    return `There is no column “${name}”; some that there are: ${names}.`;
  }
  if (sign === "=" || sign === "!=") {
    const choices = wanted.split(",");
    return (index) => {
      const value = name === "verdict" ? table.verdict(index) : table.value(name, index);
      const same = choices.some((choice) => (value === null ? choice === "?" : String(value) === choice));
      return same === (sign === "=");
    };
  }
  const limit = Number(wanted);
  if (wanted === "" || Number.isNaN(limit)) return `“${name}${sign}” wants a number, as in ${name}${sign}3.`;
  const holds: Record<string, (value: number) => boolean> = {
    "<": (value) => value < limit,
    "<=": (value) => value <= limit,
    ">": (value) => value > limit,
    ">=": (value) => value >= limit,
  };
  const test = holds[sign]!;
  return (index) => {
    const value = table.value(name, index);
    return typeof value === "number" && test(value);
  };
}

type Compare = (a: number, b: number) => number;

function byColumn(table: Table, name: string, sign: number): Compare {
  return (a, b) => {
    const left = table.value(name, a);
    const right = table.value(name, b);
    if (left === null || right === null) return left === right ? 0 : left === null ? 1 : -1;
    if (typeof left === "number" && typeof right === "number") return sign * (left - right);
    const [one, two] = [String(left), String(right)];
    return sign * (one < two ? -1 : one > two ? 1 : 0);
  };
}

function worstFirst(table: Table): Compare {
  const next = table
    .severities()
    .map((column) => byColumn(table, column.name, column.better === "high" ? 1 : -1));
  const ranks = table.cases.map((_, index) => table.rank(index));
  return (a, b) => {
    const byRank = ranks[a]! - ranks[b]!;
    if (byRank !== 0) return byRank;
    for (const compare of next) {
      const order = compare(a, b);
      if (order !== 0) return order;
    }
    return 0;
  };
}

/** Indices of the cases that pass the filter, in the order of `sort`: `worst`, `case`, a column or `-` and a column. */
export function ordered(table: Table, matches: (index: number) => boolean, sort: string): number[] {
  const indices: number[] = [];
  for (let index = 0; index < table.size; index++) if (matches(index)) indices.push(index);
  const name = sort.replace(/^-/, "");
  const sign = sort.startsWith("-") ? -1 : 1;
  if (name === "case") return sign < 0 ? indices.reverse() : indices;
  const compare = name === WORST || table.column(name) === undefined ? worstFirst(table) : byColumn(table, name, sign);
  return indices.sort((a, b) => compare(a, b) || a - b);
}

export interface Group {
  /** Values of the one or two axes; a single group without axes has none. */
  at: string[];
  indices: number[];
}
export interface Groups {
  axes: string[];
  rows: string[];
  columns: string[];
  groups: Group[];
}

const OTHERS = "others";

function valuesOf(table: Table, info: RunInfo | null, name: string, order: number[]): string[] {
  const seen = new Set(order.map((index) => groupOf(table, name, index)));
  const axis = info?.axes.find((one) => one.name === name)?.values.map(String) ?? [];
  const known = axis.filter((value) => seen.has(value));
  const rest = [...seen].filter((value) => !axis.includes(value)).sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
  const all = [...known, ...rest];
  return all.length > GROUPS_MAX ? [...all.slice(0, GROUPS_MAX - 1), OTHERS] : all;
}

/** Cases by the values of at most two axes: the first goes across, the second down. */
export function grouped(table: Table, info: RunInfo | null, order: number[], axes: string[]): Groups {
  const [across, down] = axes;
  const columns = across === undefined ? [""] : valuesOf(table, info, across, order);
  const rows = down === undefined ? [""] : valuesOf(table, info, down, order);
  const groups = rows.flatMap((row) =>
    columns.map((column) => ({ at: [column, row], indices: [] as number[] })),
  );
  const column = new Map(columns.map((value, index) => [value, index]));
  const row = new Map(rows.map((value, index) => [value, index]));
  for (const index of order) {
    const x = across === undefined ? 0 : place(column, groupOf(table, across, index));
    const y = down === undefined ? 0 : place(row, groupOf(table, down, index));
    groups[y * columns.length + x]!.indices.push(index);
  }
  return { axes, rows, columns, groups };
}

const place = (places: Map<string, number>, value: string): number => places.get(value) ?? places.get(OTHERS) ?? 0;

const groupOf = (table: Table, name: string, index: number): string =>
  name === "verdict" ? table.verdict(index) : String(table.value(name, index) ?? "–");

/** What stands above a column: its title with its unit. */
export const headOf = (column: Column): string =>
  column.title ? `${column.title}${column.unit ? ` [${column.unit.replace("^2", "²")}]` : ""}` : titled(column.name);

/** Title of an axis by its name. */
export function axisTitle(info: RunInfo | null, name: string): string {
  const column = info?.columns.find((one) => one.name === name);
  return column === undefined ? titled(name) : headOf(column);
}

/** Axes and texts with few values: what cases can be grouped by. */
export function groupable(info: RunInfo | null): string[] {
  const axes = info?.axes.filter((axis) => axis.values.length > 1).map((axis) => axis.name) ?? [];
  return [...axes, "verdict"];
}

/** A table of some cases for a spreadsheet; texts that it would take for formulas are kept from it. */
export function csv(table: Table, indices: number[]): string {
  const names = ["case", "verdict", ...table.columns.map((column) => column.name).filter((name) => name !== "verdict")];
  const cell = (name: string, index: number): Value =>
    name === "case" ? table.cases[index]! : name === "verdict" ? table.verdict(index) : table.value(name, index);
  return asCsv(names, indices.map((index) => names.map((name) => cell(name, index))));
}

/** Rows below their names, as spreadsheets read them. */
export const asCsv = (names: string[], rows: Value[][]): string =>
  [names, ...rows].map((cells) => `${cells.map(quoted).join(",")}\r\n`).join("");

function quoted(value: Value): string {
  if (value === null) return "";
  if (typeof value !== "string") return String(value);
  const inert = /^[=+\-@\t\r]/.test(value) ? `'${value}` : value;
  return /[",\r\n]/.test(inert) ? `"${inert.replaceAll('"', '""')}"` : inert;
}
