import { describe, expect, it } from "vitest";
import { hitScore, moved, nearestEdge, rectangleBetween, resized, scaled, shapeAt, turned, vertices } from "../src/canvas/shapes";
import { fit, toImage, toScreen, zoomed } from "../src/canvas/view";
import { lastNotAfter, nearest } from "../src/player/times";
import { Axis, frameTicks, snap, timeLabel, timeTicks } from "../src/timeline/axis";
import { Curve, spreadOver } from "../src/timeline/curve";
import { type Interval, Intervals, lowerBound, spread } from "../src/timeline/intervals";

/** Numbers that look random and are the same in every run. */
function chance(seed: number): () => number {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

describe("a shape between key frames", () => {
  const keys = [
    { frame: 10, coordinates: [0, 0, 10, 10] },
    { frame: 20, coordinates: [100, 50, 20, 10] },
    { frame: 30, present: false },
    { frame: 40, coordinates: [5, 5, 6, 6, 7, 7] },
    { frame: 50, coordinates: [1, 1, 2, 2] },
  ];

  it("is not there before the first one and where it is absent", () => {
    expect([9, 30, 39].map((frame) => shapeAt(keys, frame, "linear"))).toEqual([null, null, null]);
  });

  it("moves in a straight line, or holds", () => {
    expect(shapeAt(keys, 15, "linear")).toEqual({ coordinates: [50, 25, 15, 10], key: false });
    expect(shapeAt(keys, 15, "hold")?.coordinates).toEqual([0, 0, 10, 10]);
  });

  it("holds before an absence, between shapes of different length, and after the last", () => {
    expect(shapeAt(keys, 29, "linear")?.coordinates).toEqual([100, 50, 20, 10]);
    expect(shapeAt(keys, 45, "linear")?.coordinates).toEqual([5, 5, 6, 6, 7, 7]);
    expect(shapeAt(keys, 99, "linear")?.coordinates).toEqual([1, 1, 2, 2]);
  });
});

describe("a hand", () => {
  const square = vertices("rectangle", [0, 0, 10, 10]);

  it("means the smaller of two shapes that it is inside of, and none from afar", () => {
    const large = vertices("rectangle", [-50, -50, 110, 110]);
    expect(hitScore({ x: 5, y: 5 }, square, 1)).toBeGreaterThan(hitScore({ x: 5, y: 5 }, large, 1));
    expect(hitScore({ x: 13, y: 5 }, square, 1)).toBe(0);
    expect(hitScore({ x: 10.5, y: 5 }, square, 1)).toBeGreaterThan(0);
  });

  it("turns a rectangle over when it pulls a side across the other", () => {
    expect(resized([10, 10, 20, 20], "e", -30, 0)).toEqual([0, 10, 10, 20]);
    expect(rectangleBetween({ x: 5, y: 9 }, { x: 2, y: 1 })).toEqual([2, 1, 3, 8]);
  });

  it("moves without changing the size, scales and turns about the centroid", () => {
    expect(moved("rectangle", [1, 2, 3, 4], 10, 20)).toEqual([11, 22, 3, 4]);
    expect(scaled("rectangle", [0, 0, 10, 10], 2)).toEqual([-5, -5, 20, 20]);
    turned("polygon", [0, 0, 2, 0, 2, 2, 0, 2], Math.PI / 2).forEach((value, i) => expect(value).toBeCloseTo([2, 0, 2, 2, 0, 2, 0, 0][i]!));
    expect(nearestEdge({ x: 5, y: 11 }, square).edge).toBe(2);
  });
});

describe("the view of an image", () => {
  it("keeps what is under the pointer when it zooms, and leads there and back", () => {
    const view = zoomed(fit({ width: 1920, height: 1080 }, { width: 600, height: 400 }), { x: 200, y: 150 }, 3, 0.1);
    const before = toImage(fit({ width: 1920, height: 1080 }, { width: 600, height: 400 }), { x: 200, y: 150 });
    expect(toImage(view, { x: 200, y: 150 }).x).toBeCloseTo(before.x);
    expect(toScreen(view, toImage(view, { x: 17, y: 33 })).y).toBeCloseTo(33);
  });
});

describe("intervals of a lane", () => {
  it("finds exactly those in view, however they nest", () => {
    const next = chance(1);
    const items: Interval[] = Array.from({ length: 400 }, () => {
      const start = Math.floor(next() * 1000);
      return { start, end: start + 1 + Math.floor(next() ** 4 * 600) };
    });
    const lane = new Intervals(items);
    for (let k = 0; k < 200; k++) {
      const from = Math.floor(next() * 1200) - 100;
      const to = from + Math.floor(next() * 80);
      const found = new Set(lane.within(from, to));
      expect(found).toEqual(new Set(items.filter((item) => item.start < to && item.end > from)));
    }
  });

  it("are spread so that none overlap, over no more lanes than needed", () => {
    const next = chance(2);
    const items = Array.from({ length: 200 }, () => {
      const start = Math.floor(next() * 300);
      return { start, end: start + 1 + Math.floor(next() * 20) };
    });
    const lanes = spread(items);
    items.forEach((a, i) => items.forEach((b, j) => {
      if (i < j && lanes[i] === lanes[j]) expect(a.end <= b.start || b.end <= a.start).toBe(true);
    }));
    const most = Math.max(...Array.from({ length: 330 }, (_, t) => items.filter((item) => item.start <= t && t < item.end).length));
    expect(Math.max(...lanes) + 1).toBe(most);
  });

  it("are searched by bisection", () => {
    expect([0, 1, 2, 5, 9].map((value) => lowerBound([1, 2, 2, 5], value))).toEqual([0, 0, 1, 3, 4]);
  });
});

describe("the axis", () => {
  const axis = () => {
    const made = new Axis(1000);
    made.resize(500);
    made.fit();
    return made;
  };

  it("shows everything at first, and keeps the frame under the pointer when it zooms", () => {
    const made = axis();
    expect([made.first, made.last]).toEqual([0, 1000]);
    const at = made.frame(200);
    made.zoom(200, 4);
    expect(made.frame(200)).toBeCloseTo(at);
    made.zoom(200, 1e-9);
    expect(made.last - made.first).toBeCloseTo(1000);
  });

  it("never leaves the recording, and comes after a cursor that left the view", () => {
    const made = axis();
    made.zoom(0, 10);
    made.scroll(-1e6);
    expect(made.first).toBe(0);
    made.scroll(1e9);
    expect(made.last).toBeCloseTo(1000);
    expect(made.reveal(100)).toBe(true);
    expect(made.x(100)).toBeGreaterThan(0);
    expect(made.reveal(100)).toBe(false);
  });

  it("puts times where the images with those times are, not where a rate would", () => {
    const made = new Axis(100);
    made.resize(1000);
    made.fit();
    // one image in ten at first, then ten in one
    const times = Float64Array.from({ length: 100 }, (_, k) => (k < 50 ? k : 50 + (k - 50) * 0.1));
    const ticks = timeTicks(made, times);
    for (const { frame, label } of ticks.filter((tick) => tick.frame <= 99)) {
      const [minutes, seconds] = label.split(":").map(Number) as [number, number];
      const k = Math.floor(frame);
      const there = times[k]! + (frame - k) * ((times[k + 1] ?? times[k]!) - times[k]!);
      expect(60 * minutes + seconds).toBeCloseTo(there, 6);
    }
    expect(ticks.length).toBeGreaterThan(2);
    expect(frameTicks(made).map((tick) => tick.frame)).toContain(50);
  });

  it("writes times with the digits that the step needs", () => {
    expect([timeLabel(75.5, 0.5), timeLabel(3, 1), timeLabel(3661.25), timeLabel(0.02, 0.01)]).toEqual(["1:15.5", "0:03", "1:01:01.250", "0:00.02"]);
  });

  it("snaps to the nearest edge within reach, else to whole frames", () => {
    expect(snap(12.4, [10, 14], 2)).toEqual({ frame: 14, snapped: true });
    expect(snap(12.4, [10, 16], 2)).toEqual({ frame: 12, snapped: false });
  });
});

describe("images of other streams", () => {
  it("are those nearest in time", () => {
    const times = [0, 0.1, 0.25, 0.9];
    expect([-1, 0.04, 0.06, 0.175, 0.5, 2].map((t) => nearest(times, t))).toEqual([0, 0, 1, 1, 2, 3]);
    expect([-1, 0.1, 0.24, 5].map((t) => lastNotAfter(times, t))).toEqual([0, 1, 1, 3]);
  });
});

describe("a curve", () => {
  it("has the extremes of any stretch, with gaps", () => {
    const next = chance(3);
    const values = Float32Array.from({ length: 1500 }, () => (next() < 0.2 ? Number.NaN : next()));
    const curve = new Curve(values);
    for (let k = 0; k < 100; k++) {
      const from = Math.floor(next() * 1500);
      const to = Math.min(1500, from + Math.floor(next() * 900));
      const known = [...values.slice(from, to)].filter((value) => !Number.isNaN(value));
      const wanted = known.length ? [Math.min(...known), Math.max(...known)] : [Number.NaN, Number.NaN];
      expect(curve.range(from, to)).toEqual(wanted);
    }
  });

  it("leaves frames without a row unknown", () => {
    expect([...spreadOver([1, 3, 9], [5, 6, 7], 5)]).toEqual([Number.NaN, 5, Number.NaN, 6, Number.NaN]);
  });
});
