// The table of tracks: a row for every track on the map, changed in place, a few rows in each frame.
import { byId, position, whole } from "/page/panels.js";

const TYPES = ["ICBM", "IRBM", "SRBM", "UNKNOWN"], COLUMNS = 11, ROWS_A_FRAME = 20, EVERY_MS = 500;

export class TrackTable {
  constructor(body, store, onPick) {
    this.body = body; this.store = store; this.rows = new Map(); this.waiting = []; this.dueMs = 0; this.selected = null; this.shownS = NaN;
    body.addEventListener("click", (event) => {
      const row = event.target.closest("tr");
      if (row && row.dataset.track) onPick(`track ${row.dataset.track}`);
    });
  }

  // Called in each frame; `timeS` is the time shown.
  update(timeS) {
    const now = performance.now();
    if (!this.waiting.length && now >= this.dueMs) {
      this.dueMs = now + EVERY_MS;
      this.waiting = [...this.store.tracks.values()];
      for (const [id, row] of this.rows) if (!this.store.tracks.has(id)) { row.line.remove(); this.rows.delete(id); }
    }
    for (const track of this.waiting.splice(0, ROWS_A_FRAME)) this.show(track, timeS);
    if (this.waiting.length) return;
    const isEmpty = ![...this.rows.values()].some((row) => !row.line.hidden);
    if (isEmpty && !this.none) { this.none = document.createElement("tr"); const cell = this.none.insertCell(); cell.colSpan = COLUMNS; cell.textContent = "None yet"; this.body.replaceChildren(this.none, ...[...this.rows.values()].map((row) => row.line)); }
    if (!isEmpty && this.none) { this.none.remove(); this.none = null; }
    if (!this.none && this.body.firstElementChild && !this.body.firstElementChild.dataset.track) this.body.firstElementChild.remove();
  }

  show(track, timeS) {
    const report = this.store.documentAt(track, timeS);
    let row = this.rows.get(track.id);
    if (!row) {
      if (!report) return;
      row = this.newRow(track.id);
    }
    row.line.hidden = !report;
    if (!report || row.report === report) return;
    row.report = report;
    cellsOf(report).forEach((text, at) => { const cell = row.cells[at]; if (cell.textContent !== text) cell.textContent = text; });
  }

  // Rows stand in the order of track numbers.
  newRow(id) {
    const line = document.createElement("tr"), cells = [];
    line.dataset.track = id;
    for (let at = 0; at < COLUMNS; at += 1) cells.push(line.insertCell());
    const button = document.createElement("button");
    button.type = "button"; button.textContent = `${id}`; button.setAttribute("aria-pressed", String(this.selected === id));
    cells[0].append(button);
    const row = { line, cells: cells.slice(1), button, report: null };
    const following = [...this.rows.keys()].filter((other) => other > id);
    const before = following.length ? this.rows.get(Math.min(...following)).line : null;
    this.rows.set(id, row);
    this.body.insertBefore(line, before);
    return row;
  }

  select(key) {
    const id = key && key.startsWith("track ") ? Number(key.slice(6)) : null;
    if (this.selected !== null) this.mark(this.selected, false);
    this.selected = id;
    if (id !== null) this.mark(id, true);
  }

  mark(id, isChosen) {
    const row = this.rows.get(id);
    if (!row) return;
    row.line.classList.toggle("chosen", isChosen);
    row.button.setAttribute("aria-pressed", String(isChosen));
    if (isChosen) row.line.scrollIntoView({ block: "nearest" });
  }
}

export function likeliest(report) {
  const known = TYPES.filter((type) => report.type_probability[type] !== null && report.type_probability[type] !== undefined);
  if (!known.length) return "–";
  return known.reduce((best, type) => (report.type_probability[type] > report.type_probability[best] ? type : best));
}

const share = (value) => (value === null || value === undefined ? "–" : value.toFixed(2));

function cellsOf(report) {
  return [
    likeliest(report), ...TYPES.map((type) => share(report.type_probability[type])), share(report.probability_burning),
    report.altitude_m === null ? "–" : whole.format(Math.round(report.altitude_m / 1000) + 0),
    position(report.launch_point), position(report.impact_point), area(report),
  ];
}

// The area of the 95 % region, or of the ellipse of a track without regions.
export function area(report) {
  const region = (report.impact_regions || []).find((each) => each.containment > 0.94), shape = report.impact_point && report.impact_point.ellipse;
  if (region) return whole.format(Math.round(region.area_km2));
  return shape ? whole.format(Math.round(Math.PI * shape.semi_major_m * shape.semi_minor_m / 1e6)) : "–";
}

// Name and value pairs of what is selected.
export function detailsOf(store, key, timeS) {
  if (!key) return [["Nothing", "Click a mark on the map or a row of the table."]];
  if (key.startsWith("sensor ")) {
    const sensor = store.sensors.find((each) => `sensor ${each.sensor_id}` === key);
    return sensor ? [["Satellite", sensor.sensor_id], ["Type", sensor.sensor_type], ["State", sensor.state], ["Scan period", `${sensor.scan_period_ms} ms`], ["Detections", whole.format(sensor.detections)], ["Last detection", sensor.last_detection ? `${sensor.last_detection.slice(11, 22)} Z` : "–"]] : [["Satellite", "–"]];
  }
  const track = store.tracks.get(Number(key.slice(6))), report = track && store.documentAt(track, timeS);
  if (!report) return [["Track", `${key.slice(6)}, not at this time`]];
  const cells = cellsOf(report), impact = report.impact_point;
  return [
    ["Track", `${track.id}`], ["Estimate of", `${report.timestamp.slice(11, 22)} Z`], ["Type", likeliest(report)], ["P(burning)", cells[5]],
    ["P(ICBM, IRBM, SRBM)", cells.slice(1, 4).join(", ")], ["Altitude", `${cells[6]} km`], ["Launch point", cells[7]], ["Launch time", report.launch_point && report.launch_point.time ? `${report.launch_point.time.slice(11, 22)} Z` : "–"],
    ["Impact point", cells[8]], ["Impact time", impact && impact.time ? `${impact.time.slice(11, 19)} Z` : "–"], ["95 % area", `${cells[9]} km²`], ["Impact method", (impact && impact.method) || "–"],
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
