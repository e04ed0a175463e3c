// What of the Earth the canvas shows: a globe (orthographic) or a map (equal earth), its centre and its zoom.
import { DEG, wrapped } from "/page/earth.js";

const { geoEqualEarth, geoOrthographic } = globalThis.d3;
const RADIUS_M = 6378137, CLOSEST = 4000, FARTHEST = { globe: 0.13, map: 0.7 };
const A1 = 1.340264, A2 = -0.081106, A3 = 0.000893, A4 = 0.003796, M = Math.sqrt(3) / 2;
// Half the width and half the height of the equal-earth map of a unit sphere.
const HALF_WIDTH = 2.7066, HALF_HEIGHT = 1.3173;

// A place prepared for drawing in either projection: computed once, drawn in many frames.
export function prepared(lonDeg, latDeg, heightM = 0) {
  const lon = lonDeg * DEG, lat = latDeg * DEG, out = 1 + Math.max(0, heightM || 0) / RADIUS_M;
  const l = Math.asin(M * Math.sin(lat)), l2 = l * l, l6 = l2 * l2 * l2;
  return {
    lon,
    across: Math.cos(l) / (M * (A1 + 3 * A2 * l2 + l6 * (7 * A3 + 9 * A4 * l2))),
    up: l * (A1 + A2 * l2 + l6 * (A3 + A4 * l2)),
    x: out * Math.cos(lat) * Math.cos(lon), y: out * Math.cos(lat) * Math.sin(lon), z: out * Math.sin(lat),
  };
}

export class View {
  constructor() {
    this.kind = "map"; this.zoom = 1; this.lon = 0; this.lat = 0;
    this.width = this.height = 0; this.version = 0;
    //: The screen position that `at` has found last.
    this.px = this.py = 0;
  }

  resize(width, height) { this.width = width; this.height = height; this.changed(); }

  show(kind) { this.kind = kind; this.zoom = Math.max(this.zoom, FARTHEST[kind]); this.changed(); }

  lookAt(lon, lat) { this.lon = wrapped(lon); this.lat = lat; this.changed(); }

  reset() { this.zoom = 1; this.lat = 0; this.changed(); }

  changed() {
    const fit = this.kind === "globe" ? 0.46 * Math.min(this.width, this.height)
      : Math.min(this.width / (2 * HALF_WIDTH), this.height / (2 * HALF_HEIGHT));
    this.zoom = Math.min(CLOSEST, Math.max(FARTHEST[this.kind], this.zoom));
    this.radius = fit * this.zoom; this.midX = this.width / 2; this.midY = this.height / 2;
    this.lat = Math.min(90, Math.max(-90, this.lat));
    this.shift = this.kind === "map" ? this.mapShift() : 0;
    const around = [[-60, -60], [this.width + 60, this.height + 60]];
    this.projection = this.kind === "globe" ? geoOrthographic().rotate([-this.lon, -this.lat]).clipAngle(90) : geoEqualEarth().rotate([-this.lon, 0]);
    this.projection.scale(this.radius).translate([this.midX, this.midY + this.shift]).precision(0.5).clipExtent(around);
    this.cosLon = Math.cos(this.lon * DEG); this.sinLon = Math.sin(this.lon * DEG);
    this.cosLat = Math.cos(this.lat * DEG); this.sinLat = Math.sin(this.lat * DEG);
    this.version += 1;
  }

  // The map moves up and down only as far as it is larger than the canvas.
  mapShift() {
    const most = Math.max(0, HALF_HEIGHT * this.radius - this.height / 2 + 20), wanted = prepared(0, this.lat).up * this.radius;
    return Math.min(most, Math.max(-most, wanted));
  }

  // Whether a prepared place is in view; its screen position is then in `px`, `py`. Hidden is only what lies behind the Earth.
  at(place) {
    if (this.kind === "map") {
      let turn = place.lon - this.lon * DEG;
      if (turn > Math.PI) turn -= 2 * Math.PI; else if (turn < -Math.PI) turn += 2 * Math.PI;
      this.px = this.midX + this.radius * turn * place.across;
      this.py = this.midY + this.shift - this.radius * place.up;
    } else {
      const near = place.x * this.cosLon + place.y * this.sinLon, right = place.y * this.cosLon - place.x * this.sinLon;
      const up = place.z * this.cosLat - near * this.sinLat, toward = place.z * this.sinLat + near * this.cosLat;
      if (toward < 0 && right * right + up * up < 1) return false;
      this.px = this.midX + this.radius * right; this.py = this.midY - this.radius * up;
    }
    return this.px > -30 && this.py > -30 && this.px < this.width + 30 && this.py < this.height + 30;
  }

  // Longitude and latitude at a screen position, or null beside the Earth.
  placeAt(x, y) {
    const place = this.projection.invert([x, y]);
    if (!place || !Number.isFinite(place[0]) || Math.abs(place[1]) > 90) return null;
    const back = this.projection(place);
    return back && Math.hypot(back[0] - x, back[1] - y) < 1 ? place : null;
  }

  // Moves what is shown by pixels.
  pan(dx, dy) {
    const perPixel = 1 / (DEG * this.radius);
    if (this.kind === "globe") this.lookAt(this.lon - dx * perPixel / Math.max(0.2, this.cosLat), this.lat + dy * perPixel);
    else { this.lon = wrapped(this.lon - dx * perPixel); this.moveMap(dy); }
  }

  // Latitude follows the vertical shift, so that a switch to the globe keeps the centre.
  moveMap(dy) {
    const most = Math.max(0, HALF_HEIGHT * this.radius - this.height / 2 + 20);
    const up = Math.min(most, Math.max(-most, this.shift + dy)) / this.radius, l = this.latitudeOf(up);
    this.lat = l; this.changed();
  }

  latitudeOf(up) {
    const place = geoEqualEarth().scale(1).translate([0, 0]).invert([0, -up]);
    return place && Number.isFinite(place[1]) ? place[1] : 0;
  }

  // Zooms by a factor about a screen position, whose place stays where it is.
  zoomBy(factor, x = this.midX, y = this.midY) {
    const before = this.placeAt(x, y);
    this.zoom *= factor; this.changed();
    if (!before) return;
    const place = this.projection(before);
    if (place) this.pan(x - place[0], y - place[1]);
  }
}
