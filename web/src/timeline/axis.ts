// Frames along the screen, and the times that belong to them.
//
// The axis is even in frames of the annotated video, because that is what is stored; times are looked up, never computed from
// a frame rate.

import { lastAtMost } from "../canvas/shapes";

/** Pixels that the widest zoom gives one frame. */
const MOST_PX_PER_FRAME = 40;

export class Axis {
  /** The frame at the left edge, with a fraction while it moves. */
  first = 0;
  pxPerFrame = 1;
  width = 1;

  constructor(public nFrames: number) {}

  x(frame: number): number {
    return (frame - this.first) * this.pxPerFrame;
  }

  frame(x: number): number {
    return this.first + x / this.pxPerFrame;
  }

  get last(): number {
    return this.frame(this.width);
  }

  get whole(): number {
    return this.width / Math.max(1, this.nFrames);
  }

  fit(): void {
    this.first = 0;
    this.pxPerFrame = this.whole;
  }

  resize(width: number): void {
    const all = this.pxPerFrame <= this.whole * 1.001;
    this.width = Math.max(1, width);
    if (all) this.fit();
    this.clamp();
  }

  zoom(x: number, factor: number): void {
    const at = this.frame(x);
    this.pxPerFrame = Math.min(MOST_PX_PER_FRAME, Math.max(this.whole, this.pxPerFrame * factor));
    this.first = at - x / this.pxPerFrame;
    this.clamp();
  }

  scroll(px: number): void {
    this.first += px / this.pxPerFrame;
    this.clamp();
  }

  /** Shows `[from, to)` with some room at both sides. */
  show(from: number, to: number): void {
    const room = Math.max(1, (to - from) * 0.15);
    this.pxPerFrame = Math.min(MOST_PX_PER_FRAME, Math.max(this.whole, this.width / (to - from + 2 * room)));
    this.first = (from + to) / 2 - this.width / this.pxPerFrame / 2;
    this.clamp();
  }

  /** Brings `frame` into view; a page further when it ran out at the right, as playing does. */
  reveal(frame: number): boolean {
    const x = this.x(frame);
    if (x >= 0 && x <= this.width - 2) return false;
    this.first = x > this.width - 2 && x < this.width * 1.5 ? frame - (this.width * 0.08) / this.pxPerFrame : frame - this.width / this.pxPerFrame / 2;
    this.clamp();
    return true;
  }

  clamp(): void {
    const most = this.nFrames - this.width / this.pxPerFrame;
    this.first = Math.max(0, Math.min(most, this.first));
  }
}

export interface Tick {
  readonly frame: number;
  readonly label: string;
}

const SECONDS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200];
const FRAMES = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000, 100000, 200000, 500000];
const LABEL_PX = 78;

/** Seconds as `m:ss.mmm`, with as many digits as `step` needs. */
export function timeLabel(seconds: number, step = 0.001): string {
  const digits = step >= 1 ? 0 : Math.min(3, Math.ceil(-Math.log10(step) - 1e-9));
  const whole = Math.abs(seconds);
  const hours = Math.floor(whole / 3600);
  const minutes = Math.floor((whole % 3600) / 60);
  const rest = (whole % 60).toFixed(digits).padStart(digits ? digits + 3 : 2, "0");
  const head = hours ? `${hours}:${String(minutes).padStart(2, "0")}` : String(minutes);
  return `${seconds < 0 ? "-" : ""}${head}:${rest}`;
}

export function frameTicks(axis: Axis): Tick[] {
  const step = FRAMES.find((s) => s * axis.pxPerFrame >= LABEL_PX) ?? FRAMES.at(-1)!;
  const ticks: Tick[] = [];
  for (let frame = Math.ceil(axis.first / step) * step; frame <= Math.min(axis.last, axis.nFrames); frame += step)
    ticks.push({ frame, label: String(frame) });
  return ticks;
}

/** Even times at the frames where they come, by the recorded times of the images. */
export function timeTicks(axis: Axis, times: ArrayLike<number>): Tick[] {
  const n = times.length;
  if (n < 2) return [];
  const at = (frame: number) => {
    const k = Math.min(n - 2, Math.max(0, Math.floor(frame)));
    return times[k]! + (frame - k) * (times[k + 1]! - times[k]!);
  };
  const [from, to] = [at(Math.max(0, axis.first)), at(Math.min(axis.nFrames, axis.last))];
  const perPx = (to - from) / Math.max(1, axis.width);
  const step = SECONDS.find((s) => s >= LABEL_PX * perPx) ?? SECONDS.at(-1)!;
  const ticks: Tick[] = [];
  for (let k = Math.ceil(from / step - 1e-9); k * step <= to; k++) {
    const t = k * step;
    const i = Math.min(n - 2, Math.max(0, lastAtMost(n, (j) => times[j]!, t)));
    const gap = times[i + 1]! - times[i]!;
    const frame = i + (gap > 0 ? (t - times[i]!) / gap : 0);
    // where images are missing, many times lie at one place
    if ((frame - (ticks.at(-1)?.frame ?? Number.NEGATIVE_INFINITY)) * axis.pxPerFrame < LABEL_PX / 2) continue;
    ticks.push({ frame, label: timeLabel(t, step) });
  }
  return ticks;
}

/** Where a dragged edge lands: on the nearest of `targets` within `reach` frames, else on the whole frame. */
export function snap(frame: number, targets: readonly number[], reach: number): { frame: number; snapped: boolean } {
  let best = Math.round(frame);
  let near = reach;
  let snapped = false;
  for (const target of targets) {
    const far = Math.abs(target - frame);
    if (far <= near) {
      best = target;
      near = far;
      snapped = true;
    }
  }
  return { frame: best, snapped };
}
