// The list of a folder's flights: filter, sort, draw one or two, step through faults, export.

import { token } from "./link.js";
import { Rows } from "./rows.js";
import { FlightView } from "./view.js";

const $ = (id) => document.getElementById(id);
const LATER_MS = 1000;
const KEYS_MS = 120; // an arrow key held down passes over flights, and none of them is read

const number = (digits) => (value) => (value === null || value === undefined ? "–" : value.toFixed(digits));
// A simulated flight may have been at no time of day.
const date = (value, row) => (value ? value.slice(0, 16).replace("T", " ") : row.simulated ? "simulated" : "–");
// Those that are extra a phone has no room for.
const COLUMNS = [
  { key: "started", name: "Date, UTC", shown: date },
  { key: "name", name: "Flight", kind: "name", shown: String },
  { key: "tracking_mm", name: "Tracking [mm]", kind: "number", shown: number(1) },
  { key: "worst_mm", extra: true, name: "Worst [mm]", kind: "number", shown: number(0) },
  { key: "gap", extra: true, name: "Gap score", kind: "number", shown: number(2), bad: (row) => row.gap > 1 },
  { key: "fault_count", name: "Faults", kind: "faults", shown: (_, row) => faults(row), bad: (row) => Boolean(row.failsafe || row.problem) },
  { key: "seconds", extra: true, name: "Length [s]", kind: "number", shown: number(0) },
  { key: "package", extra: true, name: "Package", shown: (value) => value || "–" },
  { key: "rig", extra: true, name: "Rig", shown: (value) => value || "–" },
];

let rows = []; // all there are, in order
let kept = []; // of these, the ones that pass the filter
let sort = { key: "started", down: true };
let chosen = [];
let listed = {};
let asking = new AbortController(); // for the flights that are chosen now
const view = new FlightView($("view"));
const table = new Rows(document.querySelector(".rows"), line);

function faults(row) {
  if (row.problem) return row.problem;
  if (row.waits) return "being read";
  const names = Object.entries(row.faults).map(([name, count]) => (count > 1 ? `${name} ×${count}` : name));
  return names.join(", ").replaceAll("_", " ") || "none";
}

async function ask(path, signal) {
  const answer = await fetch(path, { headers: { Authorization: `Bearer ${token()}` }, signal });
  if (!answer.ok) throw new Error((await answer.text()).trim());
  return answer;
}

async function load() {
  try {
    listed = await (await ask("/api/flights")).json();
    notice("");
  } catch (error) {
    notice(error.message.startsWith("401") ? "The token is missing or wrong: open the address that the program printed, with what stands behind the #." : `The list cannot be had (${error.message}); is the program still running?`);
    if (!error.message.startsWith("401")) setTimeout(load, 3 * LATER_MS);
    return;
  }
  rows = listed.flights.map(prepared).sort(order);
  widen();
  $("folder").textContent = listed.folder;
  draw();
  tellReports();
  const { total } = listed.reading;
  if (total || rows.some((row) => row.waits)) setTimeout(load, LATER_MS);
}

function prepared(row) {
  const counts = Object.values(row.faults ?? {});
  const fault_count = counts.reduce((sum, one) => sum + one, 0);
  const text = [row.name, row.started, row.rig, row.package, Object.keys(row.faults ?? {}).join(" "), row.problem];
  return { ...row, fault_count, text: text.join(" ").toLowerCase() };
}

// Whether a row passes what is typed and ticked now.
function wanted() {
  const words = $("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
  const [onlyFaults, onlyGap, onlyRig] = ["only-faults", "only-gap", "only-rig"].map((id) => $(id).checked);
  return (row) => words.every((word) => row.text.includes(word))
    && (!onlyFaults || row.fault_count > 0) && (!onlyGap || row.gap > 1) && (!onlyRig || row.simulated === false);
}

// What is not known comes last, either way.
function order(a, b) {
  const [one, other] = [a[sort.key] ?? null, b[sort.key] ?? null];
  if (one === other) return a.name < b.name ? -1 : 1;
  if (one === null || one === "") return 1;
  if (other === null || other === "") return -1;
  return (one < other ? -1 : 1) * (sort.down ? -1 : 1);
}

function draw() {
  kept = rows.filter(wanted());
  table.show(kept);
  const { done, total } = listed.reading;
  const told = kept.length === rows.length ? `${rows.length} flights` : `${kept.length} of ${rows.length} flights`;
  $("count").textContent = total ? `${told}, reading ${done} of ${total} new ones` : told;
}

function filter() {
  table.toTop();
  draw();
}

function heads() {
  const made = COLUMNS.map((column) => {
    const head = document.createElement("th");
    head.scope = "col";
    head.className = [column.kind === "number" && "is-number", column.extra && "is-extra"].filter(Boolean).join(" ");
    if (column.key === sort.key) head.ariaSort = sort.down ? "descending" : "ascending";
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: column.name });
    button.addEventListener("click", () => sortBy(column.key));
    head.append(button);
    return head;
  });
  const over = Object.assign(document.createElement("th"), { scope: "col" });
  over.append(Object.assign(document.createElement("span"), { className: "soft small", textContent: "Over" }));
  $("heads").replaceChildren(over, ...made);
}

