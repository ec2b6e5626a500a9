// The live feed: one WebSocket that comes back by itself.

const FIRST_RETRY_S = 0.5;
const LAST_RETRY_S = 8;
const GREETED_WITHIN_S = 5;
const EVERY_S = 0.5; // readings for the eye; what is drawn comes from the store

/** Calls `onMessage(object)` per frame and `onLink({state, retryAt, reason})`, state "connecting" | "live" | "down". */
export class LiveLink {
  #socket = null;
  #retry_s = FIRST_RETRY_S;
  #timer = 0;

  constructor(onMessage, onLink) {
    Object.assign(this, { onMessage, onLink });
  }

  open() {
    clearTimeout(this.#timer);
    this.#drop();
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/v1/live?every_s=${EVERY_S}`);
    this.#socket = socket;
    this.onLink({ state: "connecting" });
    this.#timer = setTimeout(() => this.#lost(socket), GREETED_WITHIN_S * 1000);
    // Open is not yet live: a service with too many readers opens only to say so. It greets those it takes.
    socket.onmessage = (event) => {
      this.#greeted();
      socket.onmessage = (next) => this.#received(next.data);
      this.#received(event.data);
    };
    socket.onclose = (event) => this.#lost(socket, event.reason);
  }

  /** Give the connection up and try again: for a link that is open but whose other end no longer answers. */
  renew() {
    this.#lost(this.#socket);
  }

  #greeted() {
    clearTimeout(this.#timer);
    this.#retry_s = FIRST_RETRY_S;
    this.onLink({ state: "live" });
  }

  #received(text) {
    let message;
    try {
      message = JSON.parse(text);
    } catch {
      return; // not ours to repair; the next frame carries the whole state again
    }
    this.onMessage(message);
  }

  #drop() {
    const socket = this.#socket;
    this.#socket = null;
    if (!socket) return;
    socket.onmessage = socket.onclose = null;
    socket.close();
  }

  #lost(socket, reason = "") {
    if (socket !== this.#socket) return;
    clearTimeout(this.#timer);
    this.#drop();
    // Jitter, so that the pages of a whole laboratory do not come back in the same instant.
    const wait_s = this.#retry_s * (0.75 + 0.5 * Math.random());
    this.#retry_s = Math.min(LAST_RETRY_S, this.#retry_s * 2);
    this.#timer = setTimeout(() => this.open(), wait_s * 1000);
    this.onLink({ state: "down", reason, retryAt: Date.now() + wait_s * 1000 });
  }
}
