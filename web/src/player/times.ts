// Which image of a stream belongs to a frame of the annotated video: the one nearest in time, never one at a nominal rate.

import type { App } from "../state";
import type { StreamInfo } from "../types";

/** Position of the number nearest to `value` in sorted numbers; the earlier one of two that are as near. */
export function nearest(sorted: ArrayLike<number>, value: number): number {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle]! < value) low = middle + 1;
    else high = middle;
  }
  if (low === 0) return 0;
  if (low === sorted.length) return sorted.length - 1;
  return value - sorted[low - 1]! <= sorted[low]! - value ? low - 1 : low;
}

/** Position of the last of sorted numbers that is not above `value`; 0 where all are. */
export function lastNotAfter(sorted: ArrayLike<number>, value: number): number {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle]! <= value) low = middle + 1;
    else high = middle;
  }
  return Math.max(0, low - 1);
}

/** The way between frames of the annotated video and images of one stream. */
export class StreamTimes {
  private times: Float64Array | null = null;

  constructor(
    private readonly app: App,
    private readonly stream: StreamInfo,
    onReady: () => void,
  ) {
    const session = app.session;
    if (session === null || app.times === null || stream.name === session.video) return;
    app.api.times(session.id, stream.name).then(
      (times) => {
        if (times.length === 0) return;
        this.times = times;
        onReady();
      },
      () => undefined, // a stream without times is taken image by image
    );
  }

  image(frame: number): number {
    const last = Math.max(0, (this.stream.n_frames || this.app.nFrames) - 1);
    const at = this.app.secondsOf(frame);
    const image = this.times !== null && at !== null ? nearest(this.times, at) : frame;
    return Math.max(0, Math.min(last, image));
  }

  frame(image: number): number {
    const at = this.times?.[image];
    return at !== undefined && this.app.times !== null ? nearest(this.app.times, at) : image;
  }
}
