// Draws what is seen of a wall.
import { type Cell, caseAt, cornerOf, type Layout, PICTURE_MIN, type Spot } from "./layout";
import { colorOf, inkOn, kinds, symbolOf, wordsOf } from "./parts";
import { headOf, type Table } from "./table";
import { color } from "./theme";
import type { Thumbs } from "./thumbs";
import { plain } from "./words";

/** Narrower tiles have their shape, wider ones a sign for the verdict [px]. */
const SIGN_MIN = 11;
const NAME_MIN = 150;
/** Wider tiles without a picture say the verdict in words [px]. */
const WORDS_MIN = 80;

export interface Scene {
  layout: Layout;
  table: Table;
  thumbs: Thumbs;
  chosen: Set<number>;
  spot: Spot | null;
  focused: boolean;
  /** Names of cases that stand on tiles. */
  left: number;
  top: number;
  width: number;
  height: number;
}

interface Ink {
  paper: string;
  panel: string;
  ink: string;
  dim: string;
  line: string;
  focus: string;
}

const inks = (): Ink => ({
  paper: color("paper"),
  panel: color("panel"),
  ink: color("ink"),
  dim: color("dim"),
  line: color("line"),
  focus: color("focus"),
});

/** Cells, and of each the tiles, that are on the screen. */
export function seen(scene: Scene): { cell: Cell; from: number; to: number; number: number }[] {
  const { layout, left, top, width, height } = scene;
  const found: { cell: Cell; from: number; to: number; number: number }[] = [];
  layout.cells.forEach((cell, number) => {
    if (cell.y > top + height || cell.y + cell.height < top) return;
    if (cell.x > left + width || cell.x + cell.width < left) return;
    const from = Math.max(0, Math.floor((top - cell.tileY) / layout.stepY)) * cell.perRow;
    const rows = Math.ceil((top + height - cell.tileY) / layout.stepY);
    found.push({ cell, from, to: Math.min(cell.indices.length, Math.max(0, rows) * cell.perRow), number });
  });
  return found;
}

/** Draw it; how many tiles are on the screen. */
export function paint(context: CanvasRenderingContext2D, scene: Scene, ratio: number): number {
  const ink = inks();
  const { layout, left, top, width, height, thumbs } = scene;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.fillStyle = ink.paper;
  context.fillRect(0, 0, width, height);
  context.translate(-left, -top);
  const cells = seen(scene);
  const pictures = layout.tile >= PICTURE_MIN;
  const shown = pictures ? cells.flatMap(({ cell, from, to }) => cell.indices.slice(from, to)) : [];
  thumbs.begin(layout.tile * ratio, shown);
  let tiles = 0;
  for (const { cell, from, to } of cells) {
    if (layout.groups.axes.length) paintStrip(context, scene, cell, ink);
    if (pictures) for (let place = from; place < to; place++) paintTile(context, scene, cell, place, ink, ratio);
    else paintDots(context, scene, cell, from, to);
    tiles += Math.max(0, to - from);
  }
  thumbs.end();
  paintMarks(context, scene, cells, ink);
  paintHeads(context, scene, ink);
  return tiles;
}

/** Dots of one verdict in one stroke: ten thousand of them are a few calls. */
function paintDots(context: CanvasRenderingContext2D, scene: Scene, cell: Cell, from: number, to: number): void {
  const { layout, table } = scene;
  const byVerdict = new Map<string, number[]>();
  for (let place = from; place < to; place++) {
    const verdict = table.verdict(cell.indices[place]!);
    const places = byVerdict.get(verdict);
    if (places === undefined) byVerdict.set(verdict, [place]);
    else places.push(place);
  }
  const size = layout.tile;
  for (const [verdict, places] of byVerdict) {
    // What passes, runs or waits is smaller, so that the rest is seen without its colour as well.
    const small = kinds.get(verdict)?.passes || verdict === "running" || verdict === "waiting";
    const inset = small ? Math.max(1, size * 0.22) : 0;
    context.fillStyle = colorOf(verdict);
    context.beginPath();
    for (const place of places) {
      const x = cell.tileX + (place % cell.perRow) * layout.stepX;
      const y = cell.tileY + Math.floor(place / cell.perRow) * layout.stepY;
      context.rect(x + inset, y + inset, size - 2 * inset, size - 2 * inset);
    }
    context.fill();
    if (size < SIGN_MIN) continue;
    const sign = signOf(verdict, size);
    for (const place of places) {
      const x = cell.tileX + (place % cell.perRow) * layout.stepX;
      const y = cell.tileY + Math.floor(place / cell.perRow) * layout.stepY;
      context.drawImage(sign, x, y, size, size);
    }
  }
}

