// Where an image stands on the screen: `screen = image * scale + offset`, in CSS pixels.

import type { Point } from "./shapes";

export interface View {
  readonly scale: number;
  readonly x: number;
  readonly y: number;
}

export const MOST_SCALE = 40;

/** The whole image, centred. */
export function fit(image: { width: number; height: number }, host: { width: number; height: number }): View {
  const scale = Math.min(host.width / image.width, host.height / image.height) || 1;
  return { scale, x: (host.width - image.width * scale) / 2, y: (host.height - image.height * scale) / 2 };
}

export function toImage(view: View, p: Point): Point {
  return { x: (p.x - view.x) / view.scale, y: (p.y - view.y) / view.scale };
}

export function toScreen(view: View, p: Point): Point {
  return { x: p.x * view.scale + view.x, y: p.y * view.scale + view.y };
}

/** Zoomed by `factor` with the image's point under `at` kept where it is. */
export function zoomed(view: View, at: Point, factor: number, least: number): View {
  const scale = Math.min(MOST_SCALE, Math.max(least, view.scale * factor));
  const k = scale / view.scale;
  return { scale, x: at.x - (at.x - view.x) * k, y: at.y - (at.y - view.y) * k };
}

export function panned(view: View, dx: number, dy: number): View {
  return { scale: view.scale, x: view.x + dx, y: view.y + dy };
}
