// The page's frame: which view is shown, where its widgets live, and how they share the room.

import "./style.css";
import { createAdjudicate } from "./adjudicate";
import { createBrowser } from "./browser";
import { createCanvas } from "./canvas";
import { createDepth } from "./depth";
import { installDialogs } from "./dialogs";
import { h } from "./dom";
import { createInspector } from "./inspector";
import { createKeyboard } from "./keyboard";
import { createPlayer } from "./player";
import { createPlots } from "./plots";
import { createSpace } from "./space";
import { App } from "./state";
import { createSurvey, createSurveyList } from "./survey";
import { keepTheme } from "./theme";
import { createTimeline } from "./timeline";
import { createTopbar } from "./topbar";

interface Widget {
  destroy(): void;
}

type Create = (host: HTMLElement, app: App) => Widget;

const app = new App();
const root = document.getElementById("app") as HTMLElement;
let widgets: Widget[] = [];

function clear(): void {
  for (const widget of widgets) widget.destroy();
  widgets = [];
  root.replaceChildren();
}

/**
 * video            | 3-D view | inspector
 * video's controls | depth    | inspector
 * -----------------------------------------
 * timeline over the full width, plots below it on the same scale
 *
 * `player` fills #player with the video and its controls below; `canvas` overlays #player (it is given the same
 * element) and draws shapes over the picture.
 */
function showSession(createSide: Create): void {
  const host = (id: string, label: string): HTMLElement => h("section", { id, "aria-label": label, "data-testid": id });
  const hosts = {
    topbar: h("header", { id: "topbar" }),
    player: host("player", "Video"),
    space: host("space", "3-D view"),
    depth: host("depth", "Depth"),
    inspector: host("inspector", "Inspector"),
    timeline: host("timeline", "Timeline"),
    plots: host("plots", "Plots"),
  };
  const views = h("div", { id: "views" }, hosts.space, hosts.depth);
  const upper = h("div", { id: "upper" }, hosts.player, splitter("views", "x"), views, splitter("inspector", "x"), hosts.inspector);
  const lower = h("div", { id: "lower" }, hosts.timeline, hosts.plots);
  root.replaceChildren(hosts.topbar, h("main", { id: "workspace" }, upper, splitter("lower", "y"), lower));
  const make: [Create, HTMLElement][] = [
    [createTopbar, hosts.topbar], [createPlayer, hosts.player], [createCanvas, hosts.player], [createDepth, hosts.depth],
    [createSpace, hosts.space], [createSide, hosts.inspector], [createTimeline, hosts.timeline], [createPlots, hosts.plots],
    [createKeyboard, root],
  ];
  for (const [create, element] of make) widgets.push(create(element, app));
}

/** A bar between two panes: dragged, or moved with the arrow keys; the size is remembered. */
function splitter(pane: string, axis: "x" | "y"): HTMLElement {
  const limits: Record<string, [number, number, number]> = { views: [160, 288, 700], inspector: [240, 328, 560], lower: [120, 280, 560] };
  const [low, usual, high] = limits[pane] ?? [100, 300, 600];
  const apply = (size: number): void => {
    const kept = Math.max(low, Math.min(high, Math.round(size)));
    document.documentElement.style.setProperty(`--pane-${pane}`, `${kept}px`);
    bar.setAttribute("aria-valuenow", String(kept));
    app.settings.panes[pane] = kept;
  };
  const current = (): number => app.settings.panes[pane] ?? usual;
  const bar = h(`div.splitter.${axis === "x" ? "vertical" : "horizontal"}` as "div.splitter", {
    role: "separator", tabindex: 0, "aria-label": `Size of the ${pane} pane`,
    "aria-orientation": axis === "x" ? "vertical" : "horizontal", "aria-valuemin": low, "aria-valuemax": high,
    onpointerdown: (event: PointerEvent) => {
      bar.setPointerCapture(event.pointerId);
      const start = axis === "x" ? event.clientX : event.clientY;
      const size = current();
      const move = (e: PointerEvent): void => apply(size + start - (axis === "x" ? e.clientX : e.clientY));
      const stop = (): void => {
        bar.removeEventListener("pointermove", move);
        app.set({ panes: app.settings.panes });
      };
      bar.addEventListener("pointermove", move);
      bar.addEventListener("lostpointercapture", stop, { once: true });
    },
    onkeydown: (event: KeyboardEvent) => {
      const step = { ArrowLeft: 16, ArrowUp: 16, ArrowRight: -16, ArrowDown: -16 }[event.key];
      if (step === undefined) return;
      apply(current() + step);
      app.set({ panes: app.settings.panes });
      event.preventDefault();
      event.stopPropagation();
    },
    ondblclick: () => {
      apply(usual);
      app.set({ panes: app.settings.panes });
    },
  });
  apply(current());
  return bar;
}

let routes = 0;

/** #/ is the project, #/session/<id> a session, #/adjudicate/<id> two of its layers, #/surveys and #/survey/<name>. */
async function route(): Promise<void> {
  const turn = ++routes;
  const [, view, id] = location.hash.split("?")[0]?.split("/") ?? [];
  clear();
  app.closeSession();
  if (id === undefined || (view !== "session" && view !== "adjudicate")) {
    document.title = "ecat";
    if (view === "surveys") widgets.push(createSurveyList(root, app));
    else if (view === "survey" && id !== undefined) widgets.push(createSurvey(root, app, decodeURIComponent(id)));
    else widgets.push(createBrowser(root, app));
    return;
  }
  root.replaceChildren(h("p.loading", { role: "status" }, "Opening the session…"));
  try {
    if (!(await app.openSession(decodeURIComponent(id))) || turn !== routes) return;
    document.title = `${app.session?.name ?? id} – ecat`;
    showSession(view === "adjudicate" ? createAdjudicate : createInspector);
    const frame = Number(new URLSearchParams(location.hash.split("?")[1] ?? "").get("frame"));
    if (Number.isFinite(frame) && frame > 0) app.seek(frame);
  } catch (error) {
    if (turn !== routes) return;
    app.fail(error);
    root.replaceChildren(h("p.loading", { role: "alert" }, error instanceof Error ? error.message : "The session cannot be opened.", " ",
      h("a", { href: "#/" }, "Back to the project")));
  }
}

keepTheme(app);
installDialogs(app);
window.addEventListener("hashchange", () => void route());
void route();

// For tests and for people who like to look: the same object that the widgets use.
Object.assign(window, { ecat: app });
