// Positions on the WGS 84 ellipsoid and shapes on the sphere of the map: lines of sight, caps, ellipses, the Sun.
const A = 6378137, F = 1 / 298.257223563, E2 = F * (2 - F);
export const DEG = Math.PI / 180;

export function geodetic([x, y, z]) {
  const p = Math.hypot(x, y);
  let lat = Math.atan2(z, p * (1 - E2));
  for (let turn = 0; turn < 4; turn += 1) {
    const n = A / Math.sqrt(1 - E2 * Math.sin(lat) ** 2);
    lat = Math.atan2(z + E2 * n * Math.sin(lat), p);
  }
  return { lat: lat / DEG, lon: Math.atan2(y, x) / DEG, height: Math.hypot(x, y, z) - A };
}

// The first intersection of a line of sight with the ellipsoid, or null if there is none.
export function groundPoint(position, azimuthDeg, elevationDeg) {
  const here = geodetic(position), lat = here.lat * DEG, lon = here.lon * DEG;
  const az = azimuthDeg * DEG, el = elevationDeg * DEG;
  const e = Math.cos(el) * Math.sin(az), n = Math.cos(el) * Math.cos(az), u = Math.sin(el);
  const sl = Math.sin(lat), cl = Math.cos(lat), so = Math.sin(lon), co = Math.cos(lon);
  const way = [-so * e - sl * co * n + cl * co * u, co * e - sl * so * n + cl * so * u, cl * n + sl * u];
  const range = rangeToGround(position, way);
  return range === Infinity ? null : geodetic(along(position, way, range));
}

const scaled = ([x, y, z]) => [x, y, z / (1 - F)];

const along = (position, way, range) => position.map((axis, index) => axis + range * way[index]);

// How far along a line of sight the ground is, in lengths of `way`; Infinity if it meets none.
export function rangeToGround(position, way) {
  const p = scaled(position), d = scaled(way), a = dot(d, d), b = dot(p, d), root = b * b - a * (dot(p, p) - A * A);
  return root < 0 || b > 0 ? Infinity : (-b - Math.sqrt(root)) / a;
}

export function ecef(latDeg, lonDeg, height) {
  const lat = latDeg * DEG, lon = lonDeg * DEG, n = A / Math.sqrt(1 - E2 * Math.sin(lat) ** 2);
  return [(n + height) * Math.cos(lat) * Math.cos(lon), (n + height) * Math.cos(lat) * Math.sin(lon), (n * (1 - E2) + height) * Math.sin(lat)];
}

// The place on the horizon below a line of sight that meets no ground.
function horizon(position, way) {
  const p = scaled(position), d = scaled(way), near = A / Math.hypot(...p), out = d.map((axis, index) => axis - (dot(p, d) / dot(p, p)) * p[index]), length = Math.hypot(...out);
  const [x, y, z] = p.map((axis, index) => near ** 2 * axis + (A * Math.sqrt(1 - near ** 2) * out[index]) / length);
  return [x, y, z * (1 - F)];
}

// The ground in a cone from a satellite about a point, up to the horizon, as a GeoJSON polygon; null if it meets none.
export function cone(position, point, halfAngleDeg, points = 48) {
  const unit = (v) => { const length = Math.hypot(...v); return v.map((axis) => axis / length); };
  const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
  const axis = unit(point.map((each, index) => each - position[index])), side = unit(cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), other = cross(axis, side);
  const half = halfAngleDeg * DEG, ring = [];
  let isSeen = false;
  for (let step = 0; step < points; step += 1) {
    const turn = (step / points) * 2 * Math.PI, way = axis.map((each, index) => Math.cos(half) * each + Math.sin(half) * (Math.cos(turn) * side[index] + Math.sin(turn) * other[index]));
    const range = rangeToGround(position, way), place = geodetic(range === Infinity ? horizon(position, way) : along(position, way, range));
    isSeen ||= range !== Infinity;
    ring.push([place.lon, place.lat]);
  }
  if (!isSeen && rangeToGround(position, axis) === Infinity) return null;
  const polygon = { type: "Polygon", coordinates: [[...ring, ring[0]]] };
  if (globalThis.d3.geoArea(polygon) > 2 * Math.PI) polygon.coordinates[0].reverse();
  return polygon;
}

