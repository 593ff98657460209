// One or two recorded flights over one another: strips with a common cursor and zoom, modes and
// faults below, and a way from fault to fault. It serves the browser's page and exported files.
/* global uPlot */

import { chartAxes, colour, FONT } from "./charts.js";
import { Timeline, faultText } from "./timeline.js";

const STRIPS = [
  { name: "Height [m]", of: ["z_ref_m", "z_m"], dashed: "z_ref_m", digits: 3, height: 190 },
  { name: "Error under control [mm]: reference less height", of: ["error_mm"], digits: 1, height: 120 },
  { name: "Force of the wake [N]: measured, dashed as predicted", of: ["force_pred_n", "force_n"], dashed: "force_pred_n", digits: 2, height: 150 },
  { name: "Computing [ms]", of: ["compute_ms"], digits: 2, height: 100 },
];
const FLOWN = ["RUNNING", "DEGRADED"];
const AROUND_S = 3; // a fault, to either side

const minus = (a, b, scale) => a.map((value, i) => (value === null || b[i] === null ? null : scale * (value - b[i])));

// What is drawn, from what was recorded. The error counts under control, as tracking does.
function derived(flight) {
  const { columns } = flight;
  const aim = columns.z_ref_m.map((value, i) => (FLOWN.includes(columns.mode[i]) ? value : null));
  return {
    ...columns,
    error_mm: minus(aim, columns.z_m, 1e3),
    compute_ms: columns.compute_s.map((value) => (value === null ? null : 1e3 * value)),
  };
}

function element(name, properties = {}, ...inside) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...inside);
  return made;
}

