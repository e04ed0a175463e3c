// Draws the layers of the map: ground, night, fields of view, regions, trails, marks. Shapes are kept while the view rests.
import { cap, ellipse, footprint, geodetic, landOf, rewound, subsolar } from "/page/earth.js";
import { drawPointed } from "/page/fields.js";
import { after } from "/page/store.js";
import { drawCoverage } from "/page/coverage.js";
import { Crowd } from "/page/crowd.js";
import { areaKm2, CONTINENT_KM2 } from "/page/table.js";
import { prepared } from "/page/view.js";

const { geoGraticule10, geoPath } = globalThis.d3;
// Larger ellipses of linear estimates mean nothing and are not drawn.
const WIDEST_M = 2.5e6;
// Larger regions, a hundredth of the Earth, are faint outlines unless they are selected: they would hide the map.
const WIDEST_KM2 = 5e6;
// Of more tracks with a region, those of so many latest and so many largest are drawn, and that of the selected one.
const MOST_LATEST = 8, MOST_LARGEST = 4;
// So many impact points without a region in a square of the map are counted.
const MANY = 4, CELL_PX = 56;
// Paths and places that are kept; beyond that all are made anew.
const MOST_SHAPES = 1000, MOST_SITES = 4000;
// More tracks are drawn as a crowd; more detections as squares.
const FEW = 60, FEW_HITS = 300, SHADE_MS = 500;
export const SHOWN_S = 6, GONE_S = 20, MOST_HITS = 1500;
const COLOURS = ["sea", "land", "shore", "line", "sensor", "hit", "launch", "impact", "ink", "soft", "night", "select"];

// The outlines of a polygon, without the cuts along 180 degrees that GeoJSON demands.
function edges(geometry) {
  const lines = [], isCut = (one, other) => Math.abs(one[0]) > 179.9999 && Math.abs(other[0]) > 179.9999;
  for (const ring of geometry.type === "Polygon" ? geometry.coordinates : geometry.coordinates.flat()) {
    let line = [ring[0]];
    for (let at = 1; at < ring.length; at += 1) {
      if (isCut(ring[at - 1], ring[at])) { if (line.length > 1) lines.push(line); line = []; }
      line.push(ring[at]);
    }
    if (line.length > 1) lines.push(line);
  }
  return { type: "MultiLineString", coordinates: lines };
}

// Whether a region of a track, or its ellipse, is small enough to be drawn.
function hasDrawable({ impact_regions: regions, impact_point: impact }) {
  return regions.length ? regions.some((each) => each.area_km2 <= CONTINENT_KM2) : Boolean(impact && impact.ellipse && impact.ellipse.semi_major_m <= WIDEST_M);
}

export class Layers {
  constructor(canvas, view) {
    this.canvas = canvas; this.pen = canvas.getContext("2d"); this.view = view;
    this.ground = document.createElement("canvas"); this.shade = document.createElement("canvas"); this.crowd = new Crowd(this);
    this.shadeVersion = null; this.shadeMs = -Infinity; this.showsCoverage = false; this.gaps = null; this.left = { drawn: 0, all: 0 };
    this.land = {}; this.groundVersion = null; this.shapes = new Map(); this.sites = new Map();
    this.drawn = { launches: 0, impacts: 0, ellipses: 0, regions: 0, tracks: 0 }; this.labels = [];
    for (const detail of ["110m", "50m"]) {
      fetch(`/page/coast-${detail}.json`).then((answer) => answer.json()).then((land) => { this.land[detail] = landOf(land); this.groundVersion = null; });
    }
  }

  resize(width, height) {
    const ratio = Math.min(devicePixelRatio || 1, 2), style = getComputedStyle(document.documentElement);
    for (const each of [this.canvas, this.ground, this.shade]) { each.width = Math.round(width * ratio); each.height = Math.round(height * ratio); }
    this.ratio = ratio; this.unit = parseFloat(style.fontSize) / 15;
    this.colour = Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    this.groundVersion = this.shadeVersion = null;
    this.view.resize(width, height);
  }

