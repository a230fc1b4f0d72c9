// Where the tiles of a wall lie. Nothing here draws.
import type { Groups } from "./table";

/** Widths of tiles [px]: from dots, of which ten thousand fill a screen, to some twenty pictures. */
export const TILE_MIN = 5;
export const TILE_MAX = 480;
/** Narrower tiles are dots without a picture [px]. */
export const PICTURE_MIN = 26;

const HEAD_PX = 24;
const STRIP_PX = 20;
/** Least width of the names of rows [px]; long ones take up to a third of the screen, because rows differ in their middle as well. */
const SIDE_PX = 130;
const LETTER_PX = 7.6;
const CELL_GAP_PX = 10;

export interface Cell {
  x: number;
  y: number;
  width: number;
  height: number;
  /** Left and upper edge of its first tile. */
  tileX: number;
  tileY: number;
  perRow: number;
  row: number;
  column: number;
  indices: number[];
}

export interface Layout {
  tile: number;
  tileHeight: number;
  stepX: number;
  stepY: number;
  width: number;
  height: number;
  cells: Cell[];
  groups: Groups;
  /** Height of the names of columns, width of the names of rows; 0: there are none. */
  head: number;
  side: number;
  /** Where each shown case lies in reading order: cell and place in it. */
  count: number;
}

const gapOf = (tile: number): number => (tile < 12 ? 1 : tile < PICTURE_MIN ? 2 : tile < 120 ? 3 : 6);

/** Height of a tile [px]: dots are squares, pictures are 16:9. */
export const heightOf = (tile: number): number => (tile < PICTURE_MIN ? tile : Math.round((tile * 9) / 16));

function sideOf(groups: Groups, screen: number): number {
  const wanted = groups.rows.reduce((most, name) => Math.max(most, name.length), 0) * LETTER_PX + 14;
  return Math.round(Math.max(Math.min(SIDE_PX, screen * 0.22), Math.min(wanted, screen / 3)));
}

/** Lay out `groups` for a screen `screen` px wide, with tiles `tile` px wide. */
export function layOut(groups: Groups, screen: number, tile: number): Layout {
  const gap = gapOf(tile);
  const tileHeight = heightOf(tile);
  const [stepX, stepY] = [tile + gap, tileHeight + gap];
  const flat = groups.axes.length === 0;
  const head = groups.axes.length > 0 ? HEAD_PX : 0;
  const side = groups.axes.length > 1 ? sideOf(groups, screen) : 0;
  const strip = flat ? 0 : STRIP_PX;
  const space = flat ? 0 : CELL_GAP_PX;
  const room = screen - side;
  const width = Math.max(flat ? room : Math.max(stepX + space, 64), Math.floor(room / groups.columns.length));
  const perRow = Math.max(1, Math.floor((width - space + gap) / stepX));
  const cells: Cell[] = [];
  let y = head;
  groups.rows.forEach((_, row) => {
    const line = groups.groups.slice(row * groups.columns.length, (row + 1) * groups.columns.length);
    const most = Math.max(1, ...line.map((group) => Math.ceil(group.indices.length / perRow)));
    const height = strip + most * stepY + space;
    line.forEach((group, column) => {
      const x = side + column * width;
      cells.push({ x, y, width, height, tileX: x + space / 2, tileY: y + strip, perRow, row, column, indices: group.indices });
    });
    y += height;
  });
  const count = groups.groups.reduce((sum, group) => sum + group.indices.length, 0);
  const wide = side + width * groups.columns.length;
  return { tile, tileHeight, stepX, stepY, width: wide, height: y, cells, groups, head, side, count };
}

/** The largest tile with which all lie within the screen [px]. */
export function fitting(groups: Groups, width: number, height: number): number {
  let [low, high] = [TILE_MIN, TILE_MAX];
  while (high - low > 0.5) {
    const middle = (low + high) / 2;
    const layout = layOut(groups, width, Math.floor(middle));
    if (layout.height <= height && layout.width <= width) low = middle;
    else high = middle;
  }
  return Math.floor(low);
}

export interface Spot {
  cell: number;
  place: number;
}

/** The tile at a point of the wall; null: there is none. */
export function spotAt(layout: Layout, x: number, y: number): Spot | null {
  for (const [number, cell] of layout.cells.entries()) {
    if (x < cell.tileX || y < cell.tileY || x >= cell.x + cell.width || y >= cell.y + cell.height) continue;
    const column = Math.floor((x - cell.tileX) / layout.stepX);
    const place = Math.floor((y - cell.tileY) / layout.stepY) * cell.perRow + column;
    return column < cell.perRow && place < cell.indices.length ? { cell: number, place } : null;
  }
  return null;
}

/** Left and upper edge of a tile. */
export function cornerOf(layout: Layout, spot: Spot): [number, number] {
  const cell = layout.cells[spot.cell]!;
  const column = spot.place % cell.perRow;
  return [cell.tileX + column * layout.stepX, cell.tileY + Math.floor(spot.place / cell.perRow) * layout.stepY];
}

/** Where a case lies; null: it is not shown. */
export function spotOf(layout: Layout, index: number): Spot | null {
  for (const [cell, { indices }] of layout.cells.entries()) {
    const place = indices.indexOf(index);
    if (place >= 0) return { cell, place };
  }
  return null;
}

export const caseAt = (layout: Layout, spot: Spot): number => layout.cells[spot.cell]!.indices[spot.place]!;

/** The tile that a key of the keyboard leads to from `spot`. */
export function stepped(layout: Layout, spot: Spot, key: string): Spot {
  const cell = layout.cells[spot.cell]!;
  const moves: Record<string, number> = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -cell.perRow, ArrowDown: cell.perRow };
  if (key === "Home") return first(layout) ?? spot;
  if (key === "End") return last(layout) ?? spot;
  const place = spot.place + (moves[key] ?? 0);
  if (place >= 0 && place < cell.indices.length) return { cell: spot.cell, place };
  const columns = layout.groups.columns.length;
  const onward = key === "ArrowUp" ? -columns : key === "ArrowDown" ? columns : key === "ArrowLeft" ? -1 : 1;
  for (let next = spot.cell + onward; next >= 0 && next < layout.cells.length; next += onward) {
    const count = layout.cells[next]!.indices.length;
    if (count) return { cell: next, place: onward < 0 ? count - 1 : 0 };
  }
  return spot;
}

export function first(layout: Layout): Spot | null {
  const cell = layout.cells.findIndex(({ indices }) => indices.length);
  return cell < 0 ? null : { cell, place: 0 };
}

function last(layout: Layout): Spot | null {
  const cell = layout.cells.findLastIndex(({ indices }) => indices.length);
  return cell < 0 ? null : { cell, place: layout.cells[cell]!.indices.length - 1 };
}