const signs = new Map<string, HTMLCanvasElement>();

/** The verdict's sign on its colour, drawn once. */
function signOf(verdict: string, size: number): HTMLCanvasElement {
  const fill = colorOf(verdict);
  const key = `${verdict} ${size} ${fill}`;
  const kept = signs.get(key);
  if (kept !== undefined) return kept;
  const sign = document.createElement("canvas");
  const pixels = Math.ceil(size * Math.min(2, devicePixelRatio));
  sign.width = sign.height = pixels;
  const context = sign.getContext("2d")!;
  context.fillStyle = fill;
  context.fillRect(0, 0, pixels, pixels);
  context.fillStyle = inkOn(fill);
  context.font = `bold ${Math.round(pixels * 0.75)}px system-ui, "DejaVu Sans", sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(symbolOf(verdict), pixels / 2, pixels * 0.54);
  signs.set(key, sign);
  return sign;
}

function paintTile(
  context: CanvasRenderingContext2D,
  scene: Scene,
  cell: Cell,
  place: number,
  ink: Ink,
  ratio: number,
): void {
  const { layout, table, thumbs } = scene;
  const index = cell.indices[place]!;
  const verdict = table.verdict(index);
  const x = cell.tileX + (place % cell.perRow) * layout.stepX;
  const y = cell.tileY + Math.floor(place / cell.perRow) * layout.stepY;
  const [width, height] = [layout.tile, layout.tileHeight];
  const fill = colorOf(verdict);
  const rim = width < 60 ? 2 : 3;
  context.fillStyle = fill;
  context.fillRect(x, y, width, height);
  context.fillStyle = ink.panel;
  const piece = thumbs.piece(index);
  context.imageSmoothingQuality = width * ratio > 160 ? "high" : "low";
  if (piece === null) {
    context.fillRect(x + rim, y + rim, width - 2 * rim, height - 2 * rim);
    if (width >= WORDS_MIN && thumbs.without(index)) paintWords(context, wordsOf(verdict), x + width / 2, y + height / 2, width - 2 * rim - 8, ink);
  } else {
    const { image } = piece;
    context.drawImage(image, piece.x, piece.y, piece.width, piece.height, x + rim, y + rim, width - 2 * rim, height - 2 * rim);
  }
  const badge = Math.min(28, Math.max(10, Math.round(height * 0.3)));
  context.drawImage(signOf(verdict, badge), x, y, badge, badge);
  if (width < NAME_MIN) return;
  const bar = 20;
  context.fillStyle = "#000000b8";
  context.fillRect(x + rim, y + height - rim - bar, width - 2 * rim, bar);
  context.fillStyle = "#ffffff";
  context.font = '12px system-ui, "DejaVu Sans", sans-serif';
  context.textAlign = "left";
  context.textBaseline = "middle";
  const room = width - 2 * rim - 10;
  context.fillText(fitted(context, table.cases[index] ?? "", room), x + rim + 5, y + height - rim - bar / 2);
}

/** What stands in place of a picture that there is not. */
function paintWords(context: CanvasRenderingContext2D, words: string, x: number, y: number, room: number, ink: Ink): void {
  context.fillStyle = ink.ink;
  context.font = '12px system-ui, "DejaVu Sans", sans-serif';
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(fitted(context, words, room), x, y);
}

/** A name that is too long loses its middle: cases differ at the end. */
function fitted(context: CanvasRenderingContext2D, name: string, room: number): string {
  if (context.measureText(name).width <= room) return name;
  const chars = Math.max(4, Math.floor((room / context.measureText(name).width) * name.length) - 2);
  return `${name.slice(0, Math.floor(chars / 3))}…${name.slice(name.length - Math.ceil((chars * 2) / 3))}`;
}

/** What a cell of a heat map holds: shares of verdicts, and how many passed. */
function paintStrip(context: CanvasRenderingContext2D, scene: Scene, cell: Cell, ink: Ink): void {
  const { table } = scene;
  const counts = new Map<string, number>();
  for (const index of cell.indices) counts.set(table.verdict(index), (counts.get(table.verdict(index)) ?? 0) + 1);
  const width = cell.width - 10;
  context.fillStyle = ink.panel;
  context.fillRect(cell.x + 2, cell.y + 1, cell.width - 4, cell.height - 3);
  let x = cell.x + 5;
  let passed = 0;
  for (const [verdict, count] of [...counts].sort(([a], [b]) => (kinds.get(a)?.rank ?? 99) - (kinds.get(b)?.rank ?? 99))) {
    context.fillStyle = colorOf(verdict);
    const share = (count / cell.indices.length) * width;
    context.fillRect(x, cell.y + 3, Math.max(1, share - 1), 4);
    x += share;
    if (kinds.get(verdict)?.passes) passed += count;
  }
  context.fillStyle = ink.dim;
  context.font = '11px system-ui, "DejaVu Sans", sans-serif';
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
  const words = cell.indices.length ? `${passed}/${cell.indices.length} pass` : "none";
  context.fillText(fitted(context, words, width), cell.x + 5, cell.y + 17);
}

/** Rings around what is chosen, and around the tile of the keyboard. */
function paintMarks(
  context: CanvasRenderingContext2D,
  scene: Scene,
  cells: { from: number; to: number; number: number }[],
  ink: Ink,
): void {
  const { layout, chosen, spot } = scene;
  const ring = (at: Spot, style: string, thick: number): void => {
    const [x, y] = cornerOf(layout, at);
    context.strokeStyle = style;
    context.lineWidth = thick;
    context.strokeRect(x - thick / 2, y - thick / 2, layout.tile + thick, layout.tileHeight + thick);
  };
  if (chosen.size) {
    for (const { from, to, number } of cells) {
      for (let place = from; place < to; place++) {
        const at = { cell: number, place };
        if (chosen.has(caseAt(layout, at))) ring(at, ink.ink, layout.tile < PICTURE_MIN ? 1.5 : 3);
      }
    }
  }
  if (spot !== null) ring(spot, scene.focused ? ink.focus : ink.dim, layout.tile < PICTURE_MIN ? 2 : 3);
}

/** Names of columns and rows stay in sight. */
function paintHeads(context: CanvasRenderingContext2D, scene: Scene, ink: Ink): void {
  const { layout, left, top, width, height } = scene;
  const { groups, head, side } = layout;
  if (!groups.axes.length) return;
  context.textBaseline = "middle";
  context.font = 'bold 12px system-ui, "DejaVu Sans", sans-serif';
  const value = (name: string | undefined, text: string): string => (name === "verdict" ? wordsOf(text) : plain(text));
  const titles = groups.axes.map((name) => headOf(scene.table.column(name) ?? { name, title: "", unit: "", kind: "axis", better: null }));
  if (side) {
    context.fillStyle = ink.paper;
    context.fillRect(left, top, side, height);
    context.fillStyle = ink.ink;
    context.textAlign = "left";
    for (const cell of layout.cells) {
      if (cell.column !== 0) continue;
      const y = Math.min(Math.max(cell.y + 14, top + head + 12), cell.y + cell.height - 12);
      context.fillText(fitted(context, value(groups.axes[1], groups.rows[cell.row]!), side - 12), left + 6, y);
    }
  }
  context.fillStyle = ink.paper;
  context.fillRect(left, top, width, head);
  context.fillStyle = ink.ink;
  context.textAlign = "left";
  for (const cell of layout.cells) {
    if (cell.row !== 0) continue;
    const name = value(groups.axes[0], groups.columns[cell.column]!);
    context.fillText(fitted(context, name, cell.width - 10), cell.x + 5, top + head / 2);
  }
  if (!side) return;
  context.fillStyle = ink.paper;
  context.fillRect(left, top, side, head);
  context.fillStyle = ink.dim;
  context.font = '11px system-ui, "DejaVu Sans", sans-serif';
  context.fillText(fitted(context, `${titles[1]} ↓`, side - 8), left + 6, top + head / 2);
}
