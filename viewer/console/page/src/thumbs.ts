// Pictures of cases, loaded only while they are seen, in a bounded memory.
import { type Atlas, file, PATIENCE_MS } from "./data";

/** Most pixels that are kept of pictures; four bytes each. */
const PIXELS_MAX = 12e6;
/** Pictures on their way at once. */
const LOADS_MAX = 6;
/** From this width of a tile on a case has a picture of its own [px of the screen]. */
const SINGLE_PX = 200;
/** Most sheets of the larger size at once: in a mixed order every tile is on another sheet. */
const LARGE_SHEETS_MAX = 10;

export interface Piece {
  image: ImageBitmap;
  x: number;
  y: number;
  width: number;
  height: number;
}

interface Kept {
  image: ImageBitmap | null;
  /** Number of the drawing that used it last. */
  used: number;
}

const whole = (image: ImageBitmap): Piece => ({ image, x: 0, y: 0, width: image.width, height: image.height });

interface Wish {
  key: string;
  url: string;
  /** Width to which it is made smaller [px]; 0: as it is. */
  width: number;
}

/** What a bitmap is made of. A blob leaves nothing in the browser's caches of decoded pictures; from a disk it is refused. */
async function source(url: string): Promise<ImageBitmapSource> {
  if (location.protocol !== "file:") {
    const answer = await fetch(url, { signal: AbortSignal.timeout(PATIENCE_MS) });
    if (!answer.ok) throw new Error(String(answer.status));
    return answer.blob();
  }
  const image = new Image();
  image.src = url;
  await image.decode();
  return image;
}

export class Thumbs {
  atlas: Atlas | null = null;
  private readonly kept = new Map<string, Kept>();
  private readonly versions = new Map<number, number>();
  private readonly broken = new Set<string>();
  /** Key of the picture of its own that a case shows. */
  private readonly shown = new Map<number, string>();
  private closed = false;
  private wishes: Wish[] = [];
  /** Pictures on their way, or wanted. */
  get missing(): number {
    return this.loading + this.wishes.length;
  }
  private loading = 0;
  private drawing = 0;
  private pixels = 0;
  private large = false;
  private width = 0;

  constructor(
    private readonly run: string,
    private readonly nameOf: (index: number) => string,
    private readonly changed: () => void,
  ) {}

  /** A new picture of a case, or of one that has ended: from now on it is not that of the sheet. */
  renew(index: number, version?: number): void {
    this.versions.set(index, version ?? (this.versions.get(index) ?? 0) + 1);
  }

  /** Whether a picture of the case came while the page looked. */
  heard(index: number): boolean {
    return this.versions.has(index);
  }

  /** Whether it is known that there is no picture of a case. */
  without(index: number): boolean {
    return this.atlas !== null && !this.atlas.has[index] && !this.heard(index);
  }

  /** Begin a drawing of tiles `width` px of the screen wide. */
  begin(width: number, indices: number[]): void {
    this.drawing++;
    this.wishes = [];
    this.width = width;
    const per = this.atlas?.per_atlas ?? 64;
    this.large = width > 110 && new Set(indices.map((index) => Math.floor(index / per))).size <= LARGE_SHEETS_MAX;
  }

  /** The picture of a case, or a smaller one until it is there; null: none yet. */
  piece(index: number): Piece | null {
    const version = this.versions.get(index);
    const [sheet, where] = this.onSheet(index);
    if (version !== undefined || (this.width >= SINGLE_PX && !this.large && this.atlas?.has[index])) {
      const single = this.single(index, version ?? 0);
      if (single !== null) return single;
    }
    if (sheet === null) return null;
    const image = this.want(sheet, where.url, 0);
    if (image === null) return null;
    return { image, x: where.x, y: where.y, width: where.width, height: where.height };
  }

  /** End a drawing: ask for what was missing, forget what nobody used for longest. */
  end(): void {
    while (!this.closed && this.loading < LOADS_MAX && this.wishes.length) void this.load(this.wishes.shift()!);
    if (this.pixels <= PIXELS_MAX) return;
    for (const [key, kept] of [...this.kept].sort((a, b) => a[1].used - b[1].used)) {
      if (this.pixels <= PIXELS_MAX || kept.used === this.drawing) break;
      this.drop(key, kept);
    }
  }

  close(): void {
    this.closed = true;
    for (const [key, kept] of [...this.kept]) this.drop(key, kept);
  }

  private single(index: number, version: number): Piece | null {
    const width = Math.min(320, Math.max(80, Math.ceil(this.width / 80) * 80));
    const url = file(`runs/${this.run}/cases/${this.nameOf(index)}/moment.webp`, version || undefined);
    const key = `${index}@${version}@${width}`;
    const image = this.want(key, url, width);
    const before = this.shown.get(index) ?? "";
    if (image === null) {
      // Until the new one is there, the one before it stands.
      const kept = this.kept.get(before);
      if (kept === undefined || kept.image === null) return null;
      kept.used = this.drawing;
      return whole(kept.image);
    }
    const kept = this.kept.get(before);
    if (before !== key && kept !== undefined) this.drop(before, kept);
    this.shown.set(index, key);
    return whole(image);
  }

  private onSheet(index: number): [string | null, { url: string; x: number; y: number; width: number; height: number }] {
    const none = { url: "", x: 0, y: 0, width: 0, height: 0 };
    if (!this.atlas?.has[index]) return [null, none];
    const size = this.atlas.sizes[this.large ? this.atlas.sizes.length - 1 : 0] ?? [80, 45];
    const [width, height] = size;
    const sheet = Math.floor(index / this.atlas.per_atlas);
    const side = Math.sqrt(this.atlas.per_atlas);
    const place = index % this.atlas.per_atlas;
    const name = `${width}x${height}/${sheet}`;
    const url = file(`runs/${this.run}/pictures/${name}.webp`);
    return [name, { url, x: (place % side) * width, y: Math.floor(place / side) * height, width, height }];
  }

  private want(key: string, url: string, width: number): ImageBitmap | null {
    const kept = this.kept.get(key);
    if (kept !== undefined) {
      kept.used = this.drawing;
      return kept.image;
    }
    if (!this.broken.has(key) && !this.wishes.some((wish) => wish.key === key)) this.wishes.push({ key, url, width });
    return null;
  }

  private async load(wish: Wish): Promise<void> {
    const kept: Kept = { image: null, used: this.drawing };
    this.kept.set(wish.key, kept);
    this.loading++;
    try {
      const resize: ImageBitmapOptions = wish.width ? { resizeWidth: wish.width, resizeQuality: "medium" } : {};
      kept.image = await createImageBitmap(await source(wish.url), resize);
      this.pixels += kept.image.width * kept.image.height;
      if (this.kept.get(wish.key) !== kept) this.drop(wish.key, kept); // nobody wants it any more
    } catch {
      this.kept.delete(wish.key);
      this.broken.add(wish.key);
    }
    this.loading--;
    if (!this.closed) this.changed();
  }

  /** Ask again for what did not come: the line was cut meanwhile. */
  retry(): void {
    this.broken.clear();
    this.changed();
  }

  private drop(key: string, kept: Kept): void {
    if (this.kept.get(key) === kept) this.kept.delete(key);
    if (kept.image === null) return;
    this.pixels -= kept.image.width * kept.image.height;
    kept.image.close();
    kept.image = null;
  }
}
