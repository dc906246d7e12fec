// One stream's picture: a plain <video> on a proxy of constant frame index, or exact images while there is none.
//
// Image k of the proxy lies at [k / fps, (k + 1) / fps): seeking to its middle never lands on a neighbour, and the media time of
// the frame that is then presented says which image it is.

import { fit, panned, type View, zoomed } from "../canvas/view";
import { h } from "../dom";
import { follow } from "../pointer";
import type { App } from "../state";
import type { Proxy, StreamInfo } from "../types";
import { Images } from "./images";
import { StreamTimes } from "./times";

const NOMINAL_FPS = 30;
/** How long a seek may take before the exact image is asked for instead. */
const PATIENCE_MS = 2500;
/** How often it is asked whether the proxy is ready. */
const ASK_MS = 2000;
/** Chromium refuses slower and faster playback. */
export const RATES = [0.0625, 16] as const;

export type Source = "video" | "image" | "none";

export class Pane {
  readonly element: HTMLElement;
  readonly times: StreamTimes;
  view: View = { scale: 1, x: 0, y: 0 };
  /** Image of the stream that is on the screen; -1: none yet. */
  shown = -1;
  /** Called with every image that playing presents. */
  onPresented: ((image: number) => void) | null = null;
  private readonly video: HTMLVideoElement;
  private readonly still: HTMLCanvasElement;
  private readonly note: HTMLElement;
  private readonly images: Images;
  private readonly viewListeners = new Set<() => void>();
  private readonly shownListeners = new Set<() => void>();
  private readonly observer: ResizeObserver;
  private readonly offs: (() => void)[] = [];
  private size = { width: 0, height: 0 };
  private videoReady = false;
  private videoFailed = false;
  private target = -1;
  private settling = false;
  private presentHandle = 0;
  private gone = false;
  private asking = 0;

  constructor(
    readonly app: App,
    readonly stream: StreamInfo,
    readonly image: { readonly width: number; readonly height: number },
  ) {
    this.video = h("video", { muted: true, playsinline: true, preload: "auto", "aria-hidden": "true", tabindex: -1 });
    this.video.muted = true;
    this.still = h("canvas.pane-still", { "aria-hidden": "true" });
    this.note = h("p.pane-note", { role: "status", hidden: true });
    this.element = h("div.pane", { "data-testid": `pane-${stream.name}`, "data-stream": stream.name },
      this.video, this.still, this.note);
    const sid = app.session?.id ?? "";
    this.images = new Images(
      (k) => app.api.frameUrl(sid, stream.name, k), stream.n_frames || app.nFrames,
      (bitmap, k) => this.paint(bitmap, k), () => this.say("This image cannot be decoded."));
    this.times = new StreamTimes(app, stream, () => this.show(this.times.image(app.cursor.frame)));
    this.observer = new ResizeObserver(([entry]) => this.resize(entry!.contentRect));
    this.observer.observe(this.element);
    this.offs.push(app.on("proxy", (news) => news.stream === stream.name && this.useProxy(news.proxy)));
    this.listen();
    if (stream.present) this.useProxy(stream.proxy);
    else this.say("The video is not in this session: shapes are shown on an empty image.");
    this.mark();
    this.place();
  }

  get fps(): number {
    return this.stream.proxy.fps ?? NOMINAL_FPS;
  }

  get source(): Source {
    if (!this.stream.present) return "none";
    return this.videoReady && !this.videoFailed ? "video" : "image";
  }

  // --- the video

  private listen(): void {
    const on = (name: string, listener: () => void) => this.video.addEventListener(name, listener);
    on("loadeddata", () => {
      this.videoReady = true;
      this.say(null);
      this.shown = -1;
      this.mark();
      this.show(this.target < 0 ? this.times.image(this.app.cursor.frame) : this.target);
    });
    on("error", () => {
      if (this.videoFailed || !this.video.hasAttribute("src")) return;
      this.videoFailed = true;
      this.say("This browser does not play the video: exact images are shown instead.");
      this.mark();
      this.images.want(this.target);
    });
    this.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.element.addEventListener("pointerdown", (event) => event.button === 1 && this.dragView(event));
  }

