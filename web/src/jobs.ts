// Work that goes on behind the page: followed in a corner, where it can be stopped, while everything else goes on.

import { ApiError } from "./api";
import { h, iconButton } from "./dom";
import type { View } from "./view";
import type { Api } from "./api";
import type { Job } from "./types";

const ASK_MS = 400;

export interface Worker extends View {
  readonly api: Api;
}

/** Starts a job and follows it to its end; null if it failed or was stopped, which has been told then. */
export async function follow(app: Worker, title: string, start: (tell: (text: string, share: number | null) => void) => Promise<Job>): Promise<Job | null> {
  const bar = h("progress", { "aria-label": title, max: 1 });
  const step = h("p.muted", null, "Starting…");
  let id: string | null = null;
  const stop = iconButton("close", "Stop", () => {
    stop.disabled = true;
    step.textContent = "Stopping…";
    if (id !== null) app.api.stopJob(id).catch((error: unknown) => app.fail(error));
  });
  const note = h("div.toast.job", { "data-testid": "job", role: "status" }, h("div.body", null, h("p", null, title), bar, step), stop);
  document.querySelector(".toasts")?.append(note);
  const tell = (text: string, share: number | null): void => {
    step.textContent = text;
    if (share === null) bar.removeAttribute("value");
    else bar.value = share;
  };
  try {
    let job = await start(tell);
    id = job.id;
    while (job.state === "waiting" || job.state === "running") {
      await new Promise((resolve) => setTimeout(resolve, ASK_MS));
      job = await app.api.job(job.id).catch((error: unknown) => {
        if (error instanceof ApiError && error.offline) return job;
        throw error;
      });
      if (!stop.disabled) tell(said(job), job.total > 0 ? job.done / job.total : null);
    }
    if (job.state === "failed" && job.error !== null) throw new ApiError(0, job.error);
    if (job.state === "stopped") app.notify(`${title} was stopped.`);
    return job.state === "done" ? job : null;
  } catch (error) {
    app.fail(error);
    return null;
  } finally {
    note.remove();
  }
}

function said(job: Job): string {
  if (job.state === "waiting") return "Waiting for what was started before…";
  const count = job.total > 1 ? `, ${Math.min(job.done + 1, job.total)} of ${job.total}` : "";
  return `${job.step || "Working"}${count}…`;
}

/** Sends files and starts what is to be made of them. */
export async function sendFiles(app: Worker, files: File[], tell: (text: string, share: number | null) => void): Promise<string> {
  return app.api.upload(files, (done, total) => tell(`Sending ${megabytes(done)} of ${megabytes(total)}…`, total > 0 ? done / total : null));
}

export function megabytes(bytes: number): string {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}

/** The findings of a job, as a note. */
export function findings(app: Worker, job: Job, text: string): void {
  const found = (job.result?.findings ?? []) as string[];
  app.notify(text, found.slice(0, 5).join(" · "));
}
