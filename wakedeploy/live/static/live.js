// The page of one flight, as it is flown or from its log.

import { Strip } from "./charts.js";
import { Gantry } from "./gantry.js";
import { Link } from "./link.js";
import { Timeline, modeName } from "./timeline.js";

const SPAN_S = 30;
const KEPT_S = 125;
const HOLE_S = 0.4; // without rows: drawn as a gap
const NO_ANSWER_MS = 1000;
const BEAT_MS = 400; // between two beats of a page that has begun the flight

const $ = (id) => document.getElementById(id);
const holder = sessionStorage.holder ??= crypto.randomUUID?.() ?? String(Math.random()).slice(2);

let columns = [];
let rows = { t_s: [] }; // one array per column; the first frame says which there are
let state = {};
let armWord = null;
let holdsFlight = false;
let stopAsked = 0; // when STOP was pressed here, until the server has heard of it
let isUnheard = false; // STOP was pressed, and the server has not answered
let linkWord = "";
let beatAt = 0;

const narrow = () => matchMedia("(max-width: 760px)").matches;
const tall = (wide, phone) => () => (narrow() ? phone : wide);
let strips = null;
const gantry = new Gantry($("gantry"));
const timeline = new Timeline($("line"), $("events"));

function buildStrips() {
  const [lowest, highest] = [Math.min(0, state.rig.z_limits_m[0]), state.rig.z_limits_m[1]];
  strips = {
    height: new Strip($("chart-height"), {
      series: [{ label: "reference", colour: "reference", dash: [6, 5], width: 1.5 }, { label: "height", colour: "accent" }],
      low: lowest, high: highest, height: tall(176, 160), digits: 1,
    }),
    force: new Strip($("chart-force"), {
      series: [{ label: "predicted", colour: "predicted", width: 1.75 }, { label: "measured", colour: "accent" }],
      low: -1.5, high: 0.5, height: tall(138, 140), digits: 1,
    }),
    compute: new Strip($("chart-compute"), {
      series: [{ label: "budget", colour: "soft", dash: [6, 5], width: 1.5 }, { label: "computing", colour: "accent", width: 1.5 }],
      low: 0, high: 1.25e3 * state.rig.budget_s, height: tall(96, 110), digits: 0,
    }),
  };
}

function forget() {
  rows = Object.fromEntries(columns.map((name) => [name, []]));
}

function take(values) {
  const times = rows.t_s;
  const last = times.at(-1);
  if (last !== undefined && values[0] - last > HOLE_S) {
    columns.forEach((name, i) => rows[name].push(i === 0 ? last + 0.01 : null));
  }
  columns.forEach((name, i) => rows[name].push(values[i]));
}

function trim() {
  const times = rows.t_s;
  const first = times.findIndex((t) => t > times.at(-1) - KEPT_S);
  if (first > 320) columns.forEach((name) => (rows[name] = rows[name].slice(first)));
}

function newest() {
  const i = rows.t_s.length - 1;
  return i < 0 ? null : Object.fromEntries(columns.map((name) => [name, rows[name][i]]));
}

// The source's pulse at a time, from the rows [µs].
function pulseAt(t) {
  const times = rows.t_s;
  let [low, high] = [0, times.length - 1];
  if (high < 0 || t < times[0]) return null;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle - 1;
  }
  return rows.source_us[low];
}

function hears(frame) {
  if (frame.columns) columns = frame.columns;
  if (frame.isNew) forget();
  frame.rows.forEach(take);
  if (frame.rows.length) trim();
  if (frame.state) heard(frame.state);
  requestAnimationFrame(draw);
}

// Not by a timer: browsers slow those of a page that is not in front.
function asked() {
  const now = performance.now();
  if (!holdsFlight || now - beatAt < BEAT_MS) return;
  beatAt = now;
  link.send({ do: "beat", holder });
}

function heard(news) {
  const hadRig = Boolean(state.rig);
  state = news;
  if (state.rig && !hadRig) buildStrips();
  if (state.rig) gantry.build(state.rig);
  const replays = state.kind === "replay";
  document.body.classList.toggle("is-replay", replays);
  $("ask").hidden = replays;
  $("player").hidden = !replays;
  $("arming").hidden = !state.arm;
  $("force-legend").textContent = replays ? "smoothed from the range samples" : "measured";
  if (!state.arm && $("arm-dialog").open && state.phase === "standby") $("arm-dialog").close();
  if (state.phase === "ended") holdsFlight = false;
  if (state.stopped) [stopAsked, isUnheard] = [0, false];
  tellStop();
  tellNotice();
  tellLink();
  if (replays) tellPlayer();
  tellAbout();
}