  private useProxy(proxy: Proxy): void {
    this.stream.proxy = proxy;
    if (proxy.state === "failed") this.say("The video for playing could not be made: exact images are shown instead.");
    if (proxy.state === "making") {
      const done = proxy.progress === null ? "" : ` ${Math.round(proxy.progress * 100)} %`;
      this.say(`Preparing smooth playing…${done}`);
    }
    clearTimeout(this.asking);
    // news may come before anybody listens, and without the rate that seeking needs
    const known = proxy.state === "ready" && proxy.fps !== null;
    if (proxy.state === "making" || (proxy.state === "ready" && !known)) this.asking = window.setTimeout(() => void this.askProxy(), ASK_MS);
    if (!known || this.video.hasAttribute("src")) return this.mark();
    this.say(null);
    this.video.src = proxy.url ?? this.app.api.mediaUrl(this.app.session?.id ?? "", this.stream.name);
    return this.mark();
  }

  private async askProxy(): Promise<void> {
    const { session, api } = this.app;
    if (session === null || this.gone) return;
    const now = await api.session(session.id).catch(() => null);
    const proxy = now?.streams.find((s) => s.name === this.stream.name)?.proxy ?? this.stream.proxy;
    if (!this.gone && !this.video.hasAttribute("src")) this.useProxy(proxy);
  }

  private say(text: string | null): void {
    this.note.hidden = text === null;
    if (text !== null && this.note.textContent !== text) this.note.textContent = text;
  }

  /** Shows exactly image `k`; of several calls while one is under way, the last one counts. */
  show(k: number): void {
    this.target = k;
    if (this.source === "none") return this.setShown(k);
    if (this.source === "image") return this.images.want(k);
    void this.settle();
  }

  private async settle(): Promise<void> {
    if (this.settling) return;
    this.settling = true;
    let misses = 0;
    while (this.target !== this.shown && !this.gone && this.video.paused && this.source === "video") {
      const k = this.target;
      if (await this.present(k)) {
        misses = 0;
        this.still.hidden = true;
        this.setShown(k);
      } else if (k === this.target && ++misses >= 2) {
        this.images.want(k);
        break;
      }
    }
    this.settling = false;
  }

  /** Seeks to the middle of image `k`; true once that very image is presented. */
  private present(k: number): Promise<boolean> {
    const { video, fps } = this;
    return new Promise((resolve) => {
      const finish = (right: boolean) => {
        clearTimeout(timer);
        video.removeEventListener("seeked", onSeeked);
        video.cancelVideoFrameCallback(handle);
        resolve(right);
      };
      const onFrame = (_now: number, frame: VideoFrameCallbackMetadata) => {
        if (Math.round(frame.mediaTime * fps) === k) finish(true);
        else handle = video.requestVideoFrameCallback(onFrame);
      };
      // in a hidden tab nothing is presented: the seek is all there is to wait for
      const onSeeked = () => {
        clearTimeout(timer);
        timer = setTimeout(() => finish(document.hidden), 400);
      };
      let timer = setTimeout(() => finish(false), PATIENCE_MS);
      let handle = video.requestVideoFrameCallback(onFrame);
      video.addEventListener("seeked", onSeeked);
      video.currentTime = (k + 0.5) / fps;
    });
  }

  /** Starts playing from image `k` at `rate` times the proxy's own speed. */
  async play(k: number, rate: number): Promise<void> {
    this.show(k);
    while (this.shown !== k && this.app.cursor.playing && !this.gone && this.source === "video" && this.target === k)
      await new Promise((resolve) => setTimeout(resolve, 8));
    if (!this.app.cursor.playing || this.gone) return;
    this.setRate(rate);
    this.still.hidden = true;
    await this.video.play().catch(() => undefined);
    this.watch();
  }

