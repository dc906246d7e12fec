// The video of the chosen streams with its controls below.

import "./stage.css";
import { toggleLoop } from "./actions";
import { h } from "./dom";
import { type Glyph, glyph } from "./player/glyphs";
import { Pane } from "./player/pane";
import { playbackOf } from "./player/playback";
import { DepthProbe } from "./player/probe";
import { type App, SPEEDS, type Tool } from "./state";
import { timeLabel } from "./timeline/axis";
import type { StreamInfo } from "./types";

const PICTURES: ReadonlySet<string> = new Set(["color", "depth", "infrared"]);
/** The colour image of the Kinect v2: what sessions without a video were drawn on. */
const USUAL = { width: 1920, height: 1080 };
const TOOLS: [Tool, string, Glyph][] = [
  ["select", "Select and move (V)", "select"],
  ["rectangle", "Draw a rectangle (R)", "rectangle"],
  ["polygon", "Draw a polygon (G): click its corners, Enter or a right click closes it", "polygon"],
  ["point", "Set a point (T)", "point"],
];

/** The streams that can be looked at, the annotated one first. */
export function pictures(app: App): StreamInfo[] {
  const { session } = app;
  if (session === null) return [];
  const main = session.streams.find((stream) => stream.name === session.video);
  const others = session.streams.filter((stream) => stream !== main && PICTURES.has(stream.kind) && stream.present);
  if (main !== undefined) return [main, ...others];
  const nothing: StreamInfo = {
    name: session.video ?? "image", kind: "color", n_frames: session.n_frames, width_px: null, height_px: null, camera: "", present: false,
    proxy: { state: "absent", progress: null, url: null, fps: null },
  };
  return others.length ? others : [nothing];
}

export function imageSize(stream: StreamInfo): { width: number; height: number } {
  return { width: stream.width_px ?? USUAL.width, height: stream.height_px ?? USUAL.height };
}

const mains = new WeakMap<HTMLElement, Pane>();

/** The pane of the annotated stream inside the player's host, for what is drawn over it. */
export function annotatedPane(host: HTMLElement): Pane | null {
  return mains.get(host) ?? null;
}

export function createPlayer(host: HTMLElement, app: App): { destroy(): void } {
  const playback = playbackOf(app);
  const streams = pictures(app);
  const panes = streams.map((stream) => new Pane(app, stream, imageSize(stream)));
  const [main] = panes;
  if (main !== undefined) mains.set(host, main);
  const probes = panes.filter((pane) => pane.stream.kind === "depth" && pane.stream.present).map((pane) => probed(app, pane));
  const shown = new Set<string>(main === undefined ? [] : [main.stream.name]);
  const stage = h("div.stage");
  const tabs = h("div.stage-tabs", { role: "group", "aria-label": "Streams" });

  const arrange = () => {
    for (const pane of panes) {
      const wanted = shown.has(pane.stream.name);
      if (wanted === pane.element.isConnected && stage.contains(pane.element)) continue;
      if (wanted) {
        stage.append(pane.element);
        playback.add(pane);
      } else if (stage.contains(pane.element)) {
        playback.remove(pane);
        pane.element.remove();
      }
    }
    for (const tab of tabs.querySelectorAll<HTMLElement>("[data-stream]"))
      tab.setAttribute("aria-pressed", String(shown.has(tab.dataset.stream ?? "")));
  };
  const choose = (name: string, beside: boolean) => {
    if (beside) {
      if (shown.has(name) && shown.size > 1) shown.delete(name);
      else shown.add(name);
    } else {
      shown.clear();
      shown.add(name);
    }
    arrange();
  };
  if (panes.length > 1)
    for (const { stream } of panes)
      tabs.append(h("button.stage-tab", {
        type: "button", "data-stream": stream.name, "data-testid": `stream-${stream.name}`, "aria-pressed": "false",
        title: `${stream.kind}; Shift+click: side by side`,
        onclick: (event: MouseEvent) => choose(stream.name, event.shiftKey || event.ctrlKey),
      }, stream.name));

  const transport = createTransport(app);
  const toolbar = createToolbar(app, () => panes.filter((pane) => shown.has(pane.stream.name)).forEach((pane) => pane.fit()));
  host.append(h("div.player", null, h("div.stage-bar", null, toolbar.element, tabs), stage, transport.element));
  arrange();
  return {
    destroy() {
      transport.destroy();
      toolbar.destroy();
      for (const probe of probes) probe.destroy();
      for (const pane of panes) {
        if (stage.contains(pane.element)) playback.remove(pane);
        pane.destroy();
      }
      mains.delete(host);
      host.replaceChildren();
    },
  };
}

