// The table of tracks: a line for every track on the map, in an order that the reader chooses. Only the lines in view and a few
// around them are elements: a browser lays out a table as a whole, and a thousand lines take longer than a frame.
import { fieldDetails } from "/page/fields.js";
import { likeliest } from "/page/order.js";
import { byId, position, whole } from "/page/panels.js";

// The area of the largest continent, Asia: a larger region says nothing of where.
export const CONTINENT_KM2 = 4.46e7;
const TYPES = ["ICBM", "IRBM", "SRBM", "UNKNOWN"], COLUMNS = 8, AROUND = 8, EVERY_MS = 500, HEIGHT_PX = 26;

export class TrackTable {
  constructor(body, store, order, onPick) {
    this.body = body; this.store = store; this.order = order; this.version = 0; this.box = body.closest(".scroll"); this.table = body.closest("table");
    this.lines = []; this.rows = new Map(); this.dueMs = 0; this.selected = null; this.isScrolled = false; this.heightPx = HEIGHT_PX;
    this.above = spacer(); this.below = spacer(); this.none = spacer();
    this.none.removeAttribute("aria-hidden"); this.none.cells[0].textContent = "None yet";
    body.replaceChildren(this.above, this.none, this.below);
    this.box.addEventListener("scroll", () => { this.isScrolled = true; }, { passive: true });
    body.addEventListener("click", (event) => {
      const row = event.target.closest("tr");
      if (row && row.dataset.track) onPick(`track ${row.dataset.track}`);
    });
  }

  // Called in each frame; `timeS` is the time shown.
  update(timeS) {
    const now = performance.now(), isDue = now >= this.dueMs || this.version !== this.order.version;
    if (!isDue && !this.isScrolled) return;
    if (isDue) { this.dueMs = now + EVERY_MS; this.read(timeS); }
    this.isScrolled = false;
    const isFirst = !this.rows.size;
    this.render();
    if (isFirst && this.rows.size) { this.measure(); this.render(); }
  }

  // The tracks that have a document at a time.
  read(timeS) {
    const { order } = this, lines = [];
    let earlier = 0;
    this.version = order.version;
    for (const track of this.store.tracks.values()) {
      const report = this.store.documentAt(track, timeS);
      if (!report) continue;
      earlier += order.isEarlier(report, timeS) ? 1 : 0;
      if (order.isShown(report, timeS) || track.id === this.selected) lines.push({ id: track.id, report });
    }
    this.lines = order.sorted(lines, timeS);
    order.showEarlier(earlier);
    this.table.setAttribute("aria-rowcount", String(this.lines.length + 1));
    this.none.hidden = this.lines.length > 0;
    this.measure();
  }

  // Every line has the same height, which follows the size of the text.
  measure() {
    const [row] = this.rows.values(), heightPx = row ? row.line.getBoundingClientRect().height : 0;
    if (heightPx) this.heightPx = heightPx;
  }

  render() {
    const { box, heightPx, lines } = this, count = Math.ceil(box.clientHeight / heightPx) + 2 * AROUND;
    const first = Math.max(0, Math.min(Math.floor(box.scrollTop / heightPx) - AROUND, lines.length - count));
    const shown = lines.slice(first, first + count), ids = new Set(shown.map((each) => each.id));
    for (const [id, row] of this.rows) if (!ids.has(id)) this.drop(id, row);
    this.above.cells[0].style.height = `${first * heightPx}px`;
    this.below.cells[0].style.height = `${(lines.length - first - shown.length) * heightPx}px`;
    let before = this.above.nextSibling;
    shown.forEach(({ id, report }, at) => {
      const row = this.rows.get(id) || this.newRow(id);
      if (row.line === before) before = before.nextSibling; else this.body.insertBefore(row.line, before);
      row.line.setAttribute("aria-rowindex", String(first + at + 2));
      if (row.report === report) return;
      row.report = report;
      cellsOf(report).forEach((text, cell) => { if (row.cells[cell].textContent !== text) row.cells[cell].textContent = text; });
    });
  }

  // The keyboard stays in the table when its line leaves the view.
  drop(id, row) {
    if (row.line.contains(document.activeElement)) this.box.focus({ preventScroll: true });
    row.line.remove(); this.rows.delete(id);
  }

  newRow(id) {
    const line = document.createElement("tr"), cells = [];
    line.dataset.track = id;
    for (let at = 0; at < COLUMNS; at += 1) cells.push(line.insertCell());
    const button = document.createElement("button");
    button.type = "button"; button.textContent = `${id}`;
    cells[0].append(button);
    const row = { line, cells: cells.slice(1), button, report: null };
    this.rows.set(id, row);
    this.mark(id);
    return row;
  }

  select(key) {
    const before = this.selected, id = key && key.startsWith("track ") ? Number(key.slice(6)) : null;
    this.selected = id;
    this.mark(before); this.mark(id);
    const at = this.lines.findIndex((each) => each.id === id);
    if (at >= 0) this.reveal(at);
  }

  mark(id) {
    const row = this.rows.get(id), isChosen = id === this.selected;
    if (!row) return;
    row.line.classList.toggle("chosen", isChosen);
    row.button.setAttribute("aria-pressed", String(isChosen));
  }

  // Scrolls as little as needed.
  reveal(at) {
    const { box, heightPx, table } = this, head = table.tHead.getBoundingClientRect().height, top = at * heightPx;
    box.scrollTop = Math.max(Math.min(box.scrollTop, top), top + heightPx + head - box.clientHeight);
    this.isScrolled = true;
  }
}

// A line that holds the place of lines out of view.
function spacer() {
  const line = document.createElement("tr"), cell = line.insertCell();
  line.className = "spacer"; line.setAttribute("aria-hidden", "true"); cell.colSpan = COLUMNS;
  return line;
}

