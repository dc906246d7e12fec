// Surveys: a stretch of a recording is played, and somebody says which description fits best, or how good it is.

import { askText } from "./dialogs";
import { fill, h, isTyping } from "./dom";
import { createSpace } from "./space";
import { App } from "./state";
import type { Survey, SurveyItem } from "./types";

export function createSurveyList(host: HTMLElement, app: App): { destroy(): void } {
  const body = h("main", null, h("p.loading", { role: "status" }, "Looking for surveys…"));
  fill(host, h("div.browser", null, h("header", null, h("h1", null, "Surveys"), h("span.spacer"), h("a", { href: "#/" }, "All sessions")), body));
  app.api.surveys().then((surveys) => {
    fill(body, surveys.length === 0 ? h("p.empty", null, "There are none. `ecat survey new` makes one.") : h("table", null,
      h("thead", null, h("tr", null, h("th", null, "Survey"), h("th", null, "Question"), h("th.number", null, "Items"), h("th.number", null, "Answers"), h("th", null, "Who"))),
      h("tbody", null, surveys.map((s) => h("tr", null, h("td", null, h("a", { href: `#/survey/${encodeURIComponent(s.name)}`, "data-testid": `survey-${s.name}` }, s.name)), h("td", null, s.question),
        h("td.number", null, String(s.items)), h("td.number", null, String(Object.values(s.raters).reduce((a, b) => a + b, 0))), h("td", null, Object.keys(s.raters).join(", ") || "–"))))));
  }).catch((error: unknown) => {
    app.fail(error);
    fill(body, h("p.empty", { role: "alert" }, "The surveys cannot be read."));
  });
  return { destroy: () => undefined };
}

export function createSurvey(host: HTMLElement, app: App, name: string): { destroy(): void } {
  let survey: Survey | null = null;
  let at = 0;
  let clip: Clip | null = null;
  const given = new Map<string, { answer: string | number; comment: string }>();
  const comment = h("textarea.input", { rows: 2, placeholder: "Comment (optional)", "aria-label": "Comment", "data-testid": "survey-comment", maxlength: 10000 });
  const page = h("div.survey", { "data-testid": "survey" }, h("p.loading", { role: "status" }, "Opening the survey…"));
  fill(host, h("div.browser", null, h("header", null, h("h1", null, name), h("span.spacer"), h("a", { href: "#/surveys" }, "All surveys")), h("main", null, page)));

  const answer = async (value: string | number): Promise<void> => {
    const item = survey?.items[at];
    if (survey === null || item === undefined) return;
    try {
      await app.api.answerSurvey(name, { item: item.id, rater: app.settings.author, answer: value, comment: comment.value });
      given.set(item.id, { answer: value, comment: comment.value });
      const next = survey.items.findIndex((i, n) => n > at && !given.has(i.id));
      go(next >= 0 ? next : at);
    } catch (error) {
      app.fail(error);
    }
  };
  const go = (index: number): void => {
    if (survey === null) return;
    at = Math.max(0, Math.min(survey.items.length - 1, index));
    const item = survey.items[at];
    clip?.destroy();
    clip = null;
    if (item === undefined) return;
    comment.value = given.get(item.id)?.comment ?? "";
    clip = new Clip(app, item);
    show(survey, item, clip);
  };
  const show = (of: Survey, item: SurveyItem, shown: Clip): void => {
    const said = given.get(item.id)?.answer;
    const options: [string | number, string][] = of.kind === "choice" ? of.choices.map((c, i) => [c, i < 9 ? `${i + 1}` : ""]) : range(of).map((n) => [n, ""]);
    fill(page,
      h("p.muted", { role: "status", "data-testid": "survey-progress" }, `${at + 1} of ${of.items.length}, ${given.size} answered`),
      shown.element, h("h2", null, of.question),
      h(of.kind === "choice" ? "div.answers" : "div.answers.scores", { role: "group", "aria-label": of.question }, options.map(([value, key]) => h("button.button", {
        type: "button", "aria-pressed": String(said === value), "data-testid": `answer-${value}`, onclick: () => void answer(value),
      }, key === "" ? String(value) : h("span", null, h("kbd", null, key), ` ${value}`)))),
      comment,
      h("div.actions", null, h("button.button", { type: "button", disabled: at === 0, onclick: () => go(at - 1) }, "Back"),
        h("button.button", { type: "button", disabled: at >= of.items.length - 1, onclick: () => go(at + 1) }, "Next"),
        given.size === of.items.length ? h("span.chip.good", { "data-testid": "survey-done" }, "All answered, thank you") : null));
  };
  const onKey = (event: KeyboardEvent): void => {
    if (survey === null || isTyping(event.target) || event.ctrlKey || event.altKey || event.metaKey || !/^\d$/.test(event.key)) return;
    const digit = Number(event.key);
    const value = survey.kind === "choice" ? survey.choices[digit - 1] : range(survey).includes(digit) ? digit : undefined;
    if (value !== undefined) void answer(value);
  };
  document.addEventListener("keydown", onKey);

  const open = async (): Promise<void> => {
    if (app.settings.author === "") {
      const rater = await askText("Who answers?", "Your name is kept with your answers.", "", "Start");
      if (rater === null || rater === "") return;
      app.set({ author: rater });
    }
    survey = await app.api.survey(name, app.settings.author);
    for (const [item, a] of Object.entries(survey.answers)) given.set(item, a);
    go(Math.max(0, survey.items.findIndex((i) => !given.has(i.id))));
  };
  open().catch((error: unknown) => {
    app.fail(error);
    fill(page, h("p.empty", { role: "alert" }, "The survey cannot be opened."));
  });
  return {
    destroy: () => {
      document.removeEventListener("keydown", onKey);
      clip?.destroy();
    },
  };
}

