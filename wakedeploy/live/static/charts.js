// Strips over time, drawn by uPlot: a fixed window, scales that only grow, colours of the page.
/* global uPlot */

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export const FONT = '11px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif';

const SECONDS = [0.1, 0.2, 0.5, 1, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 3600];
const INCREMENTS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

// The two axes of every chart: seconds below, `told(value)` at the left.
export function chartAxes(told) {
  const axis = { stroke: colour("soft"), font: FONT, ticks: { show: false }, grid: { stroke: colour("grid"), width: 1 } };
  return [
    { ...axis, size: 22, space: 60, incrs: SECONDS, values: (_, ticks) => ticks.map((t) => `${+t.toFixed(2)} s`), grid: { show: false } },
    { ...axis, size: 44, space: 24, incrs: INCREMENTS, values: (_, ticks) => ticks.map(told) },
  ];
}

// series: [{ label, colour, dash, width }]; low and high are where the scale begins.
export class Strip {
  constructor(element, { series, low, high, height, digits = 2, growth = 1.15 }) {
    Object.assign(this, { element, series, low, high, height, digits, growth });
    this.data = [[], ...series.map(() => [])];
    this.window = { min: 0, max: 30 };
    this.draw();
    new ResizeObserver(() => this.resize()).observe(element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  size() {
    return { width: Math.max(this.element.clientWidth, 120), height: this.height() };
  }

  resize() {
    this.plot.setSize(this.size());
  }

  draw() {
    this.plot?.destroy();
    this.plot = new uPlot(
      {
        ...this.size(),
        legend: { show: false },
        cursor: { show: false },
        padding: [8, 14, 0, 0],
        scales: { x: { time: false, auto: false }, y: { auto: false, min: this.low, max: this.high } },
        axes: chartAxes((value) => value.toFixed(this.digits)),
        series: [
          {},
          ...this.series.map((one) => ({
            label: one.label,
            stroke: colour(one.colour),
            width: one.width ?? 2,
            dash: one.dash,
            points: { show: false },
          })),
        ],
      },
      this.data,
      this.element,
    );
    this.show(this.data, this.window.max, this.window.max - this.window.min);
  }

  // columns: [t, one array per series]; the window ends at `end`, `span` seconds long.
  show(columns, end, span) {
    this.data = columns;
    this.grow(columns);
    this.window = { min: end - span, max: end };
    this.plot.batch(() => {
      this.plot.setData(columns, false);
      this.plot.setScale("x", this.window);
      this.plot.setScale("y", { min: this.low, max: this.high });
    });
  }

  grow(columns) {
    for (const values of columns.slice(1)) {
      for (const value of values) {
        if (value === null) continue;
        if (value > this.high) this.high = nice(value * this.growth);
        if (value < this.low) this.low = -nice(-value * this.growth);
      }
    }
  }
}

// The next of 1, 1.5, 2, 3, 5, 7, 10 … that is not less.
function nice(value) {
  const decade = 10 ** Math.floor(Math.log10(value));
  return decade * [1, 1.5, 2, 3, 5, 7, 10].find((step) => step * decade >= value - 1e-12);
}