  // Coasts of 1:110m while the view moves, of 1:50m at rest.
  drawGround(isMoving) {
    const detail = isMoving || !this.land["50m"] ? "110m" : "50m", version = `${this.view.version} ${detail}`;
    if (version === this.groundVersion) return;
    this.groundVersion = version;
    // Lines are resampled more coarsely while they move.
    const pen = this.ground.getContext("2d"), path = geoPath(this.view.projection.precision(isMoving ? 4 : 0.5), pen);
    pen.setTransform(1, 0, 0, 1, 0, 0); pen.clearRect(0, 0, this.ground.width, this.ground.height);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const draw = (shape) => { pen.beginPath(); path(shape); };
    draw({ type: "Sphere" }); pen.fillStyle = this.colour.sea; pen.fill();
    if (this.land[detail]) { draw(this.land[detail]); pen.fillStyle = this.colour.land; pen.fill(); pen.strokeStyle = this.colour.shore; pen.lineWidth = 0.6; pen.stroke(); }
    draw(geoGraticule10()); pen.strokeStyle = this.colour.line; pen.lineWidth = 0.5; pen.stroke();
    draw({ type: "Sphere" }); pen.strokeStyle = this.colour.shore; pen.lineWidth = 1; pen.stroke();
  }

  // A frame of the run at a time: `speed` scales how long marks stay.
  draw(store, nowS, { speed, selected, isMoving, isCalm, crosshair, places, order }) {
    const pen = this.pen;
    this.drawGround(isMoving);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.ground, 0, 0);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.marks = [];
    this.drawn = { launches: 0, impacts: 0, ellipses: 0, regions: 0, tracks: 0 };
    if (Number.isFinite(nowS)) { this.drawShade(store.sensors, nowS); this.drawTracks(store, nowS, { speed, selected, isMoving, order }); this.drawHits(store, nowS, speed, isCalm); }
    drawPointed(this, store.sensors, nowS, selected);
    this.drawSensors(store.sensors, selected);
    this.drawPlaces(places, crosshair);
  }

  // The path of a shape on the screen; kept until the view or the shape changes.
  path(key, mark, make) {
    const found = this.shapes.get(key);
    if (found && found.version === this.view.version && found.mark === mark) return found.path;
    const path = new Path2D();
    geoPath(this.view.projection, path)(make());
    if (this.shapes.size > MOST_SHAPES) this.shapes.clear();
    this.shapes.set(key, { version: this.view.version, mark, path });
    return path;
  }

  // Night and fields of view: drawn again when the view changes, and else once in a while.
  drawShade(sensors, nowS) {
    const { pen, shade } = this, now = performance.now(), version = this.view.version;
    if (version !== this.shadeVersion || now - this.shadeMs > SHADE_MS) {
      this.shadeVersion = version; this.shadeMs = now;
      this.pen = shade.getContext("2d");
      this.pen.setTransform(1, 0, 0, 1, 0, 0); this.pen.clearRect(0, 0, shade.width, shade.height);
      this.pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      this.drawNight(nowS); this.drawFields(sensors);
      this.gaps = this.showsCoverage ? drawCoverage(this.pen, this.view, this.unit, this.colour, sensors) : null;
      this.pen = pen;
    }
    pen.save(); pen.setTransform(1, 0, 0, 1, 0, 0); pen.drawImage(shade, 0, 0); pen.restore();
  }

  drawNight(nowS) {
    const step = Math.round(nowS / 20), sun = subsolar(step * 20);
    this.pen.fillStyle = this.colour.night;
    this.pen.fill(this.path("night", step, () => cap(sun.lon + 180, -sun.lat, 90)));
  }

  drawFields(sensors) {
    const pen = this.pen;
    for (const sensor of sensors) {
      const isActive = sensor.state === "detecting", [x, y, z] = sensor.position_ecef_m;
      pen.strokeStyle = pen.fillStyle = this.colour.sensor; pen.lineWidth = (isActive ? 1.2 : 0.9) * this.unit;
      const path = this.path(`field ${sensor.sensor_id}`, `${Math.round(x / 2e4)} ${Math.round(y / 2e4)} ${Math.round(z / 2e4)}`, () => footprint(sensor.position_ecef_m, sensor.field_of_regard_half_angle_deg));
      if (isActive) { pen.globalAlpha = 0.05; pen.fill(path); }
      pen.globalAlpha = isActive ? 0.6 : 0.18; pen.stroke(path);
    }
    pen.globalAlpha = 1;
  }

  drawTracks(store, nowS, { speed, selected, isMoving, order }) {
    const gone = GONE_S * Math.max(1, speed), seen = [];
    for (const track of store.tracks.values()) {
      const report = store.documentAt(track, nowS);
      const isSelected = selected === `track ${track.id}`;
      if (!report || !(isSelected || order.isShown(report, nowS))) continue;
      const count = after(track.trail, nowS), last = count ? track.trail[count - 1] : null;
      const isOld = nowS - (last ? last.timeS : Date.parse(report.timestamp) / 1000) > gone;
      seen.push({ track, report, count, last, isOld, isSelected });
    }
    this.chooseRegions(seen);
    this.labels = [];
    if (seen.length > FEW) this.crowd.draw(seen, isMoving);
    else { this.drawn.tracks = seen.length; seen.forEach((one) => this.drawTrack(one, true)); }
    this.drawLabels();
    this.drawCounts(seen);
    this.pen.globalAlpha = 1;
  }

  // Many regions hide each other and the map: says of which tracks they are drawn.
  chooseRegions(seen) {
    const wide = seen.filter(({ report }) => hasDrawable(report)), isFew = wide.length <= MOST_LATEST + MOST_LARGEST;
    for (const one of seen) one.hasRegion = isFew || one.isSelected;
    if (!isFew) {
      // Regions that say nothing of where come last.
      const area = ({ report }) => { const km2 = areaKm2(report); return km2 > CONTINENT_KM2 ? 0 : km2; };
      for (const one of wide.slice().sort((a, b) => b.track.id - a.track.id).slice(0, MOST_LATEST)) one.hasRegion = true;
      for (const one of wide.filter((each) => !each.hasRegion).sort((a, b) => area(b) - area(a)).slice(0, MOST_LARGEST)) one.hasRegion = true;
    }
    this.left = { drawn: wide.filter((one) => one.hasRegion).length, all: wide.length };
  }

  // The number of impact points without their region, where there are many.
  drawCounts(seen) {
    const { pen, view } = this, cells = new Map();
    for (const { track, report, hasRegion } of seen) {
      if (hasRegion || !report.impact_point || !view.at(this.site(`impact ${track.id}`, report.impact_point))) continue;
      const key = `${Math.floor(view.px / CELL_PX)} ${Math.floor(view.py / CELL_PX)}`, cell = cells.get(key) || { x: 0, y: 0, count: 0 };
      cell.x += view.px; cell.y += view.py; cell.count += 1;
      cells.set(key, cell);
    }
    pen.font = `600 ${11 * this.unit}px system-ui, sans-serif`; pen.textAlign = "center"; pen.textBaseline = "middle";
    for (const { x, y, count } of cells.values()) {
      if (count < MANY) continue;
      pen.globalAlpha = 0.9; pen.fillStyle = this.colour.impact;
      pen.beginPath(); pen.arc(x / count, y / count, (7 + 2 * Math.log10(count)) * this.unit, 0, 7); pen.fill();
      pen.globalAlpha = 1; pen.fillStyle = this.colour.sea; pen.fillText(`${count}`, x / count, y / count);
    }
    pen.textBaseline = "alphabetic";
  }

  drawTrack({ track, report, count, last, isOld, isSelected, hasRegion }, hasLabel) {
    this.pen.globalAlpha = isOld ? 0.35 : 1;
    if (hasRegion) this.drawRegions(track.id, report, isSelected);
    this.drawTrail(track.trail, count, isSelected);
    if (report.launch_point) this.drawLaunch(track.id, report.launch_point);
    // Labels of tracks with regions come first, that of the selected one before all.
    const rank = hasLabel ? 1 + Boolean(hasRegion) + 2 * isSelected : 0;
    if (report.impact_point) this.drawImpact(track.id, report, rank);
    if (last && !isOld) this.drawNow(track.id, last, isSelected, rank);
  }

  drawTrail(trail, count, isSelected) {
    const pen = this.pen, view = this.view, step = isSelected || count < 40 ? 1 : 2;
    let isDown = false, before = 0;
    pen.beginPath();
    for (let at = (count - 1) % step; at < count; at += step) {
      const isSeen = view.at(trail[at].place);
      if (isSeen && isDown && Math.abs(view.px - before) < view.radius) pen.lineTo(view.px, view.py);
      else if (isSeen) pen.moveTo(view.px, view.py);
      isDown = isSeen; before = view.px;
    }
    pen.strokeStyle = isSelected ? this.colour.select : this.colour.ink; pen.lineWidth = (isSelected ? 2.2 : 1.1) * this.unit;
    pen.stroke();
  }

  // The areas of 50, 90 and 95 % at their true size, if that is `leastM` or more, dashed for all conditions but the most
  // probable one; the ellipses of a track that has no regions.
  drawRegions(id, report, isSelected, leastM = 0) {
    const pen = this.pen, impact = report.impact_point;
    pen.strokeStyle = pen.fillStyle = isSelected ? this.colour.select : this.colour.impact; pen.lineWidth = (isSelected ? 2 : 1.2) * this.unit;
    const alpha = pen.globalAlpha, shapes = [], regions = report.impact_regions || [];
    for (const region of regions) {
      const key = `${region.condition} ${region.containment}`, isMain = region.condition === regions[0].condition;
      if (region.area_km2 > CONTINENT_KM2 && !isSelected) continue;
      if (Math.sqrt(region.area_km2) * 1000 >= leastM) shapes.push([key, () => rewound(region.geometry), isMain ? [] : [4, 4], region.area_km2 > WIDEST_KM2 && !isSelected]);
    }
    this.drawn.regions += shapes.length;
    if (!regions.length && impact) {
      for (const [share, shape] of [[0.5, impact.ellipse_50], [0.9, impact.ellipse_90], [0.95, impact.ellipse]]) {
        if (shape && shape.semi_major_m <= WIDEST_M && shape.semi_major_m >= leastM) shapes.push([share, () => ellipse(impact, shape), [], false]);
      }
      this.drawn.ellipses += shapes.length;
    }
    for (const [key, make, dash, isFaint] of shapes) {
      const path = this.path(`region ${id} ${key}`, report, make);
      pen.globalAlpha = alpha * 0.12; if (!dash.length && !isFaint) pen.fill(path);
      pen.setLineDash(dash);
      pen.globalAlpha = isFaint ? alpha * 0.35 : alpha; pen.stroke(this.path(`edge ${id} ${key}`, report, () => edges(make())));
    }
    pen.globalAlpha = alpha; pen.setLineDash([]);
  }

  // The prepared place of a launch or impact point; kept until it changes.
  site(key, point) {
    const found = this.sites.get(key);
    if (found && found.point === point) return found.place;
    const place = prepared(point.lon_deg, point.lat_deg);
    if (this.sites.size > MOST_SITES) this.sites.clear();
    this.sites.set(key, { point, place });
    return place;
  }

  drawLaunch(id, launch) {
    const { pen, view } = this, size = 5 * this.unit;
    this.drawn.launches += 1;
    if (!view.at(this.site(`launch ${id}`, launch))) return;
    const x = view.px, y = view.py;
    pen.fillStyle = pen.strokeStyle = this.colour.launch;
    if (launch.ellipse && launch.ellipse.semi_major_m <= WIDEST_M && (launch.ellipse.semi_major_m / 6378137) * view.radius > 3) {
      pen.lineWidth = this.unit; pen.stroke(this.path(`launch ${id}`, launch, () => ellipse(launch, launch.ellipse)));
    }
    pen.beginPath(); pen.moveTo(x, y - size); pen.lineTo(x + size, y + size); pen.lineTo(x - size, y + size); pen.fill();
  }

  drawImpact(id, report, rank) {
    const { pen, view } = this, size = 4.5 * this.unit;
    this.drawn.impacts += 1;
    if (!view.at(this.site(`impact ${id}`, report.impact_point))) return;
    const x = view.px, y = view.py;
    this.marks.push({ key: `track ${id}`, x, y });
    pen.strokeStyle = pen.fillStyle = this.colour.impact; pen.lineWidth = 1.8 * this.unit;
    pen.beginPath(); pen.moveTo(x - size, y - size); pen.lineTo(x + size, y + size); pen.moveTo(x - size, y + size); pen.lineTo(x + size, y - size); pen.stroke();
    if (rank) this.label(id, x + 7 * this.unit, y + 4 * this.unit, 11, rank);
  }

  drawNow(id, sample, isSelected, rank) {
    const { pen, view } = this;
    if (!view.at(sample.place)) return;
    const x = view.px, y = view.py;
    this.marks.push({ key: `track ${id}`, x, y });
    pen.strokeStyle = pen.fillStyle = isSelected ? this.colour.select : this.colour.ink; pen.lineWidth = (isSelected ? 2.6 : 1.6) * this.unit;
    pen.beginPath(); pen.arc(x, y, (rank ? 7 : 4) * this.unit, 0, 7); pen.stroke();
    if (rank) this.label(id, x + 9 * this.unit, y - 6 * this.unit, 12, rank);
  }

  label(id, x, y, size, rank) {
    this.labels.push({ id, x, y, size, rank, colour: this.pen.fillStyle, alpha: this.pen.globalAlpha });
  }

  // Numbers where there is room: of many tracks close together all would be a blot.
  drawLabels() {
    const { pen, unit } = this, taken = [];
    pen.textAlign = "left";
    for (const { id, x, y, size, colour, alpha } of this.labels.sort((a, b) => b.rank - a.rank || b.id - a.id)) {
      pen.font = `600 ${size * unit}px system-ui, sans-serif`;
      const right = x + pen.measureText(`${id}`).width + 3 * unit, top = y - size * unit;
      if (taken.some((box) => x < box.right && box.x < right && top < box.y && box.top < y)) continue;
      taken.push({ id, x, y, right, top });
      pen.fillStyle = colour; pen.globalAlpha = alpha; pen.fillText(`${id}`, x, y);
    }
    this.labels = taken;
  }

  drawHits(store, nowS, speed, isCalm) {
    const { pen, view } = this, shown = SHOWN_S * Math.max(1, speed), end = after(store.hits, nowS);
    const isMany = end > FEW_HITS && nowS - store.hits[end - FEW_HITS].timeS < shown;
    pen.fillStyle = this.colour.hit;
    for (let at = end - 1; at >= 0 && at >= end - MOST_HITS; at -= 1) {
      const age = (nowS - store.hits[at].timeS) / shown;
      if (age > 1) break;
      if (!store.hits[at].place || !view.at(store.hits[at].place)) continue;
      const size = (2.2 + (isCalm ? 0 : 3 * Math.max(0, 1 - age * 8))) * this.unit;
      pen.globalAlpha = isCalm ? 0.8 : 0.9 * (1 - age) ** 1.5;
      if (isMany) { pen.fillRect(view.px - 1.5 * this.unit, view.py - 1.5 * this.unit, 3 * this.unit, 3 * this.unit); continue; }
      pen.beginPath(); pen.arc(view.px, view.py, size, 0, 7); pen.fill();
    }
    pen.globalAlpha = 1;
  }

  // Satellites stand at their altitude on the globe, joined with the place below them; the map has the place alone.
  drawSensors(sensors, selected) {
    const { pen, view } = this, taken = [];
    for (const sensor of sensors) {
      const isActive = sensor.state === "detecting", below = geodetic(sensor.position_ecef_m), size = 4.5 * this.unit;
      const high = prepared(below.lon, below.lat, view.kind === "globe" ? below.height : 0);
      pen.fillStyle = pen.strokeStyle = selected === `sensor ${sensor.sensor_id}` ? this.colour.select : this.colour.sensor;
      pen.globalAlpha = isActive ? 1 : 0.65;
      const foot = view.kind === "globe" && view.at(prepared(below.lon, below.lat)) ? [view.px, view.py] : null;
      const isShown = view.at(high), x = view.px, y = view.py;
      if (foot) this.drawNadir(foot, high);
      if (!isShown && !foot) continue;
      const [atX, atY] = isShown ? [x, y] : foot;
      this.marks.push({ key: `sensor ${sensor.sensor_id}`, x: atX, y: atY });
      if (isShown) { pen.beginPath(); pen.moveTo(x, y - size); pen.lineTo(x + size, y); pen.lineTo(x, y + size); pen.lineTo(x - size, y); pen.fill(); }
      pen.globalAlpha = 1;
      this.nameSensor(sensor, atX, atY, isActive, taken);
    }
    pen.globalAlpha = 1;
  }

  drawNadir([x, y], high) {
    const { pen, view } = this;
    pen.lineWidth = 0.8 * this.unit; pen.setLineDash([2, 3]);
    view.at(high);
    pen.beginPath(); pen.moveTo(x, y); pen.lineTo(view.px, view.py); pen.stroke();
    pen.setLineDash([]); pen.beginPath(); pen.arc(x, y, 2.5 * this.unit, 0, 7); pen.stroke();
  }

  // Names where there is room; the timeline has all names.
  nameSensor(sensor, x, y, isActive, taken) {
    const { pen, view } = this;
    if (view.width < 560 || (view.width < 860 && !isActive)) return;
    pen.font = `${11 * this.unit}px system-ui, sans-serif`; pen.textAlign = "center"; pen.fillStyle = this.colour.soft;
    const width = pen.measureText(sensor.sensor_id).width + 6, middle = Math.min(Math.max(x, width / 2), view.width - width / 2);
    for (const line of [16, -9, 29, -22].map((off) => y + off * this.unit)) {
      if (taken.some((box) => Math.abs(box.x - middle) < (box.width + width) / 2 && Math.abs(box.y - line) < 12 * this.unit)) continue;
      taken.push({ x: middle, y: line, width }); pen.fillText(sensor.sensor_id, middle, line);
      return;
    }
  }

  // The launch and the aim of the form while they are chosen, and the centre for the keyboard.
  drawPlaces(places, crosshair) {
    const { pen, view } = this, size = 8 * this.unit;
    for (const { lat, lon, name } of places) {
      if (!view.at(prepared(lon, lat))) continue;
      pen.strokeStyle = name === "launch" ? this.colour.launch : this.colour.impact; pen.lineWidth = 2 * this.unit;
      pen.beginPath(); pen.arc(view.px, view.py, size, 0, 7); pen.moveTo(view.px - size, view.py); pen.lineTo(view.px + size, view.py); pen.moveTo(view.px, view.py - size); pen.lineTo(view.px, view.py + size); pen.stroke();
    }
    if (!crosshair) return;
    pen.strokeStyle = this.colour.select; pen.lineWidth = 1.5;
    pen.beginPath(); pen.moveTo(view.midX - 12, view.midY); pen.lineTo(view.midX + 12, view.midY); pen.moveTo(view.midX, view.midY - 12); pen.lineTo(view.midX, view.midY + 12); pen.stroke();
  }
}
