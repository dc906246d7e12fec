// The line to the server: what it tells as it happens, kept up while a session is open.

import { liveMessage } from "./api";
import type { LiveMessage } from "./types";

const AGAIN_MS = 1000;
const PRESENCE_MS = 200;

/** Where somebody is, and what they have selected. */
export interface Presence {
  name: string;
  layer: string;
  frame: number;
  selection: string | null;
}

export class Line {
  private socket: WebSocket | null = null;
  private again = 0;
  private telling = 0;

  constructor(
    private readonly open: (sid: string) => WebSocket,
    private readonly told: (message: LiveMessage) => void,
    private readonly connected: (connected: boolean) => void,
    private readonly presence: () => Presence,
  ) {}

  connect(sid: string): void {
    this.close();
    const socket = this.open(sid);
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.connected(true);
      this.moved();
    });
    socket.addEventListener("message", ({ data }) => {
      const message = liveMessage(data);
      if (message !== null && this.socket === socket) this.told(message);
    });
    socket.addEventListener("close", () => {
      if (this.socket !== socket) return;
      this.connected(false);
      this.again = window.setTimeout(() => this.connect(sid), AGAIN_MS);
    });
  }

  /** Tells the others where this person is, soon. */
  moved(): void {
    clearTimeout(this.telling);
    this.telling = window.setTimeout(() => {
      if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type: "presence", ...this.presence() }));
    }, PRESENCE_MS);
  }

  close(): void {
    const socket = this.socket;
    this.socket = null;
    clearTimeout(this.again);
    clearTimeout(this.telling);
    socket?.close();
  }
}
