// Every shortcut, in one table.  None fires while text is being typed or a dialog is open.

import { confirmSelected, markAbsent, merge, newEvent, newSubEvent, nudge, pressLabel, redo, rejectSelected, rememberObject, removeSelected, split, toggleLoop, toggleUnsure, undo } from "./actions";
import { changeSpeed, stepEdge, stepEvent } from "./navigate";
import { isTyping } from "./dom";
import { openHelp } from "./help";
import type { App } from "./state";
import type { EventType } from "./types";

export const GROUPS = ["Playing", "Moving", "Events", "Proposals", "Objects", "Everything"] as const;

export interface Shortcut {
  group: (typeof GROUPS)[number];
  /** As `KeyboardEvent.key`, lower case, with ctrl+ / alt+ / shift+ in front; shift only where the key has no case. */
  keys: string[];
  show: string[];
  label: string;
  run: (app: App) => void;
}

const step = (frames: number) => (app: App): void => {
  app.setPlaying(false);
  app.seek(app.cursor.frame + frames);
};

export const SHORTCUTS: Shortcut[] = [
  { group: "Playing", keys: [" "], show: ["Space"], label: "Play or pause", run: (app) => app.setPlaying(!app.cursor.playing) },
  { group: "Playing", keys: ["j"], show: ["J"], label: "Slower", run: (app) => changeSpeed(app, -1) },
  { group: "Playing", keys: ["k"], show: ["K"], label: "Pause", run: (app) => app.setPlaying(false) },
  { group: "Playing", keys: ["l"], show: ["L"], label: "Faster", run: (app) => changeSpeed(app, 1) },
  { group: "Playing", keys: ["p"], show: ["P"], label: "Repeat the selected segment", run: toggleLoop },
  { group: "Moving", keys: ["arrowleft"], show: ["←"], label: "One frame back", run: step(-1) },
  { group: "Moving", keys: ["arrowright"], show: ["→"], label: "One frame on", run: step(1) },
  { group: "Moving", keys: ["shift+arrowleft"], show: ["Shift", "←"], label: "Ten frames back", run: step(-10) },
  { group: "Moving", keys: ["shift+arrowright"], show: ["Shift", "→"], label: "Ten frames on", run: step(10) },
  { group: "Moving", keys: ["ctrl+arrowleft", "alt+arrowleft"], show: ["Ctrl", "←"], label: "Previous edge of an event", run: (app) => stepEdge(app, -1) },
  { group: "Moving", keys: ["ctrl+arrowright", "alt+arrowright"], show: ["Ctrl", "→"], label: "Next edge of an event", run: (app) => stepEdge(app, 1) },
  { group: "Moving", keys: ["home"], show: ["Home"], label: "First frame", run: (app) => app.seek(0) },
  { group: "Moving", keys: ["end"], show: ["End"], label: "Last frame", run: (app) => app.seek(app.nFrames - 1) },
  { group: "Moving", keys: ["arrowup"], show: ["↑"], label: "Previous event", run: (app) => stepEvent(app, -1) },
  { group: "Moving", keys: ["arrowdown"], show: ["↓"], label: "Next event", run: (app) => stepEvent(app, 1) },
  { group: "Events", keys: ["i"], show: ["I"], label: "Mark the start", run: (app) => app.setMarks({ start: app.cursor.frame }) },
  { group: "Events", keys: ["o"], show: ["O"], label: "Mark the end", run: (app) => app.setMarks({ end: app.cursor.frame }) },
  { group: "Events", keys: ["e"], show: ["E"], label: "New event from the marks", run: (app) => void newEvent(app) },
  { group: "Events", keys: ["n"], show: ["N"], label: "New sub-event of the selected event", run: (app) => void newSubEvent(app) },
  { group: "Events", keys: ["["], show: ["["], label: "Start one frame earlier", run: (app) => void nudge(app, "start", -1) },
  { group: "Events", keys: ["]"], show: ["]"], label: "Start one frame later", run: (app) => void nudge(app, "start", 1) },
  { group: "Events", keys: ["{"], show: ["{"], label: "End one frame earlier", run: (app) => void nudge(app, "end", -1) },
  { group: "Events", keys: ["}"], show: ["}"], label: "End one frame later", run: (app) => void nudge(app, "end", 1) },
  { group: "Events", keys: ["s"], show: ["S"], label: "Split at the cursor", run: (app) => void split(app) },
  { group: "Events", keys: ["m"], show: ["M"], label: "Merge with the next", run: (app) => void merge(app) },
  { group: "Events", keys: ["u"], show: ["U"], label: "Unsure, or sure again", run: (app) => void toggleUnsure(app) },
  { group: "Proposals", keys: ["enter"], show: ["Enter"], label: "Accept, confirm, end running labels", run: (app) => void confirmSelected(app) },
  { group: "Proposals", keys: ["x"], show: ["X"], label: "Reject the proposal", run: (app) => void rejectSelected(app) },
  { group: "Objects", keys: ["v"], show: ["V"], label: "Select and move", run: (app) => app.set({ tool: "select" }) },
  { group: "Objects", keys: ["r"], show: ["R"], label: "Draw a rectangle", run: (app) => app.set({ tool: "rectangle" }) },
  { group: "Objects", keys: ["g"], show: ["G"], label: "Draw a polygon", run: (app) => app.set({ tool: "polygon" }) },
  { group: "Objects", keys: ["t"], show: ["T"], label: "Set a point", run: (app) => app.set({ tool: "point" }) },
  { group: "Objects", keys: ["a"], show: ["A"], label: "Absent from here on", run: (app) => void markAbsent(app) },
  { group: "Everything", keys: ["delete", "backspace"], show: ["Delete"], label: "Remove what is selected", run: (app) => void removeSelected(app) },
  { group: "Everything", keys: ["ctrl+z"], show: ["Ctrl", "Z"], label: "Undo", run: undo },
  { group: "Everything", keys: ["ctrl+shift+z", "ctrl+y"], show: ["Ctrl", "Shift", "Z"], label: "Redo", run: redo },
  { group: "Everything", keys: ["escape"], show: ["Esc"], label: "Let go of everything", run: letGo },
  { group: "Everything", keys: ["?"], show: ["?"], label: "This help", run: openHelp },
];

