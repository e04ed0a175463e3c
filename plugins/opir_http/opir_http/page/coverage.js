// Where satellites see: places that none or only one has in its field of regard, above its horizon.
import { DEG } from "/page/earth.js";
import { prepared } from "/page/view.js";

const RADIUS_M = 6378137, STEP_DEG = 5;
let places = null;

// Places with about equal areas around them.
function grid() {
  const found = [];
  for (let lat = -90 + STEP_DEG / 2; lat < 90; lat += STEP_DEG) {
    const count = Math.max(3, Math.round((360 / STEP_DEG) * Math.cos(lat * DEG)));
    for (let at = 0; at < count; at += 1) {
      const place = prepared(((at + 0.5) / count) * 360 - 180, lat);
      found.push({ place, up: [place.x, place.y, place.z] });
    }
  }
  return found;
}

// The places of a grid with the number of satellites that see each.
export function coverage(sensors) {
  places = places || grid();
  const seers = sensors.map(({ position_ecef_m: at, field_of_regard_half_angle_deg: half }) => {
    const place = at.map((axis) => axis / RADIUS_M), distance = Math.hypot(...place);
    return { place, distance, cosine: Math.cos(half * DEG) };
  });
  return places.map(({ place, up }) => ({ place, count: seers.filter((each) => sees(each, up)).length }));
}

function sees({ place, distance, cosine }, up) {
  const along = place[0] * up[0] + place[1] * up[1] + place[2] * up[2];
  if (along <= 1) return false;
  const range = Math.sqrt(distance * distance + 1 - 2 * along);
  return (distance * distance - along) / (distance * range) >= cosine;
}

// Draws crosses where nobody sees, rings where one does; returns how many of each.
export function drawCoverage(pen, view, unit, colour, sensors) {
  const size = 2.6 * unit, drawn = [0, 0];
  pen.lineWidth = 1.1 * unit; pen.globalAlpha = 0.85;
  for (const { place, count } of coverage(sensors)) {
    if (count > 1 || !view.at(place)) continue;
    drawn[count] += 1;
    pen.strokeStyle = count ? colour.soft : colour.impact;
    pen.beginPath();
    if (count) pen.arc(view.px, view.py, size * 0.7, 0, 7);
    else { pen.moveTo(view.px - size, view.py - size); pen.lineTo(view.px + size, view.py + size); pen.moveTo(view.px - size, view.py + size); pen.lineTo(view.px + size, view.py - size); }
    pen.stroke();
  }
  pen.globalAlpha = 1;
  return drawn;
}