function tellAbout() {
  document.title = state.title ? `${state.title} – wakedeploy` : "wakedeploy";
  $("title").textContent = state.kind === "replay" ? `Replay of ${state.title}` : state.title ?? "";
  $("log").textContent = state.kind === "replay" ? "" : recording();
  if (state.untimed) $("budget").textContent = $("compute-legend").textContent = state.untimed;
  else if (state.rig) $("budget").textContent = `of ${(1e3 * state.rig.budget_s).toFixed(2)} ms, last 30 s`;
  $("gap-says").textContent = state.watches_gap ? "1 is the limit" : state.kind === "replay" ? "not recorded" : "off; --watch-gap";
}

function recording() {
  if (state.log === undefined) return "–"; // the run has not said it yet
  const begun = state.phase !== "standby";
  return state.log ? `${begun ? "Recorded" : "To be recorded"} in ${state.log}` : "Not recorded";
}

function tellStop() {
  const button = $("stop");
  const over = state.phase === "ended";
  const acts = state.stop === "acted on";
  button.disabled = over || acts;
  button.textContent = over ? "ENDED" : acts ? "STOPPED" : state.stop ? "STOP SENT" : "STOP";
}

// What a person has to know now, the most urgent first; whether it is in red.
function urgent() {
  if (linkWord === "token") return [WORDS.token, true];
  if (state.phase === "ended") {
    const why = state.stopped ? ` (${state.stopped})` : "";
    const how = state.reason ?? `${state.ended}${why}.`;
    return [`The run has ended: ${how} What was flown stays here until this page is closed.`, false];
  }
  if (linkWord === "lost") return state.kind === "replay" ? [WORDS.over, false] : [WORDS.lost, state.kind === "flight"];
  if (isUnheard) return [WORDS.unheard, true];
  if (state.stop === "unanswered") return [WORDS.unanswered, true];
  if (state.silent) return [WORDS.silent, true];
  if (state.stop === "sent") return [`STOP sent: ${state.stopped}. The loop has not answered yet.`, false];
  if (state.stop) return [`Stopped: ${state.stopped}. The sufferer comes down. It stays stopped for this run.`, false];
  return ["", false];
}

function tellNotice() {
  const [text, grave] = urgent();
  const place = $("notice");
  place.hidden = !text;
  if (place.textContent !== text) place.textContent = text;
  place.classList.toggle("is-grave", grave);
}

function stop() {
  if (state.kind !== "flight" || $("stop").disabled) return;
  if (!state.stopped) stopAsked = performance.now();
  link.stop();
  setTimeout(() => {
    isUnheard = Boolean(stopAsked);
    tellNotice();
  }, NO_ANSWER_MS);
}

// Drawing.

const columnsOf = (...names) => [rows.t_s, ...names.map((name) => rows[name])];
const inMs = (values) => values.map((value) => (value === null ? null : 1e3 * value));

function draw() {
  const now = newest();
  tellMode(now);
  if (!strips || !now) return;
  const end = Math.max(now.t_s, rows.t_s[0] + SPAN_S);
  strips.height.show(columnsOf("z_ref_m", "z_m"), end, SPAN_S);
  strips.force.show(columnsOf("force_pred_n", "force_n"), end, SPAN_S);
  const budget = rows.t_s.map(() => 1e3 * state.rig.budget_s);
  strips.compute.show([rows.t_s, budget, inMs(rows.compute_s)], end, SPAN_S);
  gantry.show(now, pulseAt);
  tellLine(now);
  tellNumbers(now);
}

function tellLine(now) {
  const events = state.events ?? [];
  const begin = state.begin_s ?? 0;
  const end = state.end_s ?? Math.max(now.t_s, SPAN_S);
  timeline.draw(events, begin, end, now.t_s);
  timeline.tell(events, state.hints ?? {});
  const digits = state.end_s === undefined ? 0 : 1; // of a flight in the air the end moves
  $("line-span").textContent = `${begin.toFixed(digits)} to ${end.toFixed(digits)} s`;
}

const PHASES = { starting: "Starting", standby: "Standing by", "about to fly": "About to fly", ended: "Ended" };

function tellMode(now) {
  const flies = now && !state.silent && (state.phase === "flying" || state.phase === "replay");
  const mode = flies ? now.mode : "";
  const name = state.silent ? "No data" : mode ? modeName(mode) : PHASES[state.phase] ?? "Connecting";
  $("mode").dataset.mode = state.phase === "ended" ? "DISARMED" : mode;
  if ($("mode-name").textContent !== name) $("mode-name").textContent = name;
  const faults = (flies && now.faults) || "";
  const more = state.silent ? `last: ${modeName(now?.mode ?? "")}` : faults ? faults.split("+").map((one) => one.replaceAll("_", " ")).join(", ") : (mode && mode !== name ? mode : state.ended ?? "");
  $("mode-more").textContent = more || "\u00a0";
}

const mm = (metres) => (metres === null ? "–" : (1e3 * metres).toFixed(0).replace("-", "−").replace(/^−0$/, "0"));

