// Positions on the WGS 84 ellipsoid: subsatellite points, line-of-sight intersections, circles and ellipses.
const A = 6378137, F = 1 / 298.257223563, E2 = F * (2 - F), DEG = Math.PI / 180;

export function geodetic([x, y, z]) {
  const p = Math.hypot(x, y);
  let lat = Math.atan2(z, p * (1 - E2));
  for (let turn = 0; turn < 4; turn += 1) {
    const n = A / Math.sqrt(1 - E2 * Math.sin(lat) ** 2);
    lat = Math.atan2(z + E2 * n * Math.sin(lat), p);
  }
  return { lat: lat / DEG, lon: Math.atan2(y, x) / DEG };
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

// The circle on a sphere that a satellite sees: its horizon or its field of regard, whichever is narrower.
export function footprint(position, halfAngleDeg) {
  const radius = Math.hypot(...position), centre = geodetic(position);
  const horizon = Math.acos(Math.min(1, A / radius)), half = halfAngleDeg * DEG;
  const sine = (radius / A) * Math.sin(half);
  const reach = sine >= 1 || half >= Math.PI / 2 ? horizon : Math.min(horizon, Math.asin(sine) - half);
  return circle(centre, reach, 96);
}

export function circle(centre, reach, points) {
  const lat = centre.lat * DEG, lon = centre.lon * DEG, ring = [];
  for (let step = 0; step <= points; step += 1) {
    const bearing = (step / points) * 2 * Math.PI;
    ring.push(ahead(lat, lon, bearing, reach));
  }
  return ring;
}

// The great circle from one position to another, both with lat_deg and lon_deg.
export function greatCircle(one, other, points = 64) {
  const unit = ({ lat_deg: lat, lon_deg: lon }) => [Math.cos(lat * DEG) * Math.cos(lon * DEG), Math.cos(lat * DEG) * Math.sin(lon * DEG), Math.sin(lat * DEG)];
  const a = unit(one), b = unit(other), angle = Math.acos(Math.max(-1, Math.min(1, dot(a, b)))), way = [];
  for (let step = 0; step <= points && Math.sin(angle) > 1e-6; step += 1) {
    const ahead = Math.sin((step / points) * angle), back = Math.sin((1 - step / points) * angle);
    const [x, y, z] = a.map((axis, index) => back * axis + ahead * b[index]);
    way.push({ lat: Math.atan2(z, Math.hypot(x, y)) / DEG, lon: Math.atan2(y, x) / DEG });
  }
  return way;
}

export function ellipse(point, points = 48) {
  const { semi_major_m: major, semi_minor_m: minor, bearing_deg: turned } = point.ellipse, ring = [];
  for (let step = 0; step <= points; step += 1) {
    const turn = (step / points) * 2 * Math.PI;
    const along = major * Math.cos(turn), across = minor * Math.sin(turn);
    const bearing = Math.atan2(across, along) + turned * DEG;
    ring.push(ahead(point.lat_deg * DEG, point.lon_deg * DEG, bearing, Math.hypot(along, across) / A));
  }
  return ring;
}

function ahead(lat, lon, bearing, reach) {
  const there = Math.asin(Math.sin(lat) * Math.cos(reach) + Math.cos(lat) * Math.sin(reach) * Math.cos(bearing));
  const turn = Math.atan2(Math.sin(bearing) * Math.sin(reach) * Math.cos(lat), Math.cos(reach) - Math.sin(lat) * Math.sin(there));
  return { lat: there / DEG, lon: ((lon + turn) / DEG + 540) % 360 - 180 };
}

function dot(one, other) { return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]; }
