// The one axis of time that the timeline and the plots have in common.

import type { App } from "../state";
import { Axis } from "./axis";

/** Width of the lanes' names, CSS pixels. */
export const GUTTER_PX = 148;

export class SharedAxis {
  readonly axis = new Axis(1);
  private readonly listeners = new Set<() => void>();

  onChange(listener: () => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  changed(): void {
    for (const listener of this.listeners) listener();
  }

  /** The gestures that all of them know: Ctrl turns the wheel into a zoom, Shift into a scroll along time. */
  wheel(event: WheelEvent, x: number): boolean {
    if (event.ctrlKey || event.metaKey) this.axis.zoom(x, Math.exp(-event.deltaY / 240));
    else if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.axis.scroll(event.deltaX || event.deltaY);
    else return false;
    event.preventDefault();
    this.changed();
    return true;
  }
}

const shared = new WeakMap<App, SharedAxis>();

export function sharedAxis(app: App): SharedAxis {
  let found = shared.get(app);
  if (found === undefined) shared.set(app, (found = new SharedAxis()));
  return found;
}
