// Narrow fields that are pointed: where each looks and why, on the map and as a table, and the form that points one at a track.
import { cone, ecef, geodetic, rangeToGround } from "/page/earth.js";
import { byId, position, whole } from "/page/panels.js";
import { ask } from "/page/service.js";
import { prepared } from "/page/view.js";

export const pointedOf = (sensors) => sensors.filter((each) => each.pointing);

const placeWords = (point) => { const { lat, lon, height } = geodetic(point); return position({ lat_deg: lat, lon_deg: lon }) + (height > 1e3 ? `, ${whole.format(Math.round(height / 1e3))} km` : ""); };

const isTurning = ({ looks_from: from }, timeS) => from !== null && Date.parse(from) / 1000 > timeS;

// Where a field looks, in words.
export function aimWords(pointing, timeS) {
  const { track_id: track, position_ecef_m: point } = pointing;
  const aim = track !== null ? `track ${track}` : point ? placeWords(point) : "nadir";
  return isTurning(pointing, timeS) ? `turns to ${aim} until ${pointing.looks_from.slice(11, 19)}` : aim;
}

export const modeWords = ({ mode, modes }) => (modes.length ? mode || "its own" : "–");

const byWords = ({ is_tasked: isTasked, reason }) => (isTasked ? "operator" : reason === "operator" ? "released" : reason || "–");

// Name and value pairs of a field, for the details of its sensor.
export function fieldDetails(pointing, timeS) {
  return [
    ["Looks at", aimWords(pointing, timeS)], ["Field, half angle", `${pointing.half_angle_deg}°`], ["Mode", modeWords(pointing)], ["Why", byWords(pointing)],
    ...(pointing.refusal ? [["Last command refused", pointing.refusal]] : []),
  ];
}

// Draws the ground in each field, to the horizon, and a line from the satellite to what it looks at; dashed while it turns.
export function drawPointed(layers, sensors, timeS, selected) {
  const { pen, view, unit, colour } = layers;
  for (const { sensor_id: id, position_ecef_m: at, pointing } of pointedOf(sensors)) {
    const point = pointing.position_ecef_m || [0, 0, 0], mark = `${at} ${point} ${pointing.half_angle_deg}`, turns = isTurning(pointing, timeS);
    pen.strokeStyle = pen.fillStyle = selected === `sensor ${id}` ? colour.select : colour.sensor;
    pen.lineWidth = 1.4 * unit; pen.setLineDash(turns ? [4, 4] : []);
    const ring = layers.path(`aim ${id}`, mark, () => cone(at, point, pointing.half_angle_deg) || { type: "MultiPoint", coordinates: [] });
    pen.globalAlpha = 0.22; if (!turns) pen.fill(ring);
    pen.globalAlpha = 0.9; pen.stroke(ring);
    if (pointing.position_ecef_m) drawSight(layers, id, at, point, mark);
  }
  pen.globalAlpha = 1; pen.setLineDash([]);
}

function drawSight({ pen, view, path, shapes, unit }, id, at, point, mark) {
  const from = geodetic(at), to = geodetic(point), isGlobe = view.kind === "globe";
  pen.globalAlpha = 0.55; pen.lineWidth = 0.9 * unit;
  if (!isGlobe) { pen.stroke(path.call({ shapes, view }, `sight ${id}`, mark, () => ({ type: "LineString", coordinates: [[from.lon, from.lat], [to.lon, to.lat]] }))); return; }
  if (!view.at(prepared(to.lon, to.lat, to.height))) return;
  const { px, py } = view;
  view.at(prepared(from.lon, from.lat, from.height));
  pen.beginPath(); pen.moveTo(px, py); pen.lineTo(view.px, view.py); pen.stroke();
}

// Range of a track from a satellite, m, and what hides it, as the page sees it; the service decides.
function sight(sensor, report) {
  const at = sensor.position_ecef_m, target = ecef(report.latitude_deg, report.longitude_deg, report.altitude_m), way = target.map((axis, index) => axis - at[index]);
  const range = Math.hypot(...way), high = Math.hypot(...at), cosine = -way.reduce((sum, axis, index) => sum + axis * at[index], 0) / range / high;
  const isWide = Math.acos(Math.min(1, cosine)) > (sensor.field_of_regard_half_angle_deg * Math.PI) / 180;
  return { range, hidden: rangeToGround(at, way) < 0.99 ? "behind the Earth" : isWide ? "outside its field of regard" : "" };
}

const option = (value, text) => { const each = document.createElement("option"); each.value = value; each.textContent = text; return each; };

// Replaces the options of a list that is not in use; keeps what is chosen.
function setOptions(list, pairs) {
  const text = JSON.stringify(pairs);
  if (text === list.dataset.text || document.activeElement === list) return;
  const chosen = list.value;
  list.dataset.text = text;
  list.replaceChildren(...pairs.map(([value, words]) => option(value, words)));
  if (pairs.some(([value]) => value === chosen)) list.value = chosen;
}

