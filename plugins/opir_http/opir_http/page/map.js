// The world map: an equirectangular canvas; coasts are drawn once, everything else in each frame.
import { ellipse, footprint, geodetic, greatCircle, groundPoint } from "/page/earth.js";

const SHOWN_MS = 6000, GONE_MS = 20000, MOST_HITS = 1500;
// Larger ellipses are not drawn.
const WIDEST_M = 2.5e6;

export class WorldMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.middle = 0; this.isCentred = false;
    this.sensors = []; this.hits = []; this.tracks = new Map(); this.rings = [];
    fetch("/page/coast.json").then((answer) => answer.json()).then((coast) => { this.rings = coast.rings; this.resize(); });
    new ResizeObserver(() => this.resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.resize());
    requestAnimationFrame(() => this.frame());
  }

  setSensors(sensors) {
    this.sensors = sensors.map((one) => ({ ...one, below: geodetic(one.position_ecef_m), view: footprint(one.position_ecef_m, one.field_of_regard_half_angle_deg) }));
  }

  hit(event) {
    const place = event.latitude_deg === null
      ? groundPoint(event.sensor_position_ecef_m, event.azimuth_deg, event.elevation_deg)
      : { lat: event.latitude_deg, lon: event.longitude_deg };
    if (place) this.centre(place.lon);
    if (place) this.hits.push({ ...place, at: performance.now(), sensor: event.sensor_id });
    if (this.hits.length > MOST_HITS) this.hits.splice(0, this.hits.length - MOST_HITS);
  }

  // The map is cut in the Pacific, or along the Greenwich meridian if the first detection is in the Pacific.
  centre(lon) {
    if (this.isCentred) return;
    this.isCentred = true;
    if (Math.abs(lon) > 110) { this.middle = 180; this.resize(); }
  }

  setTrack(track) {
    this.tracks.set(track.track_id, { ...track, at: performance.now() });
    if (this.tracks.size > 200) this.tracks.delete(this.tracks.keys().next().value);
  }

  resize() {
    const box = this.canvas.getBoundingClientRect(), ratio = Math.min(devicePixelRatio || 1, 2);
    if (!box.width || !box.height) return;
    this.canvas.width = Math.round(box.width * ratio); this.canvas.height = Math.round(box.height * ratio);
    this.ratio = ratio;
    this.unit = parseFloat(getComputedStyle(document.documentElement).fontSize) / 15;
    const scale = Math.min(box.width / 360, box.height / 180);
    this.scale = scale; this.left = (box.width - 360 * scale) / 2; this.top = (box.height - 180 * scale) / 2;
    const style = getComputedStyle(document.documentElement);
    this.colour = Object.fromEntries(["sea", "land", "shore", "line", "sensor", "hit", "launch", "impact", "ink", "soft"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    this.ground = this.drawnGround();
  }

  x(lon) { return this.left + (this.fromMiddle(lon) + 180) * this.scale; }
  fromMiddle(lon) { return ((((lon - this.middle + 180) % 360) + 360) % 360) - 180; }
  y(lat) { return this.top + (90 - lat) * this.scale; }

  drawnGround() {
    const ground = document.createElement("canvas"), pen = ground.getContext("2d");
    ground.width = this.canvas.width; ground.height = this.canvas.height;
    pen.scale(this.ratio, this.ratio);
    pen.strokeStyle = this.colour.line; pen.lineWidth = 0.5;
    for (let lon = -180; lon < 180; lon += 30) this.path(pen, [{ lon, lat: 90 }, { lon, lat: -90 }]);
    for (let lat = -60; lat < 90; lat += 30) this.path(pen, [{ lon: -180, lat }, { lon: 180, lat }]);
    pen.fillStyle = this.colour.land; pen.strokeStyle = this.colour.shore; pen.lineWidth = 0.6;
    pen.beginPath(); pen.rect(this.left, this.top, 360 * this.scale, 180 * this.scale); pen.clip();
    for (const ring of this.rings) for (const turn of [-360, 0, 360]) this.drawRing(pen, ring, turn);
    return ground;
  }

  // A ring that crosses 180 degrees continues beyond it; drawn once more to each side, it is complete on the map.
  drawRing(pen, ring, turn) {
    let before = ring[0], shift = turn * 10;
    pen.beginPath();
    for (let at = 0; at < ring.length; at += 2) {
      if (Math.abs(ring[at] - before) > 1800 && Math.abs(ring[at + 1]) < 890) shift += ring[at] < before ? 3600 : -3600;
      before = ring[at];
      pen.lineTo(this.left + ((ring[at] + shift) / 10 - this.middle + 180) * this.scale, this.y(ring[at + 1] / 10));
    }
    pen.closePath(); pen.fill(); pen.stroke();
  }

  path(pen, places) {
    pen.beginPath();
    let before = null;
    for (const place of places) {
      const lon = this.fromMiddle(place.lon);
      if (before === null || Math.abs(lon - before) > 180) pen.moveTo(this.x(place.lon), this.y(place.lat));
      else pen.lineTo(this.x(place.lon), this.y(place.lat));
      before = lon;
    }
    pen.stroke();
  }

  frame() {
    requestAnimationFrame(() => this.frame());
    if (!this.ground || document.hidden) return;
    const pen = this.canvas.getContext("2d"), now = performance.now();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.ground, 0, 0);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.drawSensors(pen);
    this.drawTracks(pen);
    this.drawHits(pen, now);
  }

  drawSensors(pen) {
    for (const sensor of this.sensors) {
      const active = sensor.state === "detecting", x = this.x(sensor.below.lon), y = this.y(sensor.below.lat);
      pen.strokeStyle = this.colour.sensor; pen.globalAlpha = active ? 0.55 : 0.16; pen.lineWidth = (active ? 1.1 : 0.9) * this.unit;
      this.path(pen, sensor.view);
      pen.globalAlpha = active ? 1 : 0.65;
      pen.fillStyle = this.colour.sensor;
      const size = 4.5 * this.unit;
      pen.beginPath(); pen.moveTo(x, y - size); pen.lineTo(x + size, y); pen.lineTo(x, y + size); pen.lineTo(x - size, y); pen.fill();
      pen.globalAlpha = 1;
    }
    this.labels(pen);
  }

  // Sensor names where there is room; the timeline has all names.
  labels(pen) {
    if (this.scale < 1.6) return;
    pen.font = `${11 * this.unit}px system-ui, sans-serif`; pen.textAlign = "center"; pen.fillStyle = this.colour.soft;
    const taken = [];
    const crowded = this.scale < 2.4;
    for (const sensor of this.sensors) {
      if (crowded && sensor.state !== "detecting") continue;
      const width = pen.measureText(sensor.sensor_id).width + 6;
      const x = Math.min(Math.max(this.x(sensor.below.lon), width / 2), this.left * 2 + 360 * this.scale - width / 2);
      for (const y of [16, -9, 29, -22].map((off) => this.y(sensor.below.lat) + off * this.unit)) {
        if (taken.some((box) => Math.abs(box.x - x) < (box.width + width) / 2 && Math.abs(box.y - y) < 12 * this.unit)) continue;
        taken.push({ x, y, width }); pen.fillText(sensor.sensor_id, x, y);
        break;
      }
    }
  }

  drawTracks(pen) {
    this.drawn = { launches: 0, impacts: 0, ellipses: 0 };
    for (const track of this.tracks.values()) {
      const { launch_point: launch, impact_point: impact } = track, age = performance.now() - track.at;
      pen.globalAlpha = age < GONE_MS ? 1 : 0.35;
      pen.lineWidth = 1.5 * this.unit;
      if (launch && impact) this.drawGroundTrack(pen, launch, impact);
      if (impact) this.drawImpact(pen, impact, track.track_id);
      if (launch) this.drawLaunch(pen, launch);
      if (track.latitude_deg !== null && age < GONE_MS) this.drawNow(pen, track);
    }
    pen.globalAlpha = 1;
  }

  drawGroundTrack(pen, launch, impact) {
    const alpha = pen.globalAlpha;
    pen.strokeStyle = this.colour.ink; pen.globalAlpha = 0.4 * alpha; pen.setLineDash([3 * this.unit, 4 * this.unit]);
    this.path(pen, greatCircle(launch, impact));
    pen.setLineDash([]); pen.globalAlpha = alpha;
  }

  drawEllipse(pen, point) {
    if (!point.ellipse || point.ellipse.semi_major_m > WIDEST_M) return 0;
    pen.lineWidth = 1.3 * this.unit;
    this.path(pen, ellipse(point));
    return 1;
  }

  drawLaunch(pen, launch) {
    pen.strokeStyle = pen.fillStyle = this.colour.launch;
    this.drawEllipse(pen, launch);
    const x = this.x(launch.lon_deg), y = this.y(launch.lat_deg), size = 5 * this.unit;
    pen.beginPath(); pen.moveTo(x, y - size); pen.lineTo(x + size, y + size); pen.lineTo(x - size, y + size); pen.fill();
    this.drawn.launches += 1;
  }

  drawImpact(pen, impact, number) {
    pen.strokeStyle = pen.fillStyle = this.colour.impact;
    this.drawn.ellipses += this.drawEllipse(pen, impact);
    const x = this.x(impact.lon_deg), y = this.y(impact.lat_deg), size = 4.5 * this.unit;
    pen.lineWidth = 1.8 * this.unit;
    pen.beginPath(); pen.moveTo(x - size, y - size); pen.lineTo(x + size, y + size); pen.moveTo(x - size, y + size); pen.lineTo(x + size, y - size); pen.stroke();
    pen.font = `600 ${11 * this.unit}px system-ui, sans-serif`; pen.textAlign = "left"; pen.fillText(`${number}`, x + 7 * this.unit, y + 4 * this.unit);
    this.drawn.impacts += 1;
  }

  drawNow(pen, track) {
    const x = this.x(track.longitude_deg), y = this.y(track.latitude_deg);
    pen.strokeStyle = pen.fillStyle = this.colour.ink; pen.lineWidth = 1.6 * this.unit;
    pen.beginPath(); pen.arc(x, y, 8 * this.unit, 0, 7); pen.stroke();
    pen.font = `600 ${12 * this.unit}px system-ui, sans-serif`; pen.textAlign = "left"; pen.fillText(`${track.track_id}`, x + 10 * this.unit, y - 6 * this.unit);
  }

  drawHits(pen, now) {
    this.hits = this.hits.filter((hit) => now - hit.at < SHOWN_MS);
    pen.fillStyle = this.colour.hit;
    for (const hit of this.hits) {
      const age = (now - hit.at) / SHOWN_MS;
      pen.globalAlpha = 0.9 * (1 - age) ** 1.5;
      pen.beginPath(); pen.arc(this.x(hit.lon), this.y(hit.lat), (2.2 + 3 * Math.max(0, 1 - age * 8)) * this.unit, 0, 7); pen.fill();
    }
    pen.globalAlpha = 1;
  }
}