  private watch(): void {
    this.video.cancelVideoFrameCallback(this.presentHandle);
    const onFrame = (_now: number, frame: VideoFrameCallbackMetadata) => {
      if (this.video.paused) return;
      this.setShown(Math.round(frame.mediaTime * this.fps));
      this.presentHandle = this.video.requestVideoFrameCallback(onFrame);
      this.onPresented?.(this.shown);
    };
    this.presentHandle = this.video.requestVideoFrameCallback(onFrame);
  }

  setRate(rate: number): void {
    const kept = Math.min(RATES[1], Math.max(RATES[0], rate));
    if (Math.abs(this.video.playbackRate - kept) > 0.02 * kept) this.video.playbackRate = kept;
  }

  get playing(): boolean {
    return !this.video.paused;
  }

  get ended(): boolean {
    return this.video.ended;
  }

  /** Jumps while playing. */
  jump(k: number): void {
    this.target = k;
    this.video.currentTime = (k + 0.5) / this.fps;
  }

  pause(): void {
    this.video.pause();
    this.video.cancelVideoFrameCallback(this.presentHandle);
    // what is presented when playing stops may be one image further than what was told
    this.shown = -1;
    delete this.element.dataset.frame;
  }

  private paint(bitmap: ImageBitmap, k: number): void {
    if (this.gone) return;
    if (this.still.width !== bitmap.width || this.still.height !== bitmap.height) {
      this.still.width = bitmap.width;
      this.still.height = bitmap.height;
    }
    this.still.getContext("2d")!.drawImage(bitmap, 0, 0);
    this.still.hidden = false;
    this.setShown(k);
  }

  private setShown(k: number): void {
    this.shown = k;
    this.element.dataset.frame = String(k);
    for (const listener of this.shownListeners) listener();
  }

  private mark(): void {
    this.element.dataset.source = this.source;
    this.video.hidden = this.source !== "video";
  }

  onShown(listener: () => void): () => void {
    this.shownListeners.add(listener);
    return () => this.shownListeners.delete(listener);
  }

  // --- where it stands

  private resize(rect: { width: number; height: number }): void {
    const whole = fit(this.image, this.size.width ? this.size : rect);
    const fitted = !this.size.width || Math.abs(whole.scale - this.view.scale) < 1e-6;
    this.size = { width: rect.width, height: rect.height };
    if (fitted) this.view = fit(this.image, this.size);
    this.place();
  }

  get hostSize(): { readonly width: number; readonly height: number } {
    return this.size;
  }

  fit(): void {
    this.setView(fit(this.image, this.size));
  }

  setView(view: View): void {
    this.view = view;
    this.place();
  }

  onView(listener: () => void): () => void {
    this.viewListeners.add(listener);
    return () => this.viewListeners.delete(listener);
  }

  zoom(at: { x: number; y: number }, factor: number): void {
    this.setView(zoomed(this.view, at, factor, fit(this.image, this.size).scale * 0.5));
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const box = this.element.getBoundingClientRect();
    this.zoom({ x: event.clientX - box.left, y: event.clientY - box.top }, Math.exp(-event.deltaY / 400));
  }

  /** Moves the picture with the pointer until the button is let go. */
  dragView(event: PointerEvent): void {
    event.preventDefault();
    let [x, y] = [event.clientX, event.clientY];
    follow(this.element, event, (e) => {
      this.setView(panned(this.view, e.clientX - x, e.clientY - y));
      [x, y] = [e.clientX, e.clientY];
    });
  }

  private place(): void {
    const { scale, x, y } = this.view;
    for (const element of [this.video, this.still]) {
      element.style.width = `${this.image.width}px`;
      element.style.height = `${this.image.height}px`;
      element.style.transform = `translate(${x}px, ${y}px) scale(${scale})`;
      // single pixels are what one zooms in for
      element.style.imageRendering = scale * devicePixelRatio > 3 ? "pixelated" : "auto";
    }
    for (const listener of this.viewListeners) listener();
  }

  destroy(): void {
    this.gone = true;
    clearTimeout(this.asking);
    for (const off of this.offs) off();
    this.observer.disconnect();
    this.images.close();
    this.video.pause();
    this.video.removeAttribute("src");
    this.video.load();
    this.element.remove();
  }
}