export class Tasks {
  // `onPick(key)` selects a sensor.
  constructor(store, order, onPick) {
    this.store = store; this.order = order; this.form = byId("task"); this.body = byId("field-rows"); this.track = null; this.text = "";
    this.form.addEventListener("submit", (event) => { event.preventDefault(); this.point(); });
    this.list.addEventListener("change", () => { this.setModes(); this.name(); });
    this.body.addEventListener("click", (event) => {
      const { sensor, does } = event.target.dataset;
      if (does === "release") this.release(sensor); else if (sensor) onPick(`sensor ${sensor}`);
    });
  }

  get list() { return this.form.elements.sensor; }

  // What is shown of a time, with a track selected, or none.
  show(report, timeS) {
    const sensors = pointedOf(this.store.sensors);
    byId("fields-panel").hidden = byId("k-field").hidden = !sensors.length;
    if (sensors.length) this.showFields(sensors, timeS);
    const track = report && sensors.length ? report.track_id : null;
    if (track !== this.track) { this.track = track; this.say("", false); this.list.value = ""; }
    this.form.hidden = track === null;
    if (track !== null) this.setSensors(sensors, report);
  }

  // Those in sight first, the nearest before; while a list is open it stays as it is.
  setSensors(sensors, report) {
    const hasPlace = report.latitude_deg !== null, seen = sensors.map((sensor) => ({ id: sensor.sensor_id, ...(hasPlace ? sight(sensor, report) : { range: 0, hidden: "" }) }));
    seen.sort((one, other) => Boolean(one.hidden) - Boolean(other.hidden) || one.range - other.range || (one.id < other.id ? -1 : 1));
    const km = (range) => (hasPlace ? `, ${whole.format(Number((range / 1e3).toPrecision(2)))} km` : "");
    setOptions(this.list, seen.map(({ id, range, hidden }) => [id, `${id}${hidden ? `, ${hidden}` : km(range)}`]));
    this.setModes();
    this.name();
  }

  setModes() {
    const sensor = this.store.sensors.find((each) => each.sensor_id === this.list.value), modes = sensor && sensor.pointing ? sensor.pointing.modes : [];
    this.form.elements.mode.closest("label").hidden = !modes.length;
    setOptions(this.form.elements.mode, [["", "as it is"], ...modes.map((mode) => [mode, mode])]);
  }

  name() {
    const button = this.form.querySelector("button"), text = `Point ${this.list.value} at track ${this.track}`;
    if (button.textContent !== text) button.textContent = text;
  }

  showFields(sensors, timeS) {
    // Those of the operator first, then those that follow or look at something.
    const rank = ({ pointing }) => 2 * pointing.is_tasked + Boolean(pointing.position_ecef_m);
    const lines = [...sensors].sort((one, other) => rank(other) - rank(one)).map(({ sensor_id: id, pointing }) => ({ id, cells: [aimWords(pointing, timeS), modeWords(pointing), byWords(pointing)], isTasked: pointing.is_tasked, refusal: pointing.refusal }));
    const text = JSON.stringify(lines);
    if (text === this.text) return;
    this.text = text;
    const focused = this.body.contains(document.activeElement) ? { ...document.activeElement.dataset } : null;
    this.body.replaceChildren(...lines.flatMap((line) => rowsOf(line)));
    if (focused) [...this.body.querySelectorAll("button")].filter((each) => each.dataset.sensor === focused.sensor).sort((one, other) => (other.dataset.does === focused.does) - (one.dataset.does === focused.does))[0]?.focus();
  }

  async point() {
    const id = this.list.value, mode = this.form.elements.mode.value, track = this.track;
    await this.send(id, { method: "PUT", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ track_id: track, ...(mode ? { mode } : {}) }) },
      (answer) => `${id} looks at track ${track} from ${this.clock(answer.from_s)} on`, `${id} goes on as it was`);
  }

  async release(id) { await this.send(id, { method: "DELETE" }, () => `${id} is released: the director commands it`, `${id} is not released`); }

  clock(sceneS) { return `${new Date((this.order.epochS + sceneS) * 1000).toISOString().slice(11, 19)} Z`; }

  async send(id, request, words, otherwise) {
    try {
      const response = await ask(`/sensors/${encodeURIComponent(id)}/task`, request), answer = await response.json();
      if (response.ok) this.say(words(answer), false);
      else this.say(`${otherwise}: ${answer.detail || answer.title}`, true);
    } catch { this.say("The service cannot be reached", true); }
  }

  say(text, isBad) { byId("task-answer").textContent = text; byId("task-answer").className = isBad ? "bad" : ""; }
}

function rowsOf({ id, cells, isTasked, refusal }) {
  const line = document.createElement("tr"), press = (does, text) => { const button = document.createElement("button"); button.type = "button"; button.dataset.sensor = id; button.dataset.does = does; button.textContent = text; return button; };
  line.insertCell().append(press("select", id));
  cells.forEach((text) => { line.insertCell().textContent = text; });
  const last = line.insertCell();
  if (isTasked) { last.append(press("release", "Release")); last.firstChild.setAttribute("aria-label", `Release ${id}`); }
  if (!refusal) return [line];
  const reason = document.createElement("tr"), cell = reason.insertCell();
  cell.colSpan = 5; cell.className = "bad wrap"; cell.textContent = `refused: ${refusal}`;
  return [line, reason];
}
