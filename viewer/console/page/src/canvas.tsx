// The wall's canvas: scrolling, pointer and keyboard.
import type { JSX } from "preact";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { useSignal } from "./hooks";
import { caseAt, cornerOf, first, type Layout, type Spot, spotAt, spotOf, stepped } from "./layout";
import { paint } from "./paint";
import { wordsOf } from "./parts";
import type { Table } from "./table";
import { colors } from "./theme";
import type { Thumbs } from "./thumbs";
import { text } from "./words";

interface Inputs {
  layout: Layout;
  table: Table;
  thumbs: Thumbs;
  /** Grows when tiles have to be drawn anew. */
  version: number;
  active: number;
  chosen: Set<number>;
  onActive: (index: number) => void;
  onChoose: (indices: number[], how: "toggle" | "add") => void;
  onOpen: (index: number) => void;
  onZoom: (factor: number) => void;
  frame: { current: HTMLDivElement | null };
  width: number;
  height: number;
  /** Somebody chose the size of tiles. */
  zoomed: boolean;
}

const MOVES = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"];

export function Canvas(inputs: Inputs): JSX.Element {
  const { layout, table, thumbs, version, active, chosen, frame, width, height } = inputs;
  const canvas = useRef<HTMLCanvasElement>(null);
  const newest = useRef(inputs);
  newest.current = inputs;
  const asked = useRef(0);
  const [focused, setFocused] = useState(false);
  const theme = useSignal(colors, "change");
  const spot = active < 0 ? null : spotOf(layout, active);
  const spotNow = useRef<Spot | null>(spot);
  spotNow.current = spot;

  const draw = useRef(() => {
    if (asked.current) return;
    asked.current = requestAnimationFrame(() => {
      asked.current = 0;
      const box = frame.current;
      const context = canvas.current?.getContext("2d", { alpha: false });
      if (!box || !context) return;
      const now = newest.current;
      const ratio = Math.min(2, devicePixelRatio);
      const scene = {
        layout: now.layout, table: now.table, thumbs: now.thumbs, chosen: now.chosen, spot: spotNow.current,
        focused: document.activeElement === box, left: box.scrollLeft, top: box.scrollTop,
        width: now.width, height: now.height,
      };
      const tiles = paint(context, scene, ratio);
      canvas.current!.dataset.tiles = String(tiles);
      box.dataset.loading = String(now.thumbs.atlas === null ? "…" : now.thumbs.missing);
    });
  });
  useLayoutEffect(() => {
    const node = canvas.current!;
    const ratio = Math.min(2, devicePixelRatio);
    node.width = Math.max(1, Math.round(width * ratio));
    node.height = Math.max(1, Math.round(height * ratio));
    draw.current();
  }, [width, height]);
  useEffect(() => draw.current(), [layout, table, thumbs, version, active, chosen, focused, theme]);
  useEffect(() => () => cancelAnimationFrame(asked.current), []);

  // The tile in the middle stays there when tiles become larger or smaller; a wall that nobody has moved stands at its begin.
  const middle = useRef<{ index: number; layout: Layout } | null>(null);
  useLayoutEffect(() => {
    const box = frame.current!;
    const before = middle.current;
    const moved = inputs.zoomed || active >= 0 || box.scrollLeft > 0 || box.scrollTop > 0;
    if (moved && before !== null && before.layout !== layout && before.layout.tile !== layout.tile) {
      const there = spotOf(layout, active >= 0 && spot !== null ? active : before.index);
      if (there !== null) {
        const [x, y] = cornerOf(layout, there);
        box.scrollTo(x - box.clientWidth / 2, y - box.clientHeight / 2);
      }
    }
    const seen = spotAt(layout, box.scrollLeft + box.clientWidth / 2, box.scrollTop + box.clientHeight / 2);
    middle.current = { index: seen === null ? -1 : caseAt(layout, seen), layout };
  }, [layout]);

  const onScroll = (): void => {
    const box = frame.current!;
    const seen = spotAt(layout, box.scrollLeft + box.clientWidth / 2, box.scrollTop + box.clientHeight / 2);
    if (seen !== null) middle.current = { index: caseAt(layout, seen), layout };
    draw.current();
  };

  const show = (at: Spot): void => {
    const box = frame.current!;
    const [x, y] = cornerOf(layout, at);
    if (y - layout.head < box.scrollTop) box.scrollTop = y - layout.head - 8;
    if (y + layout.tileHeight > box.scrollTop + box.clientHeight) {
      box.scrollTop = y + layout.tileHeight - box.clientHeight + 8;
    }
    if (x - layout.side < box.scrollLeft) box.scrollLeft = x - layout.side - 8;
    if (x + layout.tile > box.scrollLeft + box.clientWidth) box.scrollLeft = x + layout.tile - box.clientWidth + 8;
  };

  const under = (event: MouseEvent): Spot | null => {
    const box = frame.current!;
    const edge = box.getBoundingClientRect();
    const [x, y] = [event.clientX - edge.left, event.clientY - edge.top];
    if (x < layout.side || y < layout.head) return null;
    return spotAt(layout, x + box.scrollLeft, y + box.scrollTop);
  };

  const onClick = (event: MouseEvent): void => {
    const at = under(event);
    if (at === null) return;
    const index = caseAt(layout, at);
    if (event.shiftKey && spot !== null && spot.cell === at.cell) {
      const [from, to] = [Math.min(spot.place, at.place), Math.max(spot.place, at.place)];
      inputs.onChoose(layout.cells[at.cell]!.indices.slice(from, to + 1), "add");
    } else if (event.ctrlKey || event.metaKey) inputs.onChoose([index], "toggle");
    inputs.onActive(index);
  };

  const onKeyDown = (event: KeyboardEvent): void => {
    const key = event.key;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (MOVES.includes(key)) {
      const to = spot === null ? first(layout) : stepped(layout, spot, key);
      if (to === null) return;
      if (event.shiftKey && spot !== null) inputs.onChoose([caseAt(layout, spot), caseAt(layout, to)], "add");
      inputs.onActive(caseAt(layout, to));
      show(to);
    } else if (key === "Enter" && active >= 0) inputs.onOpen(active);
    else if (key === " " && active >= 0) inputs.onChoose([active], "toggle");
    else if (key === "+" || key === "=") inputs.onZoom(1.25);
    else if (key === "-") inputs.onZoom(0.8);
    else return;
    event.preventDefault();
  };

  useEffect(() => {
    const box = frame.current!;
    const onWheel = (event: WheelEvent): void => {
      if (!event.ctrlKey) return; // this is a pinch on touchpads, too
      event.preventDefault();
      newest.current.onZoom(Math.exp(-event.deltaY / 300));
    };
    box.addEventListener("wheel", onWheel, { passive: false });
    return () => box.removeEventListener("wheel", onWheel);
  }, []);

  const words =
    active < 0 ? "" : `${table.cases[active]}, ${wordsOf(table.verdict(active))}, ${text(table.value("reason", active))}`;
  return (
    <div
      ref={frame}
      class="frame"
      tabIndex={0}
      role="listbox"
      aria-label={`Wall of ${layout.count} cases; arrows move, Enter opens, space selects`}
      aria-multiselectable="true"
      aria-activedescendant={spot === null ? undefined : "active-tile"}
      onScroll={onScroll}
      onClick={onClick}
      onDblClick={(event) => under(event) !== null && active >= 0 && inputs.onOpen(active)}
      onKeyDown={onKeyDown}
      onFocus={() => setFocused(true)}
      onBlur={() => setFocused(false)}
    >
      <canvas ref={canvas} style={{ width: `${width}px`, height: `${height}px` }} aria-hidden="true" />
      <div class="extent" style={{ width: `${layout.width}px`, height: `${Math.max(1, layout.height - height)}px` }} aria-hidden="true" />
      <div
        id="active-tile"
        role="option"
        class="away"
        aria-selected={chosen.has(active)}
        aria-setsize={layout.count}
        aria-posinset={spot === null ? 1 : placeOf(layout, spot)}
      >
        {words || "no case"}
      </div>
    </div>
  );
}

const placeOf = (layout: Layout, spot: Spot): number =>
  layout.cells.slice(0, spot.cell).reduce((sum, cell) => sum + cell.indices.length, 0) + spot.place + 1;