function tellNumbers(now) {
  $("z").textContent = mm(now.z_m);
  $("z-ref").textContent = mm(now.z_ref_m);
  $("error").textContent = now.z_m === null || now.z_ref_m === null ? "–" : mm(now.z_ref_m - now.z_m);
  $("t").textContent = now.t_s.toFixed(1);
  const lately = (name) => recent(rows[name], 32 * SPAN_S);
  $("p99").textContent = ms(quantile(lately("compute_s"), 0.99));
  $("trip").textContent = ms(quantile(lately("round_trip_s"), 0.5));
  const volts = lately("battery_v").at(-1);
  $("battery").textContent = volts === undefined ? "–" : `${volts.toFixed(2)} V`;
  $("battery-says").textContent = volts === undefined ? "not measured" : "at the board";
  const score = lately("gap_score").at(-1);
  $("gap").textContent = score === undefined ? "–" : score.toFixed(2);
}

const recent = (values, count) => values.slice(-count).filter((value) => value !== null);
const ms = (seconds) => (seconds === null ? "–" : `${(1e3 * seconds).toFixed(2)} ms`);

function quantile(values, share) {
  if (!values.length) return null;
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

// Replay.

function tellPlayer() {
  $("play").textContent = state.plays ? "Pause" : "Play";
  const select = $("speed");
  if (!select.options.length) {
    select.replaceChildren(...state.speeds.map((speed) => new Option(`${speed} ×`, speed)));
  }
  select.value = state.speed;
  $("place").min = state.begin_s;
  $("place").max = state.end_s;
}

function follow() {
  const now = newest();
  if (state.kind === "replay" && now && document.activeElement !== $("place")) $("place").value = now.t_s;
}
setInterval(follow, 200);

function seek(place) {
  link.send({ do: "seek", value: place });
}

// Arming.

function openArming() {
  armWord = null;
  $("arm-yes").disabled = true;
  $("arm-says").hidden = true;
  $("arm-dialog").showModal();
  link.send({ do: "arm" });
}

function answered(answer, refused) {
  if (refused) {
    $("arm-says").hidden = false;
    $("arm-says").textContent = refused;
    $("arm-yes").disabled = true;
  } else if (answer.confirm) {
    armWord = answer.confirm;
    setTimeout(() => ($("arm-yes").disabled = false), 700); // a double click does not confirm
    setTimeout(() => ($("arm-yes").disabled = true), 9500);
  } else if (answer.confirmed) {
    holdsFlight = true;
    $("arm-dialog").close();
  }
}

// What a person does.

$("stop").addEventListener("click", stop);
$("play").addEventListener("click", () => link.send({ do: state.plays ? "pause" : "play" }));
$("speed").addEventListener("change", (event) => link.send({ do: "speed", value: Number(event.target.value) }));
$("place").addEventListener("change", (event) => seek(Number(event.target.value)));
$("place").addEventListener("pointerup", (event) => event.target.blur());
$("line").addEventListener("click", (event) => {
  if (state.kind !== "replay") return;
  const share = event.offsetX / event.target.clientWidth;
  seek(state.begin_s + share * (state.end_s - state.begin_s));
});
$("arm").addEventListener("click", openArming);
$("arm-no").addEventListener("click", () => $("arm-dialog").close());
$("arm-yes").addEventListener("click", () => link.send({ do: "confirm", word: armWord, holder }));

document.addEventListener("keydown", (event) => {
  if ($("arm-dialog").open || event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key === "Escape") stop();
  if (state.kind !== "replay" || ["INPUT", "SELECT", "BUTTON"].includes(document.activeElement.tagName)) return;
  const at = newest()?.t_s ?? 0;
  if (event.key === " ") $("play").click();
  else if (event.key === "ArrowLeft") seek(at - 5);
  else if (event.key === "ArrowRight") seek(at + 5);
  else return;
  event.preventDefault();
});

const WORDS = {
  over: "The program that replays has ended, or is out of reach.",
  unheard: "STOP was not answered: use the emergency stop.",
  unanswered: "STOP was sent, and the loop has not answered: use the emergency stop. STOP is sent again every second.",
  silent: "The loop has sent nothing for more than a second: what is shown is old. If the sufferer does not come down, use the emergency stop.",
  lost: "The connection to the loop is lost; trying again. STOP here reaches nobody: use the emergency stop.",
  token: "The token is missing or wrong: open the address that the program printed, with what stands behind the #.",
};

const LINKS = { live: "connected", lost: "connection lost", ended: "the run has ended", token: "no token" };

function tellLink() {
  const isSilent = state.silent && linkWord === "live";
  $("link").textContent = isSilent ? "connected; the loop is silent" : LINKS[linkWord];
}

function changed(word) {
  linkWord = word;
  document.body.dataset.link = word;
  tellLink();
  tellNotice();
  if (word === "token") $("mode-name").textContent = "No token";
}

const link = new Link({ hears, asked, answered, changed });
window.wakedeploy = { link, rows: () => rows, state: () => state }; // for the console, and for tests
