// Modes as a band over the whole flight, faults as marks below it, and both as a list of words.

import { colour } from "./charts.js";

const LABELS = {
  DISARMED: "Disarmed", ARMED: "At rest", RUNNING: "Flying", DEGRADED: "PID alone",
  LANDING: "Landing", FAILSAFE: "Failsafe",
};

export function modeName(mode) {
  return LABELS[mode] ?? mode;
}

export class Timeline {
  constructor(canvas, list) {
    this.canvas = canvas;
    this.list = list;
    this.listed = "";
    new ResizeObserver(() => this.again()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.again());
  }

  again() {
    if (this.last) this.draw(...this.last);
  }

  // events: [t, "mode" | "fault", name]; drawn from `begin` to `end`, with a mark at `now`.
  draw(events, begin, end, now) {
    this.last = [events, begin, end, now];
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth;
    if (canvas.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = 46 * ratio;
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, 46);
    const x = (t) => ((t - begin) / Math.max(end - begin, 1e-6)) * width;
    pen.fillStyle = colour("sunk");
    pen.fillRect(0, 6, width, 22);
    this.band(pen, events.filter((e) => e[1] === "mode"), x, now);
    this.marks(pen, events.filter((e) => e[1] === "fault"), x);
    pen.fillStyle = colour("ink");
    pen.fillRect(Math.min(x(now), width - 2), 2, 2, 30);
  }

  band(pen, modes, x, now) {
    pen.font = "600 11px system-ui, -apple-system, sans-serif";
    pen.textBaseline = "middle";
    modes.forEach(([t, , mode], i) => {
      const from = Math.max(x(t), 0);
      const to = x(Math.min(modes[i + 1]?.[0] ?? now, Math.max(now, t)));
      if (to <= from) return;
      pen.fillStyle = colour(`mode-${mode}`);
      pen.fillRect(from, 6, to - from, 22);
      const name = modeName(mode);
      if (pen.measureText(name).width + 12 < to - from) {
        pen.fillStyle = colour("on-mode");
        pen.fillText(name, from + 6, 17);
      }
    });
  }

  marks(pen, faults, x) {
    pen.fillStyle = colour("stop");
    for (const [t] of faults) {
      const at = x(t);
      pen.beginPath();
      pen.moveTo(at, 30);
      pen.lineTo(at - 5, 40);
      pen.lineTo(at + 5, 40);
      pen.fill();
    }
  }

  // The newest first, so that nothing moves away from who reads.
  tell(events, hints) {
    const key = JSON.stringify(events);
    if (key === this.listed) return;
    this.listed = key;
    this.list.replaceChildren(...[...events].reverse().map(([t, kind, name]) => {
      const line = document.createElement("li");
      const when = Object.assign(document.createElement("span"), { className: "t", textContent: `${t.toFixed(1)} s` });
      const what = Object.assign(document.createElement("span"), {
        className: `is-${kind}`,
        textContent: kind === "mode" ? modeName(name) : faultText(name, hints),
      });
      line.append(when, what);
      return line;
    }));
  }
}

export function faultText(name, hints) {
  const hint = hints[name];
  return hint ? hint[0].toUpperCase() + hint.slice(1) : name.replaceAll("_", " ");
}