// Nothing is certain: no probability is shown as 1.00 or 0.00.
export function share(value) {
  if (value === null || value === undefined) return "–";
  if (value >= 0.995) return "> 0.99";
  return value < 0.005 ? "< 0.01" : value.toFixed(2);
}

const named = (report) => (report.hypotheses ? `${likeliest(report)} ${share(report.hypotheses[likeliest(report)])}` : likeliest(report));

function cellsOf(report) {
  return [
    named(report), impactPlace(report), clock(report.impact_point), areaWords(areaKm2(report)), position(report.launch_point), clock(report.launch_point),
    share(report.probability_launch),
  ];
}

// The place of an impact, unless its region says nothing of where.
const impactPlace = (report) => (areaKm2(report) > CONTINENT_KM2 ? "no useful region" : position(report.impact_point));

const clock = (point) => (point && point.time ? point.time.slice(11, 19) + interval(point) : "–");

// The half of the 95 % interval of a time.
function interval(point) {
  const half = typeof point.time_variance_s2 === "number" ? 1.96 * Math.sqrt(point.time_variance_s2) : NaN;
  return Number.isNaN(half) ? "" : ` ± ${half < 10 ? half.toFixed(1) : whole.format(Math.round(half))} s`;
}

// An area to two digits.
export function areaWords(km2, unit = "") {
  if (Number.isNaN(km2)) return "–";
  return km2 > CONTINENT_KM2 ? "> a continent" : whole.format(Number(km2.toPrecision(2))) + unit;
}

export const outer = (report) => (report.impact_regions || []).find((each) => each.containment > 0.94);

// The area of the 95 % region, or of the ellipse of a track without regions.
export function areaKm2(report) {
  const region = outer(report), shape = report.impact_point && report.impact_point.ellipse;
  if (region) return region.area_km2;
  return shape ? (Math.PI * shape.semi_major_m * shape.semi_minor_m) / 1e6 : NaN;
}

// The areas of the 95 % regions with their conditions, the most probable first.
export function areas(report) {
  const regions = (report.impact_regions || []).filter((each) => each.containment > 0.94);
  if (!regions.length) return areaWords(areaKm2(report), " km²");
  const words = { "burn over": () => "if the burn is over: ", relights: (each) => `relights ${share(each.probability)}: ` };
  return regions.map((each) => {
    const thin = typeof each.effective_samples === "number" && each.effective_samples < 100 ? ", thin" : "";
    return `${(words[each.condition] || (() => ""))(each)}${areaWords(each.area_km2, " km²")}${thin}`;
  }).join("; ");
}

// What the object may be, for trackers that weigh hypotheses.
function weighed(report) {
  if (!report.hypotheses) return [];
  const others = Object.entries(report.hypotheses).filter(([name, chance]) => chance >= 0.01 && name !== likeliest(report)).sort((one, other) => other[1] - one[1]);
  return [
    ["Or", others.map(([name, chance]) => `${name} ${share(chance)}`).join(", ") || "–"], ["P(launch)", share(report.probability_launch)],
    ["P(comes down)", share(report.probability_comes_down)], ["P(reaches orbit)", share(report.probability_orbit)], ["Ended", report.end || "–"],
  ];
}

// Name and value pairs of what is selected.
export function detailsOf(store, key, timeS) {
  if (!key) return [["Nothing", "Click a mark on the map or a row of the table."]];
  if (key.startsWith("sensor ")) {
    const sensor = store.sensors.find((each) => `sensor ${each.sensor_id}` === key);
    return sensor ? [["Satellite", sensor.sensor_id], ["Type", sensor.sensor_type], ["State", sensor.state], ["Scan period", `${sensor.scan_period_ms} ms`], ["Detections", whole.format(sensor.detections)], ["Last detection", sensor.last_detection ? `${sensor.last_detection.slice(11, 22)} Z` : "–"], ...(sensor.pointing ? fieldDetails(sensor.pointing, timeS) : []), ...(sensor.health ? sensor.health.text.split("; ").map((part, at) => [at ? "" : "Found", part]) : [])] : [["Satellite", "–"]];
  }
  const track = store.tracks.get(Number(key.slice(6))), report = track && store.documentAt(track, timeS);
  if (!report) return [["Track", `${key.slice(6)}, not at this time`]];
  const cells = cellsOf(report), impact = report.impact_point;
  return [
    ["Track", `${track.id}`], ["Estimate of", `${report.timestamp.slice(11, 22)} Z`], [report.hypotheses ? "Likeliest" : "Type", named(report)], ...weighed(report), ["P(burning)", share(report.probability_burning)],
    ["Reported type", TYPES.map((type) => `${type === "UNKNOWN" ? "unknown" : type} ${share(report.type_probability[type])}`).join(", ")], ["Altitude", report.altitude_m === null ? "–" : `${whole.format(Math.round(report.altitude_m / 1000) + 0)} km`], ["Launch point", cells[4]], ["Launch time", report.launch_point && report.launch_point.time ? `${report.launch_point.time.slice(11, 22)} Z${interval(report.launch_point)}` : "–"],
    ["Impact point", cells[1]], ["Impact time", impact && impact.time ? `${impact.time.slice(11, 19)} Z${interval(impact)}` : "–"], ["95 % area", areas(report)], ["Impact method", (impact && impact.method) || "–"],
  ];
}

export function showDetails(pairs) {
  const parts = pairs.map(([name, value]) => {
    const part = document.createElement("div"), term = document.createElement("dt"), text = document.createElement("dd");
    term.textContent = name; text.textContent = value; part.append(term, text);
    return part;
  });
  byId("picked").replaceChildren(...parts);
}