/** A pane of depth says what lies under the pointer. */
function probed(app: App, pane: Pane): DepthProbe {
  const readout = h("p.pane-readout", { "aria-live": "polite", hidden: true });
  pane.element.append(readout);
  return new DepthProbe(app, pane, (text) => {
    readout.hidden = text === "";
    readout.textContent = text;
  });
}

function button(name: Glyph, label: string, testid: string, onclick: () => void): HTMLButtonElement {
  const element = h("button.stage-button", {
    type: "button", "aria-label": label, title: label, "data-testid": testid,
    onclick: (event: MouseEvent) => {
      onclick();
      // Space after a click is to play, not to click again; who uses the keyboard keeps the focus
      if (event.detail) element.blur();
    },
  }, glyph(name));
  return element;
}

function createToolbar(app: App, fit: () => void): { element: HTMLElement; destroy(): void } {
  const tools = TOOLS.map(([tool, label, sign]) => ({ tool, element: button(sign, label, `tool-${tool}`, () => app.set({ tool })) }));
  const update = () => {
    for (const { tool, element } of tools) element.setAttribute("aria-pressed", String(app.settings.tool === tool));
  };
  update();
  const element = h("div.stage-tools", { role: "toolbar", "aria-label": "Drawing" },
    ...tools.map((tool) => tool.element), button("fit", "Fit the image (0)", "fit", fit));
  return { element, destroy: app.on("settings", update) };
}

function createTransport(app: App): { element: HTMLElement; destroy(): void } {
  const play = button("play", "Play (Space)", "play", () => app.setPlaying(!app.cursor.playing));
  const speed = h("select.stage-speed", {
    "aria-label": "Speed", "data-testid": "speed", title: "Speed (J, L)",
    onchange: () => app.setSpeed(Number(speed.value)),
  });
  const frame = h("input.stage-frame", {
    type: "text", inputmode: "numeric", "aria-label": "Frame", "data-testid": "frame", title: "Frame: type a number to go there",
    onchange: () => {
      const wanted = Number.parseInt(frame.value, 10);
      if (Number.isFinite(wanted)) app.seek(wanted);
      frame.value = String(app.cursor.frame);
      frame.blur();
    },
    onfocus: () => frame.select(),
  });
  const count = h("span.stage-count");
  const time = h("span.stage-time", { "data-testid": "time" });
  const loop = button("loop", "Loop the selected segment (P)", "loop", () => toggleLoop(app));
  const step = (by: number) => () => {
    app.setPlaying(false);
    app.seek(app.cursor.frame + by);
  };
  let state: boolean | null = null;
  const update = () => {
    const { cursor } = app;
    if (document.activeElement !== frame) frame.value = String(cursor.frame);
    count.textContent = `/ ${Math.max(0, app.nFrames - 1)}`;
    const seconds = app.secondsOf(cursor.frame);
    time.textContent = seconds === null ? "" : timeLabel(seconds);
    loop.setAttribute("aria-pressed", String(cursor.loop !== null));
    if (state !== cursor.playing) {
      state = cursor.playing;
      play.replaceChildren(glyph(state ? "pause" : "play"));
      play.setAttribute("aria-label", state ? "Pause (Space)" : "Play (Space)");
      play.title = play.getAttribute("aria-label") ?? "";
    }
    const speeds = SPEEDS.includes(cursor.speed) ? SPEEDS : [...SPEEDS, cursor.speed].sort((a, b) => a - b);
    if (speed.options.length !== speeds.length || Number(speed.value) !== cursor.speed) {
      speed.replaceChildren(...speeds.map((s) => h("option", { value: s }, `${Math.round(s * 100) / 100}×`)));
      speed.value = String(cursor.speed);
    }
  };
  update();
  const element = h("div.transport", { role: "toolbar", "aria-label": "Playback" },
    button("first", "To the start (Home)", "to-start", () => app.seek(0)), button("back", "One frame back (←)", "step-back", step(-1)),
    play, button("forward", "One frame on (→)", "step-on", step(1)), loop, speed,
    h("span.stage-spacer"), time, h("label.stage-frames", null, h("span", null, "frame"), frame, count));
  const offs = [app.on("cursor", update), app.on("session", update)];
  return { element, destroy: () => offs.forEach((off) => off()) };
}