function letGo(app: App): void {
  if (app.running.length > 0) app.setRunning([]);
  else if (app.settings.tool !== "select") app.set({ tool: "select" });
  else if (app.marks.start !== null || app.marks.end !== null) app.setMarks({ start: null, end: null });
  else app.select([]);
}

const BY_KEY = new Map(SHORTCUTS.flatMap((s) => s.keys.map((key) => [key, s] as const)));

/** How the table names what was pressed. */
export function keyName(event: Pick<KeyboardEvent, "key" | "ctrlKey" | "metaKey" | "altKey" | "shiftKey">): string {
  const key = event.key.toLowerCase();
  const cased = key.length === 1 && key !== " ";
  const shift = event.shiftKey && (!cased || event.ctrlKey || event.metaKey);
  return `${event.ctrlKey || event.metaKey ? "ctrl+" : ""}${event.altKey ? "alt+" : ""}${shift ? "shift+" : ""}${key}`;
}

/** The event type that a key labels: the scheme's keys, as far as no shortcut has them. */
export function labelOf(app: App, key: string): EventType | undefined {
  return BY_KEY.has(key) ? undefined : app.scheme.event_types.find((t) => t.key.toLowerCase() === key);
}

const HOLD_MS = 400;

export function createKeyboard(_host: HTMLElement, app: App): { destroy(): void } {
  const held = new Map<string, number>();

  const down = (event: KeyboardEvent): void => {
    if (event.defaultPrevented || isTyping(event.target) || document.querySelector("dialog[open]") !== null) return;
    const name = keyName(event);
    // A control that has the focus keeps the keys that press it.
    const onControl = event.target instanceof Element && event.target.closest("button, a, summary, input, [role=separator], [role=option]") !== null;
    if (onControl && (name === "enter" || name === " ")) return;
    const shortcut = BY_KEY.get(name);
    if (shortcut !== undefined) {
      event.preventDefault();
      shortcut.run(app);
      return;
    }
    const type = labelOf(app, name);
    if (type === undefined) return;
    event.preventDefault();
    if (event.repeat) return;
    held.set(name, performance.now());
    void pressLabel(app, type);
  };

  const up = (event: KeyboardEvent): void => {
    const name = event.key.toLowerCase();
    const since = held.get(name);
    held.delete(name);
    const type = since === undefined ? undefined : labelOf(app, name);
    if (type === undefined || since === undefined || performance.now() - since < HOLD_MS || !app.cursor.playing) return;
    if (app.running.some((r) => r.type === type.name)) void pressLabel(app, type);
  };

  // A button pressed with the mouse gives the keyboard back: Space then plays, and does not press it again.
  const click = (event: MouseEvent): void => {
    if (event.detail > 0 && event.target instanceof Element) event.target.closest<HTMLElement>("button, a, summary")?.blur();
  };

  document.addEventListener("keydown", down);
  document.addEventListener("keyup", up);
  document.addEventListener("click", click);
  const offs = [
    app.on("selection", () => {
      rememberObject(app);
      if (app.primary?.id !== app.guessed) app.guess(null);
    }),
    // who goes on to another place has seen what the type is
    app.on("cursor", () => app.guess(null)), app.on("layers", () => app.guess(null)),
  ];
  return {
    destroy: () => {
      document.removeEventListener("keydown", down);
      document.removeEventListener("keyup", up);
      document.removeEventListener("click", click);
      for (const off of offs) off();
    },
  };
}
