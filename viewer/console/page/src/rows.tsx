// The wall as a table: only the rows and columns on the screen exist.
import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";
import { useSize } from "./hooks";
import { Chip } from "./parts";
import { requery } from "./route";
import { headOf, type Table } from "./table";
import { text } from "./words";

const ROW_PX = 30;
const MORE = 4;
/** Widths are given, so that other texts move nothing [px]. */
const CASE_PX = 300;
const VERDICT_PX = 150;
const WHY_PX = 380;
const COLUMN_PX = 150;
const FIXED_PX = CASE_PX + VERDICT_PX + WHY_PX;

interface Inputs {
  table: Table;
  order: number[];
  active: number;
  chosen: Set<number>;
  sort: string;
  onActive: (index: number) => void;
  onChoose: (indices: number[], how: "toggle" | "add") => void;
  onOpen: (index: number) => void;
}

export function Rows({ table, order, active, chosen, sort, onActive, onChoose, onOpen }: Inputs): JSX.Element {
  const [frame, width, height] = useSize<HTMLDivElement>();
  const [top, setTop] = useState(0);
  const [left, setLeft] = useState(0);
  const from = Math.max(0, Math.floor(top / ROW_PX) - MORE);
  const to = Math.min(order.length, Math.ceil((top + height) / ROW_PX) + 1 + MORE);
  const columns = table.columns.filter((column) => column.name !== "verdict" && column.name !== "reason" && column.name !== "state");
  const shown = (px: number): number => Math.min(columns.length, Math.max(0, Math.floor((px - FIXED_PX) / COLUMN_PX)));
  const [begin, end] = [shown(left - COLUMN_PX), Math.min(columns.length, shown(left + width) + 2)];
  const place = order.indexOf(active);
  // Whole rows and columns: a smaller move changes nothing of what exists.
  const onScroll = (): void => {
    setTop(Math.floor(frame.current!.scrollTop / ROW_PX) * ROW_PX);
    setLeft(Math.floor(frame.current!.scrollLeft / COLUMN_PX) * COLUMN_PX);
  };
  useEffect(() => frame.current?.scrollTo(0, 0), [sort]);
  const move = (event: KeyboardEvent): void => {
    const step = { ArrowDown: 1, ArrowUp: -1, PageDown: 20, PageUp: -20 }[event.key];
    if (event.key === "Enter" && active >= 0) return onOpen(active);
    if (event.key === " " && active >= 0) {
      event.preventDefault();
      return onChoose([active], "toggle");
    }
    if (step === undefined || event.target !== frame.current) return;
    event.preventDefault();
    const next = Math.min(order.length - 1, Math.max(0, place + step));
    onActive(order[next]!);
    const box = frame.current!;
    const y = next * ROW_PX;
    if (y < box.scrollTop) box.scrollTop = y;
    if (y + 2 * ROW_PX > box.scrollTop + box.clientHeight) box.scrollTop = y + 2 * ROW_PX - box.clientHeight;
  };
  return (
    <div ref={frame} class="rows" tabIndex={0} role="region" aria-label="Cases as rows; arrows move, Enter opens, space selects" onScroll={onScroll} onKeyDown={move}>
      <table aria-rowcount={order.length + 1} aria-colcount={columns.length + 3} style={{ width: `${FIXED_PX + columns.length * COLUMN_PX}px` }}>
        <colgroup>
          {[CASE_PX, VERDICT_PX, WHY_PX, ...columns.map(() => COLUMN_PX)].map((width, at) => (
            <col key={at} style={{ width: `${width}px` }} />
          ))}
        </colgroup>
        <thead>
          <tr aria-rowindex={1}>
            <Title name="case" title="case" sort={sort} />
            <Title name="verdict" title="verdict" sort={sort} />
            <th scope="col">why</th>
            {columns.map((column) => (
              <Title key={column.name} name={column.name} title={headOf(column)} sort={sort} />
            ))}
          </tr>
        </thead>
        <tbody>
          <tr class="pad" style={{ height: `${from * ROW_PX}px` }} aria-hidden="true" />
          {order.slice(from, to).map((index, at) => (
            // Elements stay where they are and get other texts, which is cheaper than other elements.
            <tr key={at} aria-rowindex={from + at + 2} class={`${index === active ? "active" : ""} ${chosen.has(index) ? "chosen" : ""}`} onClick={() => onActive(index)} onDblClick={() => onOpen(index)}>
              <th scope="row" title={table.cases[index]}>{table.cases[index]}</th>
              <td>
                <Chip verdict={table.verdict(index)} />
              </td>
              <td title={text(table.value("reason", index))}>{text(table.value("reason", index))}</td>
              {begin > 0 && <td key="before" colSpan={begin} />}
              {columns.slice(begin, end).map((column, at) => {
                const value = table.value(column.name, index);
                return (
                  <td key={begin + at} aria-colindex={begin + at + 4} class={typeof value === "number" ? "n" : ""}>
                    {text(value)}
                  </td>
                );
              })}
              {end < columns.length && <td key="after" colSpan={columns.length - end} />}
            </tr>
          ))}
          <tr class="pad" style={{ height: `${(order.length - to) * ROW_PX}px` }} aria-hidden="true" />
        </tbody>
      </table>
    </div>
  );
}

function Title({ name, title, sort }: { name: string; title: string; sort: string }): JSX.Element {
  const here = sort === name ? "ascending" : sort === `-${name}` ? "descending" : "none";
  return (
    <th scope="col" aria-sort={here}>
      <button type="button" onClick={() => requery({ sort: here === "ascending" ? `-${name}` : name })}>
        {title}
        {here === "ascending" ? " ↑" : here === "descending" ? " ↓" : ""}
      </button>
    </th>
  );
}
