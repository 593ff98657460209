// The way to the server: says the token, takes rows and state, comes back after a loss.

const WAITS_MS = [300, 600, 1200, 2000];
const SILENCE_MS = 3000;
const FINAL = { 4000: "ended", 4401: "token", 4403: "token" };

export function token() {
  return location.hash.slice(1);
}

export class Link {
  // `hears(frame)` for rows and state, `asked()` with every message, `answered(answer | null, refusal)`, `changed(word)` for the
  // connection itself: "live", "lost", "ended", "token".
  constructor({ hears, asked, answered, changed }) {
    this.hears = hears;
    this.asked = asked;
    this.answered = answered;
    this.changed = changed;
    this.seen = -1;
    this.epoch = "";
    this.tries = 0;
    this.heardAt = performance.now();
    setInterval(() => this.listen(), 500);
    this.connect();
  }

  // A server that is out of reach closes nothing: its silence tells.
  listen() {
    const open = this.socket?.readyState === WebSocket.OPEN;
    if (!open || performance.now() - this.heardAt < SILENCE_MS) return;
    this.socket.onclose = this.socket.onmessage = null;
    this.socket.close();
    this.lost(0);
  }

  connect() {
    if (!token()) {
      this.changed("token");
      return;
    }
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.heardAt = performance.now();
    this.socket.onopen = () => this.send({ token: token(), seen: this.seen, epoch: this.epoch });
    this.socket.onmessage = (event) => this.take(JSON.parse(event.data));
    this.socket.onclose = (event) => this.lost(event.code);
  }

  take(message) {
    this.heardAt = performance.now();
    this.asked();
    if (message.there) return;
    if ("answer" in message) {
      this.answered(message.answer, message.answer.refused);
      return;
    }
    this.tries = 0;
    message.isNew = message.epoch !== this.epoch;
    this.seen = message.seen;
    this.epoch = message.epoch;
    this.changed("live");
    this.hears(message);
  }

  lost(code) {
    if (FINAL[code]) {
      this.changed(FINAL[code]);
      return;
    }
    this.changed("lost");
    const wait = WAITS_MS[Math.min(this.tries++, WAITS_MS.length - 1)];
    setTimeout(() => this.connect(), wait);
  }

  send(wish) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(wish));
    return true;
  }

  // STOP goes both ways at once: over the socket, and by a request of its own.
  stop() {
    this.send({ do: "stop" });
    fetch("/stop", {
      method: "POST",
      keepalive: true,
      headers: { Authorization: `Bearer ${token()}` },
    }).catch(() => {});
  }
}