// The cap of the Earth that a satellite sees, as a GeoJSON polygon: to its horizon or its field of regard, whichever is narrower.
export function footprint(position, halfAngleDeg) {
  const radius = Math.hypot(...position), centre = geodetic(position);
  const horizon = Math.acos(Math.min(1, A / radius)), half = halfAngleDeg * DEG;
  const sine = (radius / A) * Math.sin(half);
  const reach = sine >= 1 || half >= Math.PI / 2 ? horizon : Math.min(horizon, Math.asin(sine) - half);
  return cap(centre.lon, centre.lat, reach / DEG);
}

// All places within an angle of one, as a GeoJSON polygon; right over poles and across 180 degrees.
export function cap(lon, lat, reachDeg) {
  return globalThis.d3.geoCircle().center([lon, lat]).radius(reachDeg).precision(3)();
}

// An error ellipse of launch and impact points, as a GeoJSON polygon.
export function ellipse(point, shape, points = 48) {
  const { semi_major_m: major, semi_minor_m: minor, bearing_deg: turned } = shape, ring = [];
  for (let step = 0; step < points; step += 1) {
    const turn = (step / points) * 2 * Math.PI;
    const along = major * Math.cos(turn), across = minor * Math.sin(turn);
    const bearing = Math.atan2(across, along) + turned * DEG;
    ring.push(ahead(point.lat_deg * DEG, point.lon_deg * DEG, bearing, Math.hypot(along, across) / A));
  }
  return { type: "Polygon", coordinates: [[...ring, ring[0]]] };
}

// A polygon of RFC 7946 with rings as arrays of numbers: longitude and latitude of each corner in four bytes, to two metres.
// Lists of pairs take ten times as much.
export function packed(geometry) {
  const rings = (each) => each.map((ring) => Float32Array.from(ring.flatMap(([lon, lat]) => [lon, lat])));
  return { type: geometry.type, coordinates: geometry.type === "Polygon" ? rings(geometry.coordinates) : geometry.coordinates.map(rings) };
}

// A packed polygon (its outer rings counterclockwise) with the order that d3-geo needs.
export function rewound(geometry) {
  const turned = (rings) => rings.map((ring) => Array.from({ length: ring.length / 2 }, (_, at) => [ring[ring.length - 2 * at - 2], ring[ring.length - 2 * at - 1]]));
  return { type: geometry.type, coordinates: geometry.type === "Polygon" ? turned(geometry.coordinates) : geometry.coordinates.map(turned) };
}

// The place under the Sun at a Unix time, s: low-precision almanac formulas, good to 0.01 degrees from 1950 to 2050.
export function subsolar(unixS) {
  const days = unixS / 86400 - 10957.5, anomaly = (357.528 + 0.9856003 * days) * DEG;
  const mean = 280.46 + 0.9856474 * days;
  const longitude = (mean + 1.915 * Math.sin(anomaly) + 0.02 * Math.sin(2 * anomaly)) * DEG;
  const tilt = (23.439 - 4e-7 * days) * DEG;
  const ascension = Math.atan2(Math.cos(tilt) * Math.sin(longitude), Math.cos(longitude)) / DEG;
  const sidereal = 280.46061837 + 360.98564736629 * days;
  return { lat: Math.asin(Math.sin(tilt) * Math.sin(longitude)) / DEG, lon: wrapped(ascension - sidereal) };
}

export function wrapped(lon) { return ((((lon + 180) % 360) + 360) % 360) - 180; }

// Decodes the land: rings of differences, in units of 1/scale degree.
export function landOf({ scale, polygons }) {
  const ring = (steps) => {
    const places = [];
    let x = 0, y = 0;
    for (let at = 0; at < steps.length; at += 2) { x += steps[at]; y += steps[at + 1]; places.push([x / scale, y / scale]); }
    return places;
  };
  return { type: "MultiPolygon", coordinates: polygons.map((rings) => rings.map(ring)) };
}

function ahead(lat, lon, bearing, reach) {
  const there = Math.asin(Math.sin(lat) * Math.cos(reach) + Math.cos(lat) * Math.sin(reach) * Math.cos(bearing));
  const turn = Math.atan2(Math.sin(bearing) * Math.sin(reach) * Math.cos(lat), Math.cos(reach) - Math.sin(lat) * Math.sin(there));
  return [wrapped((lon + turn) / DEG), there / DEG];
}

function dot(one, other) { return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]; }
