// Playing: one pane leads, the others follow, and the session's clock decides how fast.
//
// The cursor follows what the leading video presents.  Proxies run at a constant nominal rate; where the recorded times say
// otherwise, the playback rate is steered so that the presented image is the one whose time has come.

import type { App } from "../state";
import { type Pane, RATES } from "./pane";
import { lastNotAfter } from "./times";

/** Ahead of the session's clock by more than this, the video waits: images are missing in the recording. */
const MOST_AHEAD_S = 0.25;
/** Behind by more than this, the clock gives way: the machine is too slow. */
const MOST_BEHIND_S = 0.4;

export class Playback {
  private readonly panes: Pane[] = [];
  private leader: Pane | null = null;
  private anchor = { wall: 0, session: 0 };
  private running = false;
  private tick = 0;
  private wait = 0;
  private speed = 1;
  private readonly off: () => void;

  constructor(private readonly app: App) {
    this.off = app.on("cursor", (cursor) => this.onCursor(cursor.byPlayer));
  }

  add(pane: Pane): void {
    this.panes.push(pane);
    pane.show(pane.times.image(this.app.cursor.frame));
    this.restart();
  }

  remove(pane: Pane): void {
    this.panes.splice(this.panes.indexOf(pane), 1);
    this.restart();
  }

  private restart(): void {
    if (!this.running) return;
    this.stop();
    this.start();
  }

  private onCursor(byPlayer: boolean): void {
    const { playing, speed } = this.app.cursor;
    if (playing !== this.running) {
      if (playing) this.start();
      else this.stop();
    } else if (!playing) this.showAll();
    else if (!byPlayer) this.rebase(speed);
  }

  private showAll(except: Pane | null = null): void {
    for (const pane of this.panes) if (pane !== except) pane.show(pane.times.image(this.app.cursor.frame));
  }

  /** Somebody moved the cursor or the speed while it plays. */
  private rebase(speed: number): void {
    const { leader, app } = this;
    const moved = leader !== null && Math.abs(leader.times.frame(leader.shown) - app.cursor.frame) > 1;
    if (speed !== this.speed && (leader === null) !== !this.canLead(speed)) return this.restart();
    this.speed = speed;
    this.setAnchor();
    if (moved) leader.jump(leader.times.image(app.cursor.frame));
    return this.steer();
  }

  // --- the clock

  private seconds(frame: number): number {
    return this.app.secondsOf(frame) ?? frame / this.rate;
  }

  /** Images per second of the session, only where it has no times. */
  private get rate(): number {
    return this.app.session?.frame_rate_median || 30;
  }

  private frameAt(seconds: number): number {
    return this.app.times?.length ? lastNotAfter(this.app.times, seconds + 1e-6) : Math.floor(seconds * this.rate + 1e-6);
  }

  private setAnchor(): void {
    this.anchor = { wall: performance.now(), session: this.seconds(this.app.cursor.frame) };
  }

  private get due(): number {
    return this.anchor.session + ((performance.now() - this.anchor.wall) / 1000) * this.app.cursor.speed;
  }

  private canLead(speed: number): boolean {
    return this.base(this.panes.find((pane) => pane.source === "video")) * speed >= RATES[0];
  }

  private base(pane: Pane | undefined): number {
    return pane === undefined ? 0 : (this.app.session?.frame_rate_median || pane.fps) / pane.fps;
  }

  // --- playing

