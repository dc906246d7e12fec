// A curve over the frames, with its extremes at coarser steps, so that an hour is drawn as fast as a second.

const BLOCK = 64;

export class Curve {
  readonly low: number;
  readonly high: number;
  private readonly blockLow: Float32Array;
  private readonly blockHigh: Float32Array;

  /** `values` has a number for every frame, NaN where it is not known. */
  constructor(readonly values: Float32Array) {
    const blocks = Math.ceil(values.length / BLOCK);
    this.blockLow = new Float32Array(blocks).fill(Number.NaN);
    this.blockHigh = new Float32Array(blocks).fill(Number.NaN);
    let [low, high] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
    for (let b = 0; b < blocks; b++) {
      const [a, z] = extremes(values, b * BLOCK, Math.min(values.length, (b + 1) * BLOCK));
      if (Number.isNaN(a)) continue;
      this.blockLow[b] = a;
      this.blockHigh[b] = z;
      low = Math.min(low, a);
      high = Math.max(high, z);
    }
    this.low = low <= high ? low : 0;
    this.high = low <= high ? high : 1;
  }

  /** Least and largest value of frames `[from, to)`; NaN where none is known. */
  range(from: number, to: number): [number, number] {
    const [a, b] = [Math.max(0, from), Math.min(this.values.length, to)];
    if (b - a < 3 * BLOCK) return extremes(this.values, a, b);
    const [first, last] = [Math.ceil(a / BLOCK), Math.floor(b / BLOCK)];
    const parts = [extremes(this.values, a, first * BLOCK), extremes(this.values, last * BLOCK, b)];
    for (let k = first; k < last; k++) parts.push([this.blockLow[k]!, this.blockHigh[k]!]);
    let [low, high] = [Number.NaN, Number.NaN];
    for (const [l, h] of parts) {
      if (Number.isNaN(l)) continue;
      low = Number.isNaN(low) ? l : Math.min(low, l);
      high = Number.isNaN(high) ? h : Math.max(high, h);
    }
    return [low, high];
  }
}

function extremes(values: Float32Array, from: number, to: number): [number, number] {
  let [low, high] = [Number.NaN, Number.NaN];
  for (let i = from; i < to; i++) {
    const value = values[i]!;
    if (Number.isNaN(value)) continue;
    if (!(value >= low)) low = value;
    if (!(value <= high)) high = value;
  }
  return [low, high];
}

/** Values in the order of frames, from rows of `frame` and `value`. */
export function spreadOver(frames: ArrayLike<number>, values: ArrayLike<number>, nFrames: number): Float32Array {
  const spread = new Float32Array(nFrames).fill(Number.NaN);
  for (let i = 0; i < frames.length; i++) if (frames[i]! >= 0 && frames[i]! < nFrames) spread[frames[i]!] = values[i]!;
  return spread;
}