function sortBy(key) {
  sort = { key, down: sort.key === key ? !sort.down : key !== "name" };
  rows.sort(order);
  heads();
  filter();
  const at = COLUMNS.findIndex((column) => column.key === key);
  $("heads").children[at + 1].firstChild.focus(); // the first one is that of the boxes
}

// A line that nobody sees, of the longest text in each column: widths stay while rows come and go.
function widen() {
  const made = document.createElement("tr");
  made.insertCell();
  for (const column of COLUMNS) {
    const lengths = rows.map((row) => column.shown(row[column.key], row).length);
    const longest = lengths.reduce((best, length, at) => (length > lengths[best] ? at : best), 0);
    if (rows.length) made.append(cell(column, rows[longest]));
  }
  $("widest").replaceChildren(made);
}

function line(row) {
  const made = document.createElement("tr");
  made.dataset.name = row.name;
  made.insertCell().append(overBox(row));
  made.append(...COLUMNS.map((column) => cell(column, row)));
  made.addEventListener("click", (event) => choose(row.name, event.shiftKey));
  markOne(made);
  return made;
}

function cell(column, row) {
  const made = document.createElement("td");
  const text = column.shown(row[column.key], row);
  if (column.key === "started" && row.started) made.append(Object.assign(document.createElement("span"), { className: "year", textContent: text.slice(0, 5) }), text.slice(5));
  else made.textContent = text;
  made.className = [column.kind && `is-${column.kind}`, column.bad?.(row) && "is-bad", column.extra && "is-extra"].filter(Boolean).join(" ");
  if (column.kind === "name" || column.kind === "faults") made.title = text;
  return made;
}

function overBox(row) {
  const box = Object.assign(document.createElement("input"), { type: "checkbox" });
  box.ariaLabel = `Draw ${row.name} over the chosen one`;
  box.addEventListener("click", (event) => {
    event.stopPropagation();
    choose(row.name, true);
  });
  return box;
}

async function choose(name, over, wait_ms = 0) {
  if (over && chosen[1] === name) chosen = chosen.slice(0, 1);
  else chosen = over && chosen.length && chosen[0] !== name ? [chosen[0], name] : [name];
  mark();
  asking.abort();
  asking = new AbortController();
  const { signal } = asking;
  if (wait_ms) await new Promise((done) => setTimeout(done, wait_ms));
  if (!signal.aborted) await drawChosen(name, signal);
}

async function drawChosen(name, signal) {
  const begun = performance.now();
  const telling = setInterval(() => {
    const seconds = (performance.now() - begun) / 1000;
    if (!signal.aborted) notice(`Reading ${name} …${seconds < 2 ? "" : ` ${seconds.toFixed(0)} s so far`}`);
  }, 500);
  try {
    const flights = await (await ask(`/api/flight?${query()}`, signal)).json();
    $("drawn").hidden = false;
    view.show(flights);
    $("replay").textContent = `Replay: wakedeploy live ${quoted(`${listed.folder}/${chosen[0]}`)}`;
    notice("");
  } catch (error) {
    if (!signal.aborted) notice(`${name} cannot be drawn (${error.message}).`); // else another one was chosen
  } finally {
    clearInterval(telling);
  }
}

const quoted = (path) => (/^[\w./-]+$/.test(path) ? path : `'${path.replaceAll("'", "'\\''")}'`);

function mark() {
  for (const made of $("rows").children) markOne(made);
}

function markOne(made) {
  const place = chosen.indexOf(made.dataset.name);
  made.className = ["is-first", "is-second"][place] ?? "";
  made.ariaCurrent = place === 0 ? "true" : null;
  made.querySelector("input").checked = place === 1;
}

const query = () => chosen.map((name) => `name=${encodeURIComponent(name)}`).join("&");

async function exported() {
  const page = await (await ask(`/api/export?${query()}`)).blob();
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(page) });
  link.download = `${chosen.map((name) => name.split("/").at(-1).replace(/\.\w+$/, "")).join("-and-")}.html`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function tellReports() {
  $("reports").hidden = !listed.reports.length;
  $("report-list").replaceChildren(...listed.reports.map((name) => {
    const link = Object.assign(document.createElement("a"), { textContent: name, target: "_blank", rel: "noopener" });
    link.href = listed.way + name.split("/").map(encodeURIComponent).join("/");
    const item = document.createElement("li");
    item.append(link);
    return item;
  }));
}

function notice(text) {
  $("notice").hidden = !text;
  $("notice").textContent = text;
}

function keyed(event) {
  if (event.key === "/" && document.activeElement !== $("filter")) {
    event.preventDefault();
    $("filter").focus();
  }
  if (document.activeElement.tagName === "INPUT" || !["ArrowDown", "ArrowUp"].includes(event.key)) return;
  if (!kept.length) return;
  const at = kept.findIndex((row) => row.name === chosen[0]);
  const next = Math.max(0, Math.min(kept.length - 1, at + (event.key === "ArrowDown" ? 1 : -1)));
  event.preventDefault();
  table.reveal(next);
  choose(kept[next].name, false, KEYS_MS);
}

$("filter").addEventListener("input", filter);
for (const id of ["only-faults", "only-gap", "only-rig"]) $(id).addEventListener("change", filter);
$("export").addEventListener("click", () => exported().catch((error) => notice(`The export failed (${error.message}).`)));
document.addEventListener("keydown", keyed);
heads();
load();
