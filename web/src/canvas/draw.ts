// Painting over the image, in CSS pixels of the pane.

import type { Point } from "./shapes";
import type { Ring, Skeleton, VisibleShape } from "./visible";
import { toScreen, type View } from "./view";

const UNSURE = "#868e96";
const SKELETON = "#ffd43b";

function trace(context: CanvasRenderingContext2D, points: readonly Point[], view: View, closed: boolean): void {
  context.beginPath();
  points.forEach((p, i) => {
    const { x, y } = toScreen(view, p);
    if (i) context.lineTo(x, y);
    else context.moveTo(x, y);
  });
  if (closed) context.closePath();
}

/** A line that can be seen on any picture: dark below, its colour on top. */
function outline(context: CanvasRenderingContext2D, color: string, width: number, dash: number[]): void {
  context.setLineDash([]);
  context.lineJoin = "round";
  context.lineWidth = width + 2;
  context.strokeStyle = "rgba(0, 0, 0, 0.45)";
  context.stroke();
  context.setLineDash(dash);
  context.lineWidth = width;
  context.strokeStyle = color;
  context.stroke();
  context.setLineDash([]);
}

export function drawShape(context: CanvasRenderingContext2D, shape: VisibleShape, view: View, selected: boolean): void {
  const { object, points, own, key } = shape;
  const color = object.color.slice(0, 7);
  context.globalAlpha = own ? 1 : 0.6;
  if (points.length === 1) {
    const { x, y } = toScreen(view, points[0]!);
    context.beginPath();
    context.arc(x, y, selected ? 6 : 4.5, 0, 2 * Math.PI);
    context.fillStyle = color;
    context.fill();
    context.lineWidth = 1.5;
    context.strokeStyle = "#fff";
    context.stroke();
  } else {
    trace(context, points, view, points.length > 2);
    context.fillStyle = `${color}${selected ? "33" : "14"}`;
    context.fill();
    // what is between key frames is dashed: nobody drew it here
    outline(context, color, Math.max(1.5, object.line_width) + (selected ? 1 : 0), key ? [] : [6, 4]);
  }
  label(context, object.name || object.id, points, view, color);
  context.globalAlpha = 1;
}

function label(context: CanvasRenderingContext2D, text: string, points: readonly Point[], view: View, color: string): void {
  const top = points.reduce((a, b) => (b.y < a.y ? b : a));
  const left = points.length > 2 ? Math.min(...points.map((p) => p.x)) : top.x;
  const { x, y } = toScreen(view, { x: left, y: top.y });
  context.font = "500 11px system-ui, sans-serif";
  const width = context.measureText(text).width + 8;
  const at = { x: Math.round(x - 1), y: Math.round(y - 18) };
  context.fillStyle = "rgba(12, 16, 22, 0.78)";
  context.beginPath();
  context.roundRect(at.x, at.y, width, 15, 3);
  context.fill();
  context.fillStyle = color;
  context.fillRect(at.x, at.y + 3, 2, 9);
  context.fillStyle = "#fff";
  context.textBaseline = "middle";
  context.fillText(text, at.x + 5, at.y + 8);
}

export function drawRings(context: CanvasRenderingContext2D, rings: readonly Ring[], view: View, selected: ReadonlySet<string>): void {
  for (const ring of rings) {
    trace(context, ring.points, view, true);
    outline(context, ring.color, selected.has(ring.object) ? 2.5 : 1.25, []);
    const { x, y } = toScreen(view, ring.points[0]!);
    context.fillStyle = ring.color;
    context.fillRect(x - 2, y - 2, 4, 4);
  }
}

export function drawSkeletons(
  context: CanvasRenderingContext2D, skeletons: readonly Skeleton[], bones: readonly (readonly [string, string])[], view: View,
): void {
  for (const { joints, sure } of skeletons) {
    for (const [a, b] of bones) {
      const [from, to] = [joints.get(a), joints.get(b)];
      if (!from || !to) continue;
      trace(context, [from, to], view, false);
      outline(context, sure.has(a) && sure.has(b) ? SKELETON : UNSURE, 1.5, []);
    }
    for (const [name, joint] of joints) {
      const { x, y } = toScreen(view, joint);
      context.beginPath();
      context.arc(x, y, 2.5, 0, 2 * Math.PI);
      context.fillStyle = sure.has(name) ? SKELETON : UNSURE;
      context.fill();
    }
  }
}

/** What is being drawn: its vertices so far, and where the next one would be. */
export function drawDraft(context: CanvasRenderingContext2D, points: readonly Point[], closed: boolean, view: View): void {
  trace(context, points, view, closed);
  context.fillStyle = "rgba(77, 171, 247, 0.18)";
  if (points.length > 2) context.fill();
  outline(context, "#4dabf7", 1.5, [5, 3]);
  for (const p of points) {
    const { x, y } = toScreen(view, p);
    context.fillStyle = "#fff";
    context.strokeStyle = "#1971c2";
    context.lineWidth = 1;
    context.beginPath();
    context.rect(x - 2.5, y - 2.5, 5, 5);
    context.fill();
    context.stroke();
  }
}

/** The whole image, where there is no picture of it. */
export function drawBlank(context: CanvasRenderingContext2D, image: { width: number; height: number }, view: View): void {
  const a = toScreen(view, { x: 0, y: 0 });
  const b = toScreen(view, { x: image.width, y: image.height });
  context.fillStyle = "#1a2028";
  context.fillRect(a.x, a.y, b.x - a.x, b.y - a.y);
  context.strokeStyle = "#3a4450";
  context.lineWidth = 1;
  context.beginPath();
  for (let k = 1; k < 8; k++) {
    context.moveTo(a.x + ((b.x - a.x) * k) / 8, a.y);
    context.lineTo(a.x + ((b.x - a.x) * k) / 8, b.y);
    context.moveTo(a.x, a.y + ((b.y - a.y) * k) / 8);
    context.lineTo(b.x, a.y + ((b.y - a.y) * k) / 8);
  }
  context.globalAlpha = 0.4;
  context.stroke();
  context.globalAlpha = 1;
  context.strokeRect(a.x, a.y, b.x - a.x, b.y - a.y);
}