function range(survey: Survey): number[] {
  return Array.from({ length: survey.most - survey.least + 1 }, (_, i) => survey.least + i);
}

/**
 * A stretch of a recording, played over and over: from its video once that is made, from single images until then, and in
 * space where nobody filmed it.
 */
class Clip {
  readonly element = h("div.clip", null, h("p.muted", null, "Opening the recording…"));
  private timer = 0;
  private gone = false;
  private space: { destroy(): void } | null = null;

  constructor(private readonly app: App, private readonly item: SurveyItem) {
    this.open().catch(() => fill(this.element, h("p.muted", null, "This recording has nothing to show.")));
  }

  destroy(): void {
    this.gone = true;
    clearInterval(this.timer);
    this.space?.destroy();
  }

  private async open(): Promise<void> {
    const { session: sid, start_frame: start, end_frame: end } = this.item;
    if (sid === null) throw new Error("the session is gone");
    const session = await this.app.api.session(sid);
    const stream = session.streams.find((s) => s.name === session.video);
    if (this.gone) return;
    if (stream === undefined || !stream.present) return this.openSpace(sid);
    const { proxy } = stream;
    if (proxy.state === "ready" && proxy.url !== null && proxy.fps !== null) {
      const fps = proxy.fps;
      const video = h("video", { src: proxy.url, muted: true, autoplay: true, playsinline: true, "data-testid": "survey-video", controls: true });
      video.muted = true;
      video.addEventListener("loadedmetadata", () => {
        video.currentTime = (start + 0.5) / fps;
        void video.play().catch(() => undefined);
      });
      this.timer = window.setInterval(() => {
        if (video.currentTime * fps >= end || video.currentTime * fps < start - 1) video.currentTime = (start + 0.5) / fps;
      }, 30);
      fill(this.element, video);
      return;
    }
    const image = h("img", { alt: "The recording, image by image", "data-testid": "survey-image" });
    let frame = start;
    const step = Math.max(1, Math.round((session.frame_rate_median ?? 30) / 10));
    const next = (): void => {
      image.src = this.app.api.frameUrl(sid, stream.name, frame);
      frame = frame + step < end ? frame + step : start;
    };
    this.timer = window.setInterval(() => image.complete && next(), 100);
    next();
    fill(this.element, image);
  }

  private async openSpace(sid: string): Promise<void> {
    const { start_frame: start, end_frame: end } = this.item;
    const viewer = new App();
    await viewer.openSession(sid, true);
    if (this.gone) return;
    const host = h("div.clip-space", { "data-testid": "survey-space" });
    fill(this.element, host);
    viewer.seek(start);
    this.space = createSpace(host, viewer);
    const [rate, began] = [viewer.session?.frame_rate_median ?? 30, performance.now()];
    this.timer = window.setInterval(() => {
      const at = Math.floor(((performance.now() - began) / 1000) * rate) % Math.max(1, end - start);
      viewer.seek(start + at);
    }, 1000 / Math.min(60, rate));
  }
}
