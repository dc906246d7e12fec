// The grips of the selected shape: real elements, so that a keyboard, a screen reader and a test reach them.

import { h } from "../dom";
import { followOrCancel } from "../pointer";
import { centroid, COMPASS, type Coordinates, flatten, moved, type Point, resized, scaled, type Side, turned, vertices } from "./shapes";
import { toScreen, type View } from "./view";

/** What a grip makes of the coordinates when it is moved by (dx, dy) image pixels. */
type Pull = (coordinates: Coordinates, dx: number, dy: number, keys: { ctrl: boolean; shift: boolean; scale: number }) => number[];

interface Grip {
  readonly name: string;
  readonly label: string;
  readonly at: (points: readonly Point[]) => Point;
  readonly pull: Pull;
  /** Another shape when the grip is deleted; null: it cannot be. */
  readonly remove: ((coordinates: Coordinates) => number[]) | null;
}

export interface HandleHost {
  readonly view: () => View;
  readonly preview: (coordinates: Coordinates) => void;
  readonly commit: (coordinates: Coordinates) => void;
  readonly cancel: () => void;
}

const SIDES: Record<Side, string> = {
  nw: "top left", n: "top", ne: "top right", e: "right", se: "bottom right", s: "bottom", sw: "bottom left", w: "left",
};
const MOST_MIDPOINTS = 60;

function compassGrips(): Grip[] {
  return (Object.keys(COMPASS) as Side[]).map((side) => ({
    name: `handle-${side}`, label: `Resize at the ${SIDES[side]}`, remove: null,
    at: ([a, , c]) => ({ x: (a!.x + c!.x) / 2 + (COMPASS[side][0] * (c!.x - a!.x)) / 2, y: (a!.y + c!.y) / 2 + (COMPASS[side][1] * (c!.y - a!.y)) / 2 }),
    pull: (coordinates, dx, dy) => resized(coordinates, side, dx, dy),
  }));
}

function vertexGrips(n: number): Grip[] {
  const grips: Grip[] = [];
  for (let i = 0; i < n; i++)
    grips.push({
      name: `vertex-${i}`, label: `Vertex ${i + 1}; Delete removes it`, at: (points) => points[i]!,
      pull: (coordinates, dx, dy) => coordinates.map((value, k) => (k === 2 * i ? value + dx : k === 2 * i + 1 ? value + dy : value)),
      remove: n > 3 ? (coordinates) => coordinates.filter((_, k) => k >> 1 !== i) : null,
    });
  for (let i = 0; i < (n <= MOST_MIDPOINTS && n > 2 ? n : 0); i++) {
    const middle = (points: readonly Point[]) => centroid([points[i]!, points[(i + 1) % n]!]);
    grips.push({
      name: `midpoint-${i}`, label: `Insert a vertex after vertex ${i + 1}`, at: middle, remove: null,
      pull: (coordinates, dx, dy) => {
        const points = vertices("polygon", coordinates);
        const m = middle(points);
        points.splice(i + 1, 0, { x: m.x + dx, y: m.y + dy });
        return flatten(points);
      },
    });
  }
  return grips;
}

function centroidGrip(kind: string): Grip {
  return {
    name: "centroid", label: "Move; with Ctrl turn, with Shift scale", at: centroid, remove: null,
    pull: (coordinates, dx, dy, { ctrl, shift, scale }) =>
      ctrl ? turned(kind, coordinates, (dy * scale) / 180)
      : shift ? scaled(kind, coordinates, Math.exp((-dy * scale) / 100))
      : moved(kind, coordinates, dx, dy),
  };
}

function grips(kind: string, n: number): Grip[] {
  if (kind === "rectangle") return [centroidGrip(kind), ...compassGrips()];
  if (n === 1) return [centroidGrip(kind)];
  return [centroidGrip(kind), ...vertexGrips(n)];
}

export class Handles {
  readonly element = h("div.handles", { role: "group", "aria-label": "Grips of the selected shape" });
  private signature = "";
  private made: { grip: Grip; element: HTMLButtonElement }[] = [];
  private kind = "";
  private coordinates: Coordinates = [];
  private points: readonly Point[] = [];
  held = false;

  constructor(private readonly host: HandleHost) {}

  show(kind: string, coordinates: Coordinates, points: readonly Point[]): void {
    this.kind = kind;
    if (!this.held) this.coordinates = coordinates;
    this.points = points;
    const signature = `${kind}/${points.length}`;
    // while a midpoint is dragged there is one vertex more, but the grip in the hand has to stay
    if (signature !== this.signature && !this.held) {
      this.signature = signature;
      this.made = grips(kind, points.length).map((grip) => ({ grip, element: this.grip(grip) }));
      this.element.replaceChildren(...this.made.map(({ element }) => element));
    }
    this.place();
  }

  hide(): void {
    if (!this.signature) return;
    this.signature = "";
    this.made = [];
    this.element.replaceChildren();
  }

  place(): void {
    const count = this.kind === "rectangle" ? 4 : this.points.length;
    if (this.signature !== `${this.kind}/${count}`) return;
    for (const { grip, element } of this.made) {
      const { x, y } = toScreen(this.host.view(), grip.at(this.points));
      element.style.transform = `translate(${x}px, ${y}px)`;
    }
  }

  private grip(grip: Grip): HTMLButtonElement {
    const kind = grip.name.split("-")[0]!;
    const element = h("button", {
      type: "button", class: `grip grip-${kind}`, "data-testid": grip.name, "aria-label": grip.label, title: grip.label,
      onpointerdown: (event: PointerEvent) => {
        if (event.button !== 0) return;
        event.stopPropagation();
        if (event.altKey && grip.remove) this.host.commit(grip.remove(this.coordinates));
        else this.drag(grip, element, event);
      },
      onkeydown: (event: KeyboardEvent) => this.key(grip, event),
    });
    const side = grip.name.split("-")[1];
    if (kind === "handle") element.style.cursor = `${side}-resize`;
    return element;
  }

  private drag(grip: Grip, element: HTMLElement, event: PointerEvent): void {
    const from = { x: event.clientX, y: event.clientY };
    const start = this.coordinates;
    let now: number[] | null = null;
    this.held = true;
    const pulled = (e: PointerEvent) => {
      const { scale } = this.host.view();
      const keys = { ctrl: e.ctrlKey || e.metaKey, shift: e.shiftKey, scale };
      return grip.pull(start, (e.clientX - from.x) / scale, (e.clientY - from.y) / scale, keys);
    };
    const move = (e: PointerEvent) => {
      if (now === null && Math.hypot(e.clientX - from.x, e.clientY - from.y) < 2) return;
      now = pulled(e);
      this.host.preview(now);
    };
    followOrCancel(element, event, move, (cancelled) => {
      this.held = false;
      if (now === null || cancelled) this.host.cancel();
      else this.host.commit(now);
    });
  }

  private key(grip: Grip, event: KeyboardEvent): void {
    const step = event.shiftKey ? 10 : 1;
    const way = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    const keys = { ctrl: event.ctrlKey, shift: false, scale: 1 };
    if (way) this.host.commit(grip.pull(this.coordinates, way[0]!, way[1]!, keys));
    else if ((event.key === "Delete" || event.key === "Backspace") && grip.remove) this.host.commit(grip.remove(this.coordinates));
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
