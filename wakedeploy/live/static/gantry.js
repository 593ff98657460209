// The gantry from the side: source above, its jet, the sufferer on its carriage, forces as arrows.
// The jet is drawn from the source's own pulses: each slice is air that left the source when the
// rig file's wake speed says, as wide as its diffusivity and as strong as its decay leave it.

const NS = "http://www.w3.org/2000/svg";
const M = 220; // units of the drawing per metre
const SLICES = 36;
const N = 70; // units per newton of an arrow

function make(parent, name, attributes = {}) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  parent.append(element);
  return element;
}

export function curve(pulses, thrusts, pulse) {
  if (pulse === null || pulse <= pulses[0]) return thrusts[0];
  const i = pulses.findIndex((p) => p >= pulse);
  if (i < 0) return thrusts.at(-1);
  const share = (pulse - pulses[i - 1]) / (pulses[i] - pulses[i - 1]);
  return thrusts[i - 1] + share * (thrusts[i] - thrusts[i - 1]);
}

export class Gantry {
  constructor(svg) {
    this.svg = svg;
    this.rig = null;
  }

  y(z) {
    return (this.rig.source_height_m - z) * M;
  }

  build(rig) {
    this.rig = rig;
    const [left, right] = rig.x_limits_m;
    const half = Math.max(-left, right) * M + 60;
    const bottom = rig.source_height_m * M;
    this.svg.setAttribute("viewBox", `${-half} -52 ${2 * half} ${bottom + 88}`);
    this.svg.querySelectorAll("g").forEach((old) => old.remove());
    const root = make(this.svg, "g", { fill: "none", "stroke-linecap": "round" });
    this.beams(root, half, bottom, left, right);
    this.jet = this.slices(make(root, "g"));
    this.reference = make(root, "line", { x1: -half + 14, x2: half - 14, "stroke-width": 2.5, "stroke-dasharray": "10 8", class: "g-reference" });
    this.source = rotor(make(root, "g", { transform: "translate(0 14)" }), rig.rotor_radius_m * M);
    this.carriage = make(root, "g");
    this.rail(this.carriage, bottom);
    this.sufferer = make(this.carriage, "g");
    rotor(make(this.sufferer, "g", { transform: "translate(0 -16)" }), rig.rotor_radius_m * M);
    make(this.sufferer, "rect", { x: -26, y: -10, width: 52, height: 20, rx: 5, class: "g-body" });
    this.measured = arrow(this.sufferer, "g-measured", -13);
    this.predicted = arrow(this.sufferer, "g-predicted", 13);
    this.place({ x_m: 0, z_m: 0, z_ref_m: 0 });
  }

  beams(root, half, bottom, left, right) {
    make(root, "line", { x1: -half + 8, x2: half - 8, y1: -14, y2: -14, class: "g-beam", "stroke-width": 9 });
    make(root, "line", { x1: 0, x2: 0, y1: -14, y2: 6, class: "g-beam", "stroke-width": 7 });
    make(root, "line", { x1: -half + 8, x2: half - 8, y1: bottom + 24, y2: bottom + 24, class: "g-beam", "stroke-width": 9 });
    for (const x of [left, right]) {
      make(root, "line", { x1: x * M, x2: x * M, y1: bottom + 12, y2: bottom + 36, class: "g-limit", "stroke-width": 3 });
    }
  }

  rail(root, bottom) {
    const top = this.y(this.rig.travel_m) - 20;
    make(root, "line", { x1: 0, x2: 0, y1: top, y2: bottom + 16, class: "g-rail", "stroke-width": 5 });
    make(root, "rect", { x: -34, y: bottom + 12, width: 68, height: 18, rx: 6, class: "g-carriage" });
  }

  slices(root) {
    const depth = this.rig.source_height_m * M;
    return Array.from({ length: SLICES }, (_, i) => {
      const [y0, y1] = [20 + (i * (depth - 20)) / SLICES, 20 + ((i + 1) * (depth - 20)) / SLICES];
      const [w0, w1] = [this.width(y0 / M), this.width(y1 / M)];
      const points = `${-w0},${y0} ${w0},${y0} ${w1},${y1} ${-w1},${y1}`;
      return make(root, "polygon", { points, class: "g-jet", "fill-opacity": 0 });
    });
  }

  // Half the width that is drawn, 1.5 standard deviations, of a jet `depth` metres below the source.
  width(depth) {
    const spread = 2 * this.rig.wake_diffusivity_m2ps * (depth / this.rig.wake_mps);
    return 1.5 * M * Math.sqrt(this.rig.wake_width_m ** 2 / 2 + spread);
  }

  // past(t): the source's pulse at an earlier time [µs], or null.
  show(now, past) {
    if (!this.rig) return;
    this.place(now);
    this.measured(now.force_n);
    this.predicted(now.force_pred_n);
    this.blow(now.t_s, past);
  }

  // What stands nobody knows where is not drawn: its last place, or zero, would be read as its place now.
  place(now) {
    const shows = (element, value) => (element.style.display = value === null ? "none" : "");
    shows(this.carriage, now.x_m);
    shows(this.sufferer, now.z_m);
    shows(this.reference, now.z_ref_m);
    this.carriage.setAttribute("transform", `translate(${now.x_m * M} 0)`);
    this.sufferer.setAttribute("transform", `translate(0 ${this.y(now.z_m)})`);
    const at = this.y(now.z_ref_m);
    this.reference.setAttribute("y1", at);
    this.reference.setAttribute("y2", at);
  }

  blow(t, past) {
    const { rig } = this;
    const most = rig.source_thrust_n.at(-1);
    this.jet.forEach((slice, i) => {
      const age = ((i + 0.5) / SLICES) * (rig.source_height_m / rig.wake_mps);
      const thrust = curve(rig.source_pulse_us, rig.source_thrust_n, past(t - age));
      const share = (thrust / most) * Math.exp(-rig.wake_decay_per_s * age);
      slice.setAttribute("fill-opacity", Math.min(0.62, 1.1 * share).toFixed(3));
    });
  }
}

function rotor(root, radius) {
  make(root, "line", { x1: -radius, x2: radius, y1: 0, y2: 0, class: "g-blade", "stroke-width": 6 });
  make(root, "circle", { r: 7, class: "g-hub" });
  return root;
}

// A vertical arrow from the sufferer, as long as its force; upward forces point up.
function arrow(root, kind, x) {
  const line = make(root, "path", { class: kind, "stroke-width": 6, "stroke-linejoin": "round" });
  return (force) => {
    if (force === null || Math.abs(force) < 0.03) {
      line.setAttribute("d", "");
      return;
    }
    const length = Math.max(-150, Math.min(150, force * N));
    const [from, sign] = [length < 0 ? 18 : -26, Math.sign(length)];
    const tip = from - length;
    line.setAttribute("d", `M${x} ${from}V${tip}M${x - 8} ${tip + 10 * sign}L${x} ${tip}L${x + 8} ${tip + 10 * sign}`);
  };
}
