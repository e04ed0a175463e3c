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
  const k = 1 / (1 - F), p = [position[0], position[1], position[2] * k], d = [way[0], way[1], way[2] * k];
  const a = dot(d, d), b = dot(p, d), c = dot(p, p) - A * A, root = b * b - a * c;
  if (root < 0) return null;
  const range = (-b - Math.sqrt(root)) / a;
  return geodetic(position.map((axis, index) => axis + range * way[index]));
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