export class FlightView {
  constructor(root) {
    this.root = root;
    this.key = `flights-${Math.random()}`;
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.flights && this.show(this.flights));
    new ResizeObserver(() => this.resize()).observe(root);
  }

  show(flights) {
    this.flights = flights;
    this.plots?.forEach((plot) => plot.destroy());
    this.strips = element("div", { className: "strips" });
    const canvas = element("canvas", { height: 46 });
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "Modes and faults of the first flight; the line below steps through the faults");
    const list = element("ol", { hidden: true });
    this.band = element("div", { className: "view-line" }, canvas);
    this.root.replaceChildren(this.names(), this.strips, this.band, list, this.steps());
    this.tables = flights.map(derived);
    this.plots = STRIPS.filter((strip) => this.has(strip)).map((strip) => this.strip(strip));
    this.timeline = new Timeline(canvas, list);
    this.faults = flights.flatMap((one, i) => one.events.filter((e) => e[1] === "fault").map((e) => [...e, i])).sort((a, b) => a[0] - b[0]);
    this.at = -1;
    this.tellFault();
    this.line();
  }

  names() {
    const told = this.flights.map((one) => {
      const error = one.tracking_mm === null ? "not flown under control" : `tracking RMSE ${one.tracking_mm.toFixed(1)} mm`;
      const date = one.started ? one.started.replace("T", " ").replace("+00:00", " UTC") : one.simulated ? "simulated" : "";
      const more = [date, error, ...one.notes];
      if (one.every > 1) more.push(`every ${one.every}. tick drawn`);
      return element("li", {}, element("b", { textContent: one.name }), element("span", { className: "soft", textContent: more.filter(Boolean).join(" · ") }));
    });
    return element("ol", { className: "names" }, ...told);
  }

  has(strip) {
    return strip.of.some((name) => this.tables.some((table) => table[name].some((value) => value !== null)));
  }

  // One strip: the times of both flights joined, a line for each column of each.
  strip(strip) {
    const values = element("span", { className: "values soft" });
    const place = element("div");
    this.strips.append(element("section", { className: "strip chart" }, element("h2", {}, element("span", { textContent: strip.name }), values), place));
    const tables = this.tables.map((table) => [table.t_s, ...strip.of.map((name) => table[name])]);
    const data = tables.length > 1 ? uPlot.join(tables, tables.map((table) => table.map(() => 2))) : tables[0];
    const series = this.tables.flatMap((_, flight) => strip.of.map((name) => this.series(name === strip.dashed, flight)));
    return new uPlot(
      {
        width: Math.max(this.root.clientWidth, 200),
        height: strip.height,
        legend: { show: false },
        padding: [6, 14, 0, 0],
        cursor: { sync: { key: this.key }, points: { size: 6 }, drag: { x: true, y: false } },
        scales: { x: { time: false } },
        axes: chartAxes((v) => `${+v.toFixed(6)}`),
        series: [{}, ...series],
        hooks: {
          setSize: [(plot) => plot === this.plots?.[0] && this.line()], // only now it has its new size
          setCursor: [(plot) => (values.textContent = this.values(plot, strip))],
          setScale: [(plot, key) => key === "x" && this.zoomed(plot)],
        },
      },
      data,
      place,
    );
  }

  series(isDashed, flight) {
    const own = flight === 0 ? "accent" : "second";
    return {
      stroke: colour(isDashed && flight === 0 ? "soft" : own),
      width: isDashed ? 1.25 : 1.75,
      dash: isDashed ? [5, 4] : undefined,
      points: { show: false },
      spanGaps: false,
    };
  }

  values(plot, strip) {
    const i = plot.cursor.idx;
    if (i === null || i === undefined) return "";
    const told = plot.data.slice(1).map((column) => (column[i] === null || column[i] === undefined ? "–" : column[i].toFixed(strip.digits)));
    return `${plot.data[0][i].toFixed(2)} s:  ${told.join("   ")}`;
  }

  // All strips show the same stretch of time.
  zoomed(plot) {
    if (this.busy || !this.plots) return;
    this.busy = true;
    const { min, max } = plot.scales.x;
    for (const other of this.plots) if (other !== plot) other.setScale("x", { min, max });
    this.busy = false;
    this.line();
  }

  zoom(min, max) {
    this.plots[0]?.setScale("x", { min, max });
  }

  // The band below has the time axis of the strips.
  line() {
    const plot = this.plots[0];
    const x = plot?.scales.x;
    if (plot) {
      const { offsetLeft, offsetWidth } = plot.over;
      this.band.style.marginLeft = `${offsetLeft}px`;
      this.band.style.width = `${offsetWidth}px`;
    }
    const [first] = this.flights;
    const end = first.columns.t_s.at(-1) ?? 0;
    const from = x?.min ?? first.columns.t_s[0] ?? 0;
    this.timeline.draw(first.events, from, x?.max ?? end, end);
  }

  steps() {
    this.before = element("button", { type: "button", textContent: "← Fault", onclick: () => this.step(-1) });
    this.after = element("button", { type: "button", textContent: "Fault →", onclick: () => this.step(1) });
    const whole = element("button", { type: "button", textContent: "Whole flight", onclick: () => this.whole() });
    this.what = element("span", { className: "what" });
    this.what.setAttribute("role", "status");
    return element("div", { className: "steps" }, this.before, this.after, whole, this.what);
  }

  whole() {
    const times = this.tables.flatMap((table) => [table.t_s[0], table.t_s.at(-1)]);
    this.zoom(Math.min(...times), Math.max(...times));
  }

  step(by) {
    const next = this.at + by;
    if (next < 0 || next >= this.faults.length) return;
    this.at = next;
    const [t] = this.faults[next];
    this.zoom(t - AROUND_S, t + AROUND_S);
    this.tellFault();
  }

  tellFault() {
    const count = this.faults.length;
    this.before.disabled = this.at <= 0;
    this.after.disabled = this.at >= count - 1;
    if (!count) this.what.textContent = "No faults.";
    else if (this.at < 0) this.what.textContent = count === 1 ? "One fault." : `${count} faults.`;
    else {
      const [t, , name, flight] = this.faults[this.at];
      const whose = this.flights.length > 1 ? `, ${this.flights[flight].name}` : "";
      this.what.textContent = `${this.at + 1} of ${count}, ${t.toFixed(2)} s${whose}: ${faultText(name, this.flights[flight].hints)}`;
    }
  }

  resize() {
    const width = Math.max(this.root.clientWidth, 200);
    this.plots?.forEach((plot) => plot.width !== width && plot.setSize({ width, height: plot.height }));
  }
}