  private start(): void {
    const { app } = this;
    this.running = true;
    this.speed = app.cursor.speed;
    const { loop, frame } = app.cursor;
    if (loop !== null && (frame < loop[0] || frame >= loop[1] - 1)) app.seek(loop[0], true);
    else if (frame >= app.nFrames - 1) app.seek(0, true);
    const video = this.panes.find((pane) => pane.source === "video" && pane.stream.name === app.session?.video)
      ?? this.panes.find((pane) => pane.source === "video");
    this.leader = video !== undefined && this.canLead(this.speed) ? video : null;
    if (this.leader === null) {
      this.setAnchor();
      this.showAll();
      this.tick = requestAnimationFrame(() => this.step());
      return;
    }
    const { leader } = this;
    leader.onPresented = (image) => this.onPresented(image);
    const rate = this.base(leader) * this.speed;
    void leader.play(leader.times.image(app.cursor.frame), rate).then(() => {
      if (this.leader !== leader) return;
      this.setAnchor();
      this.tick = requestAnimationFrame(() => this.guard());
    });
    this.showAll(leader);
  }

  private stop(): void {
    this.running = false;
    cancelAnimationFrame(this.tick);
    clearTimeout(this.wait);
    if (this.leader !== null) {
      this.leader.onPresented = null;
      this.leader.pause();
      this.leader = null;
    }
    this.showAll();
  }

  private onPresented(image: number): void {
    const { leader, app } = this;
    if (leader === null) return;
    const frame = leader.times.frame(image);
    const { loop } = app.cursor;
    if (loop !== null && (frame >= loop[1] || frame < loop[0])) return this.jump(loop[0]);
    app.seek(frame, true);
    this.showAll(leader);
    if (frame >= app.nFrames - 1) return this.atEnd();
    return this.steer();
  }

  private jump(frame: number): void {
    this.leader?.jump(this.leader.times.image(frame));
    this.app.seek(frame, true);
    this.setAnchor();
    this.showAll(this.leader);
  }

  private atEnd(): void {
    const { loop } = this.app.cursor;
    if (loop !== null) {
      this.jump(loop[0]);
      if (this.leader !== null && !this.leader.playing) this.restart();
    } else this.app.setPlaying(false);
  }

  /** The video may end, or go on without presenting the last image. */
  private guard(): void {
    if (!this.running || this.leader === null) return;
    if (this.leader.ended) {
      const { loop } = this.app.cursor;
      if (loop === null) this.app.seek(this.app.nFrames - 1, true);
      this.atEnd();
    }
    this.tick = requestAnimationFrame(() => this.guard());
  }

  private steer(): void {
    const { leader, app } = this;
    if (leader === null) return;
    const base = this.base(leader) * app.cursor.speed;
    const ahead = (this.seconds(app.cursor.frame) - this.due) / app.cursor.speed;
    if (ahead < -MOST_BEHIND_S) this.setAnchor();
    if (ahead > MOST_AHEAD_S && leader.playing) {
      leader.pause();
      leader.shown = leader.times.image(app.cursor.frame);
      clearTimeout(this.wait);
      this.wait = window.setTimeout(() => {
        if (this.leader === leader && this.running) void leader.play(leader.times.image(app.cursor.frame), base);
      }, (ahead - 0.02) * 1000);
      return;
    }
    leader.setRate(base * Math.min(1.5, Math.max(0.6, 1 - ahead * 2)));
  }

  /** Without a video that can lead, the clock alone does. */
  private step(): void {
    if (!this.running || this.leader !== null) return;
    const { app } = this;
    const { loop } = app.cursor;
    const frame = this.frameAt(this.due);
    if (loop !== null && frame >= loop[1]) this.jump(loop[0]);
    else if (frame >= app.nFrames - 1) {
      app.seek(app.nFrames - 1, true);
      this.showAll();
      this.atEnd();
    } else if (frame !== app.cursor.frame) {
      app.seek(frame, true);
      this.showAll();
    }
    this.tick = requestAnimationFrame(() => this.step());
  }

  destroy(): void {
    cancelAnimationFrame(this.tick);
    clearTimeout(this.wait);
    this.off();
  }
}

const playbacks = new WeakMap<App, Playback>();

/** The one that plays this page's panes, wherever they stand. */
export function playbackOf(app: App): Playback {
  let playback = playbacks.get(app);
  if (playback === undefined) playbacks.set(app, (playback = new Playback(app)));
  return playback;
}
